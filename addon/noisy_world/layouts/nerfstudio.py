# SPDX-License-Identifier: GPL-3.0-or-later
"""transforms.json, with or without depth: nerfstudio, and Record3D's captures that it processes.

https://docs.nerf.studio/quickstart/data_conventions.html; nerfstudio/data/dataparsers/nerfstudio_dataparser.py
(file_path and depth_file_path relative to the file, depth_unit_scale_factor 1e-3: millimetres) and
nerfstudio/data/utils/data_utils.py (depth images are resized to the size of colour, so they show the same view in
other pixels). Pixels' corners, not their centres, are at whole coordinates there: cameras.py adds 0.5.

Instant NGP, NeRFCapture and SplaTAM have depth_path and integer_depth_scale, metres a step; NeRF's Blender scenes
camera_angle_x alone, and names without a suffix.
"""

import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number, parse_json_file
from ..core.geometry import Intrinsics, blender_from_opencv_c2w, opencv_from_blender_c2w
from ..core.lens import Distortion, Optics, distortion_of
from ..core.schema import quoted
from ..images.image_files import read_header, read_steps
from ..trajectories.formats import read_file_poses
from .described import median_camera, seen_by_depth
from .layout import MILLIMETRES, RECORDED_HZ, RecordedLayout, SequenceFacts, counted_note
from .numbered import NumberedPoses, numbered_frames
from .stored_recording import (
    SCALES_PER_M,
    PosePolicy,
    SizePx,
    StoredSequence,
    check_files,
    checked_intrinsics,
    recorded_text,
    size_of,
)
from .with_reader import LayoutWithReader

TRANSFORMS = "transforms.json"
DEPTH_KEYS = ("depth_file_path", "depth_path")
SCALE_KEYS = ("integer_depth_scale", "depth_unit_scale_factor")  # metres a step
SUFFIXES = (".png", ".jpg", ".jpeg", ".npy", ".exr", ".tiff", ".tif", ".webp", ".bmp")
_ANGLES = ("camera_angle_x", "camera_angle_y")
_LEAST_MM = 100.0  # chosen: no middle of a frame of a room is at 10 cm, and none at 100 m
INTRINSICS = ("w", "h", "fl_x", "fl_y", "cx", "cy")
_HALF_PX = 0.5
# camera_model: its coefficients, in OpenCV's order ("OPENCV uses k1-2 and p1-2, OPENCV_FISHEYE uses k1-4").
_LENSES = {"OPENCV": ("k1", "k2", "p1", "p2"), "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4")}
_RADIAL_TANGENTIAL = (*_LENSES["OPENCV"], "k3")
_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")


class NerfstudioRecordings(RecordedLayout):
    """`transforms.json`, whose frames name colour (`file_path`) and depth (`depth_file_path`)."""

    name = "nerfstudio"
    order = 120
    label = "Nerfstudio"
    meaning = "transforms.json as nerfstudio has it and makes it of Record3D's captures; depth, if any, in mm"
    files = "transforms.json, with depth_file_path where there is depth"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a transforms.json."""
        return (folder / TRANSFORMS).is_file()

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Take the frames in the order of their images' names; their poses are OpenGL's."""
        path = folder / TRANSFORMS
        text = recorded_text(path)
        document = parse_json_file(text, path)
        frames = document.get("frames") if isinstance(document, dict) else None
        if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
            raise InputError(path, "is no list of frames", where="frames", remedy="as nerfstudio writes it")
        order = sorted(range(len(frames)), key=lambda row: by_number(str(frames[row].get("file_path", ""))))
        colour = {number: _file(path, row, frames[row], "file_path") for number, row in enumerate(order)}
        named = {number: key for number, row in enumerate(order) if (key := _depth_key(frames[row]))}
        depth = {number: _file(path, order[number], frames[order[number]], key) for number, key in named.items()}
        check_files(path, tuple(colour.values()))
        check_files(path, tuple(depth.values()))
        given, notes = None, ()
        if poses != "none":
            read = read_file_poses(path, format="transforms")
            c2w = opencv_from_blender_c2w(read.poses)
            given = NumberedPoses(path, {number: c2w[row] for number, row in enumerate(order)})
            notes = tuple(note for note in read.notes if "applied_" in note)
        used_hz = rate_hz or RECORDED_HZ
        found = numbered_frames(
            *(folder, colour, depth or None, given),
            policy=poses,
            rate_hz=used_hz,
        )
        camera, differ = _camera(path, document, frames, size_of(found.rgb_files[0]))
        seen = seen_by_depth(camera, size_of(found.depth_files[0])) if depth else None
        scale_per_m, scale_note = _scale_of(path, document, found.depth_files)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            None if given is None else path,
            found.trajectory,
            found.stamps,
            scale_per_m,
            None,
            camera,
            path,
            (*found.notes, *notes, *filter(None, (differ, scale_note)), *counted_note(rate_hz, used_hz)),
            used_hz,
            optics=Optics(seen, _distortion(path, document, frames)),
        )


def by_number(name: str) -> tuple[str, int, str]:
    """Return a key that sorts names by the last number in them, as people count."""
    match = re.fullmatch(r"(.*?)([0-9]{1,18})([^0-9]*)", name)
    return (match[1], int(match[2]), match[3]) if match else (name, -1, "")


def _file(path: Path, row: int, frame: Mapping[str, Any], key: str) -> Path:
    """Return the file of a frame: with slashes of Windows, and without its suffix where one image has that name."""
    name = frame.get(key)
    if not isinstance(name, str) or not name or "\0" in name:
        what = "colour" if key == "file_path" else "depth"
        raise InputError(path, f"names no {what} image", where=f"frames.{row}.{key}")
    file = path.parent / name
    if os.path.lexists(file):
        return file
    file = path.parent / name.replace("\\", "/")
    if file.suffix.lower() in SUFFIXES or os.path.lexists(file):
        return file
    there = [found for suffix in SUFFIXES if os.path.lexists(found := file.parent / f"{file.name}{suffix}")]
    if len(there) > 1:
        problem = f"is {name[-60:]}, which is {there[0].name} or {there[1].name}"
        raise InputError(path, problem, where=f"frames.{row}.{key}", remedy="name it with its suffix")
    return there[0] if there else file


def _depth_key(frame: Mapping[str, Any]) -> str:
    """Return the key by which a frame names its depth; "" where it names none."""
    return next((key for key in DEPTH_KEYS if frame.get(key) is not None), "")


def _scale_of(path: Path, document: Mapping[str, Any], depth_files: tuple[Path, ...]) -> tuple[float, str]:
    """Return the steps a metre of depth, and a note where its values alone tell them."""
    if not depth_files:
        return MILLIMETRES, ""
    header = read_header(depth_files[0])
    key = next((key for key in SCALE_KEYS if key in document), None)
    if key is not None and not header.floating:
        step_m = finite_number(document[key])
        if step_m is None or not 1 / SCALES_PER_M[1] <= step_m <= 1 / SCALES_PER_M[0]:
            problem = f"is {quoted(str(document[key]))}, but has to be a number above 0, the metres of a step"
            raise InputError(path, problem, where=key, remedy="write 0.001 for millimetres")
        return 1 / step_m, ""
    if not header.floating:
        return MILLIMETRES, ""
    values = read_steps(depth_files[0], header.size_px)
    known = values[np.isfinite(values) & (values > 0)]
    median = float(np.median(known)) if known.size else 0.0
    unit, scale_per_m = ("millimetres", MILLIMETRES) if median > _LEAST_MM else ("metres", 1.0)
    return scale_per_m, f"depth is floating point, {median:.3g} in the middle: it is taken for {unit}"


def _camera(path: Path, document: Mapping[str, Any], frames: list[Any], size_px: SizePx) -> tuple[Intrinsics, str]:
    """Return the camera, and a note where frames differ. size_px: of the images, where nothing says it."""
    model = str(document.get("camera_model", "OPENCV"))
    if model not in (*_LENSES, *_PINHOLES):
        raise InputError(path, f"is {model[:40]}, but {', '.join(_LENSES)} can be read", where="camera_model")
    told = [item for item in (document, *frames) if any(key in item for key in (*INTRINSICS, *_ANGLES))]
    if not told:
        raise InputError(path, "is missing", where="fl_x", remedy=f"a camera has {', '.join(INTRINSICS)}")
    of_frames = [frame for frame in frames if any(key in frame for key in INTRINSICS)]
    each = [{**frame, **document} for frame in of_frames] or [document]  # as nerfstudio, which believes the whole
    return median_camera(path, [_camera_of(path, said, size_px) for said in each])


def _camera_of(path: Path, said: Mapping[str, Any], size_px: SizePx) -> Intrinsics:
    """Return the camera that a mapping says; the size, the middle and square pixels are what it need not say."""
    size: list[Any] = [said.get("w", size_px[0]), said.get("h", size_px[1])]
    numbers = [finite_number(value) or 0.0 for value in size]
    focal = {key: said.get(key) for key in ("fl_x", "fl_y")}
    for (key, angle_key), side in zip((("fl_x", _ANGLES[0]), ("fl_y", _ANGLES[1])), numbers, strict=True):
        angle_rad = finite_number(said.get(angle_key))
        if focal[key] is None and angle_rad is not None and 0 < angle_rad < math.pi:
            focal[key] = 0.5 * side / math.tan(0.5 * angle_rad)
    fl_x = focal["fl_x"]
    if fl_x is None:
        raise InputError(path, "is missing", where="fl_x", remedy=f"a camera has {', '.join(INTRINSICS)}")
    fl_y = fl_x if focal["fl_y"] is None else focal["fl_y"]
    middle = [finite_number(said.get(key, side / 2)) for key, side in zip(("cx", "cy"), numbers, strict=True)]
    centred = [None if value is None else value - _HALF_PX for value in middle]
    return checked_intrinsics(path, INTRINSICS, (*size, fl_x, fl_y, *centred))


def _shared(path: Path, document: Mapping[str, Any], frames: list[Any], key: str) -> float:
    """Return a coefficient that all frames share, said of the whole or of each; 0 where nothing says it."""
    said = [(f"frames.{row}.{key}", frame[key]) for row, frame in enumerate(frames) if key in frame]
    said = [(key, document[key])] if key in document else said
    if not said:
        return 0.0
    for where, value in said:
        if finite_number(value) is None:
            raise InputError(path, "is no finite number", where=where)
        if value != said[0][1]:
            raise InputError(path, f"is {value}, but an earlier frame's is {said[0][1]}", where=where, remedy="a recording has one camera")  # fmt: skip  # noqa: E501
    number = finite_number(said[0][1])
    assert number is not None, "just checked"
    return number


def _distortion(path: Path, document: Mapping[str, Any], frames: list[Any]) -> Distortion | None:
    model = str(document.get("camera_model", "OPENCV"))
    used = _LENSES.get(model, ())
    values = {key: _shared(path, document, frames, key) for key in ("k1", "k2", "k3", "k4", "p1", "p2")}
    if model == "OPENCV" and values["k3"]:
        used = (*used, "k3")
    lost = [key for key, value in values.items() if value and key not in used]
    if lost:
        raise InputError(path, f"is {values[lost[0]]:g}, but {model} has no such coefficient", where=lost[0])
    coefficients = tuple(values[key] for key in used)
    return (
        distortion_of("equidistant" if model == "OPENCV_FISHEYE" else "radial-tangential", coefficients)
        if used
        else None
    )


class NerfstudioLayout(LayoutWithReader):
    """`images/000000.png`, `depth/000000.png` and `transforms.json`, which names them.

    Instant NGP and SplaTAM read depth by `depth_path` and `integer_depth_scale`, metres a step; nerfstudio by
    `depth_file_path`, in millimetres unless its `depth_unit_scale_factor` is set.
    """

    reader = NerfstudioRecordings()
    images = ("png", "jpg")
    colours = ("rgb",)
    depth_scale_per_m = MILLIMETRES
    rgb_file, depth_file = "images/{frame:06d}.{image}", "depth/{frame:06d}.png"
    patterns = (TRANSFORMS,)
    gaps = False  # each of its frames has a transform_matrix

    def says_lens(self, lens: Distortion) -> bool:
        """Tell whether the file can say how a lens distorts: not by the rational model."""
        return len(lens.coefficients) <= len(_RADIAL_TANGENTIAL)

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return transforms.json: the camera, and of each frame its files, its time and its pose."""
        names, written = facts.names, facts.format
        frames: list[dict[str, Any]] = []
        c2w = blender_from_opencv_c2w(facts.chosen.rgb.c2w)
        for row, frame in enumerate(facts.frames):
            told: dict[str, Any] = {}
            if "rgb" in written.modalities:
                told["file_path"] = names.rgb(frame)
            if "depth" in written.modalities:
                told["depth_file_path"] = told["depth_path"] = names.depth(frame)
            told["timestamp"] = float(facts.taken.rgb.seconds[row])
            if facts.chosen.rgb.known[row]:
                told["transform_matrix"] = c2w[row].tolist()
            frames.append(told)
        scale = {"integer_depth_scale": 1 / written.depth_scale_per_m} if "depth" in written.modalities else {}
        document = {**_camera_text(facts.camera, facts.optics.distortion), **scale, "frames": frames}
        return {TRANSFORMS: json.dumps(document, indent=2) + "\n"}

    def poses_file(self, folder: Path) -> tuple[Path, NDArray[np.float64]]:
        """Return transforms.json and its poses."""
        path = folder / TRANSFORMS
        return path, opencv_from_blender_c2w(read_file_poses(path, format="transforms").poses)


def _camera_text(camera: Intrinsics, lens: Distortion | None) -> dict[str, Any]:
    """Return a camera as transforms.json says it: pixels' corners are at whole coordinates there."""
    angle = lens is not None and lens.model == "equidistant"
    names = _LENSES["OPENCV_FISHEYE"] if angle else _RADIAL_TANGENTIAL
    coefficients = lens.coefficients if lens is not None else (0.0,) * len(_LENSES["OPENCV"])
    return {
        "camera_model": "OPENCV_FISHEYE" if angle else "OPENCV",
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": float(camera.fx_px),
        "fl_y": float(camera.fy_px),
        "cx": float(camera.cx_px) + _HALF_PX,
        "cy": float(camera.cy_px) + _HALF_PX,
        **dict(zip(names, coefficients, strict=False)),
    }


LAYOUT = NerfstudioLayout()
