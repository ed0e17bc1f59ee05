# SPDX-License-Identifier: GPL-3.0-or-later
"""transforms.json, with or without depth: nerfstudio, and Record3D's captures that it processes.

https://docs.nerf.studio/quickstart/data_conventions.html; nerfstudio/data/dataparsers/nerfstudio_dataparser.py
(file_path and depth_file_path relative to the file, depth_unit_scale_factor 1e-3: millimetres) and
nerfstudio/data/utils/data_utils.py (depth images are resized to the size of colour, so they show the same view in
other pixels). Pixels' corners, not their centres, are at whole coordinates there: cameras.py adds 0.5.
"""

import json
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
from ..trajectories.formats import read_file_poses
from .borrowed import BorrowedLayout
from .described import seen_by_depth
from .layout import MILLIMETRES, RECORDED_HZ, Image, RecordedLayout, SequenceFacts, counted_note, numbered
from .numbered import NumberedPoses, numbered_frames
from .stored_recording import PosePolicy, StoredSequence, check_files, checked_intrinsics, recorded_text, size_of

TRANSFORMS = "transforms.json"
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
        has_depth = any("depth_file_path" in frame for frame in frames)
        colour = [_file(path, row, frames[row], "file_path") for row in order]
        depth = [_file(path, row, frames[row], "depth_file_path") for row in order] if has_depth else None
        check_files(path, tuple(colour))
        check_files(path, tuple(depth or ()))
        given, notes = None, ()
        if poses != "none":
            read = read_file_poses(path, format="transforms")
            c2w = opencv_from_blender_c2w(read.poses)
            given = NumberedPoses(path, {number: c2w[row] for number, row in enumerate(order)})
            notes = tuple(note for note in read.notes if "applied_" in note)
        used_hz = rate_hz or RECORDED_HZ
        found = numbered_frames(
            *(folder, dict(enumerate(colour)), None if depth is None else dict(enumerate(depth)), given),
            policy=poses,
            rate_hz=used_hz,
        )
        camera = _camera(path, document, frames)
        seen = seen_by_depth(camera, size_of(found.depth_files[0])) if has_depth else None
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            None if given is None else path,
            found.trajectory,
            found.stamps,
            MILLIMETRES,
            None,
            camera,
            path,
            (*found.notes, *notes, *counted_note(rate_hz, used_hz)),
            used_hz,
            optics=Optics(seen, _distortion(path, document, frames)),
        )


def by_number(name: str) -> tuple[str, int, str]:
    """Return a key that sorts names by the last number in them, as people count."""
    match = re.fullmatch(r"(.*?)([0-9]{1,18})([^0-9]*)", name)
    return (match[1], int(match[2]), match[3]) if match else (name, -1, "")


def _file(path: Path, row: int, frame: Mapping[str, Any], key: str) -> Path:
    name = frame.get(key)
    if not isinstance(name, str) or not name or "\0" in name:
        what = "colour" if key == "file_path" else "depth"
        raise InputError(path, f"names no {what} image", where=f"frames.{row}.{key}")
    return path.parent / name


def _camera(path: Path, document: Mapping[str, Any], frames: list[Any]) -> Intrinsics:
    model = str(document.get("camera_model", "OPENCV"))
    if model not in (*_LENSES, *_PINHOLES):
        raise InputError(path, f"is {model[:40]}, but {', '.join(_LENSES)} can be read", where="camera_model")
    values = [_shared(path, document, frames, key) for key in INTRINSICS]
    numbers = [
        value - _HALF_PX if key in ("cx", "cy") else value for key, value in zip(INTRINSICS, values, strict=True)
    ]
    return checked_intrinsics(path, INTRINSICS, tuple(numbers))


def _shared(
    path: Path, document: Mapping[str, Any], frames: list[Any], key: str, default: float | None = None
) -> float:
    """Return a number that all frames share, said of the whole or of each."""
    said = [(f"frames.{row}.{key}", frame[key]) for row, frame in enumerate(frames) if key in frame]
    said = [(key, document[key])] if key in document else said
    if not said:
        if default is None:
            raise InputError(path, "is missing", where=key, remedy=f"a camera has {', '.join(INTRINSICS)}")
        return default
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
    values = {key: _shared(path, document, frames, key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")}
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


class NerfstudioLayout(BorrowedLayout):
    """`images/000000.png`, `depth/000000.png` and `transforms.json`, which names them.

    Instant NGP and SplaTAM read depth by `depth_path` and `integer_depth_scale`, metres a step; nerfstudio by
    `depth_file_path`, in millimetres unless its `depth_unit_scale_factor` is set.
    """

    reader = NerfstudioRecordings()
    name, order, label, meaning, files = reader.name, reader.order, reader.label, reader.meaning, reader.files
    images = ("png", "jpg")
    colours = ("rgb",)
    depth_scale_per_m = MILLIMETRES
    patterns = (*numbered("images/{}.png"), *numbered("images/{}.jpg"), *numbered("depth/{}.png"), TRANSFORMS)
    gaps = False  # each of its frames has a transform_matrix

    def rgb_name(self, frame: int, stamp_ns: int, image: Image) -> str:
        """Return the name of a frame's colour image."""
        del stamp_ns
        return f"images/{frame:06d}.{image}"

    def depth_name(self, frame: int, stamp_ns: int) -> str:
        """Return the name of a frame's depth image."""
        del stamp_ns
        return f"depth/{frame:06d}.png"

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
