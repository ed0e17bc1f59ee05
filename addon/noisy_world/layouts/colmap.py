# SPDX-License-Identifier: GPL-3.0-or-later
"""COLMAP's models as text: cameras.txt, images.txt and points3D.txt, beside a folder of images.

https://colmap.github.io/format.html#text-format: a line of images.txt is IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ,
CAMERA_ID, NAME, from the world to a camera whose axes are OpenCV's; the next one has its points and may be empty.
https://colmap.github.io/cameras.html: the models' parameters. Pixels' corners, not their centres, are at whole
coordinates ("the upper left pixel's center is (0.5, 0.5)"). COLMAP has no depth: it lies in a folder `depth`, under the
images' names with the suffix png.
"""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics, invert_pose, quat_wxyz_from_rotation
from ..core.lens import Distortion, Optics, distortion_of
from ..trajectories.formats import read_file_poses
from .layout import MILLIMETRES, RECORDED_HZ, RecordedLayout, SequenceFacts, counted_note, lines
from .nerfstudio import TRANSFORMS, by_number
from .numbered import NumberedPoses, numbered_frames
from .stored_recording import PosePolicy, StoredSequence, check_files, checked_intrinsics, recorded_text
from .with_reader import LayoutWithReader

IMAGES, DEPTH, MODEL = "images", "depth", "sparse/0"
_BINARY = "cameras.bin"
_PLACES = (MODEL, "sparse", "")
_HALF_PX = 0.5
_SHORTEST = 4  # coefficients of a lens of ours
# model: its parameters, where f is both focal lengths, and a lens's in OpenCV's order.
_MODELS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
_RADIAL_TANGENTIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_CAMERAS_HEADER = [
    "# Camera list with one line of data per camera:",
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
    "# Number of cameras: 1",
]
_IMAGES_HEADER = [
    "# Image list with two lines of data per image:",
    "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
    "#   POINTS2D[] as (X, Y, POINT3D_ID)",
]
_POINTS_HEADER = [
    "# 3D point list with one line of data per point:",
    "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (POINT3D_ID, POINT2D_IDX)",
    "# Number of points: 0, mean track length: 0",
]


class ColmapRecordings(RecordedLayout):
    """`images/`, and a model as text in `sparse/0`, `sparse` or beside the images; `depth/`, if there is any."""

    name = "colmap"
    order = 125
    label = "COLMAP"
    meaning = "a model of COLMAP as text, of one camera; depth beside it, which COLMAP has not"
    files = "images/, sparse/0/cameras.txt, images.txt; depth/NAME.png where there is depth"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a model beside images; a transforms.json there was made of it, and is read instead."""
        return (folder / IMAGES).is_dir() and _model(folder) is not None and not (folder / TRANSFORMS).is_file()

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Take the images in the order of their names; those without a line in images.txt have no pose."""
        model = _model(folder)
        if model is None:
            raise InputError(folder, "has no cameras.txt and images.txt", remedy="as COLMAP writes a model")
        if (model / _BINARY).is_file() and not (model / "cameras.txt").is_file():
            remedy = f"colmap model_converter --input_path {model} --output_path {model} --output_type TXT"
            raise InputError(model / _BINARY, "is a binary model, and models are read as text", remedy=remedy)
        path, cameras = model / "images.txt", model / "cameras.txt"
        found = _poses(path)
        check_files(path, tuple(folder / IMAGES / name for name in found))
        colour = sorted(
            (file.relative_to(folder / IMAGES).as_posix() for file in (folder / IMAGES).rglob("*") if file.is_file()),
            key=by_number,
        )
        depth = None
        if (folder / DEPTH).is_dir():
            there = {row: (folder / DEPTH / name).with_suffix(".png") for row, name in enumerate(colour)}
            depth = {row: file for row, file in there.items() if file.is_file()}
        given = None
        if poses != "none":
            given = NumberedPoses(path, {row: found[name] for row, name in enumerate(colour) if name in found})
        used_hz = rate_hz or RECORDED_HZ
        matched = numbered_frames(
            *(folder, {row: folder / IMAGES / name for row, name in enumerate(colour)}, depth, given),
            policy=poses,
            rate_hz=used_hz,
        )
        camera, lens = _camera(cameras)
        return StoredSequence(
            folder,
            matched.rgb_files,
            matched.depth_files,
            None if given is None else path,
            matched.trajectory,
            matched.stamps,
            MILLIMETRES,
            None,
            camera,
            cameras,
            (*matched.notes, *counted_note(rate_hz, used_hz)),
            used_hz,
            optics=Optics(distortion=lens),
        )


def _model(folder: Path) -> Path | None:
    """Return the folder of a recording's model, as text or binary; None where there is none."""
    models = [folder / place for place in _PLACES]
    named = [("cameras.txt", "images.txt"), (_BINARY, "images.bin")]
    return next((model for files in named for model in models if all((model / name).is_file() for name in files)), None)


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield for each line that is no comment where it is, and its words, none of an empty one."""
    for number, line in enumerate(recorded_text(path).splitlines(), 1):
        if not line.lstrip().startswith("#"):
            yield f"line {number}", line.split()


def _poses(path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the pose (4, 4), c2w, of each image by its name. Raises InputError."""
    if not any(words for _, words in _lines(path)):
        return {}
    images = read_file_poses(path, format="colmap")
    c2w = dict(zip(images.names, invert_pose(images.poses), strict=True))
    if len(c2w) < len(images.names):
        name, count = Counter(images.names).most_common(1)[0]
        raise InputError(path, f"{name} has {count} lines", remedy="keep one of them")
    return c2w


def _camera(path: Path) -> tuple[Intrinsics, Distortion | None]:
    """Return the camera that all images have, and its lens. Raises InputError."""
    rows = [(where, words) for where, words in _lines(path) if words]
    if not rows or any(words[1:] != rows[0][1][1:] for _, words in rows):
        remedy = "a recording has one: ImageReader.single_camera 1 of COLMAP's feature_extractor"
        raise InputError(path, f"has {len(rows)} cameras", remedy=remedy)
    where, words = rows[0]
    model = words[1] if len(words) > 1 else ""
    if model not in _MODELS:
        problem = f"is of the model {model[:40]}, but {', '.join(_MODELS)} can be read"
        raise InputError(path, problem, where=where)
    numbers = _numbers(path, where, words[2:])
    names = _MODELS[model]
    if len(numbers) != 2 + len(names):
        raise InputError(
            path, f"has {max(len(numbers) - 2, 0)} parameters, but {model} has {', '.join(names)}", where=where
        )
    values = dict(zip(names, numbers[2:], strict=True))
    fx_px, fy_px = values.get("fx", values.get("f")), values.get("fy", values.get("f"))
    centre_px = values["cx"] - _HALF_PX, values["cy"] - _HALF_PX
    camera = checked_intrinsics(path, (where,) * 6, (*numbers[:2], fx_px, fy_px, *centre_px))
    if model == "OPENCV_FISHEYE":
        return camera, distortion_of("equidistant", tuple(numbers[6:]))
    said = _RADIAL_TANGENTIAL if model == "FULL_OPENCV" else _RADIAL_TANGENTIAL[:_SHORTEST]
    return camera, distortion_of("radial-tangential", tuple(values.get(name, 0.0) for name in said))


def _numbers(path: Path, where: str, words: list[str]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        raise InputError(path, "holds what is no finite number", where=where)
    return numbers


class ColmapLayout(LayoutWithReader):
    """`images/000000.png`, `depth/000000.png`, and a model without points in `sparse/0`."""

    reader = ColmapRecordings()
    images = ("png", "jpg")
    colours = ("rgb", "grey")
    depth_scale_per_m = MILLIMETRES
    rgb_file = f"{IMAGES}/{{frame:06d}}.{{image}}"
    depth_file = f"{DEPTH}/{{frame:06d}}.png"
    patterns = tuple(f"{MODEL}/{name}.txt" for name in ("cameras", "images", "points3D"))

    def says_lens(self, lens: Distortion) -> bool:
        """Tell that each lens has a model there."""
        del lens
        return True

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return the model: one camera, the images whose pose is known, and no points."""
        path = facts.chosen.rgb
        w2c = invert_pose(path.c2w)
        values = np.concatenate([quat_wxyz_from_rotation(w2c[:, :3, :3]), w2c[:, :3, 3]], axis=1) + 0.0
        rows: list[str] = []
        for frame, numbers, known in zip(facts.frames, values.tolist(), path.known.tolist(), strict=True):
            name = facts.names.rgb(frame).removeprefix(f"{IMAGES}/")
            if known:
                rows += [" ".join([str(frame + 1), *map(repr, numbers), "1", name]), ""]
        return {
            f"{MODEL}/cameras.txt": lines([*_CAMERAS_HEADER, _camera_line(facts.camera, facts.optics.distortion)]),
            f"{MODEL}/images.txt": lines([*_IMAGES_HEADER, f"# Number of images: {len(rows) // 2}", *rows]),
            f"{MODEL}/points3D.txt": lines(_POINTS_HEADER),
        }

    def poses_file(self, folder: Path) -> tuple[Path, NDArray[np.float64]]:
        """Return images.txt and its poses, in the order of the images' names."""
        path = folder / MODEL / "images.txt"
        found = _poses(path)
        return path, np.array([found[name] for name in sorted(found, key=by_number)]).reshape(-1, 4, 4)


def _camera_line(camera: Intrinsics, lens: Distortion | None) -> str:
    values = [camera.fx_px, camera.fy_px, camera.cx_px + _HALF_PX, camera.cy_px + _HALF_PX]
    model, coefficients = "PINHOLE", ()
    if lens is not None:
        model, coefficients = str(lens.named()["colmap"]), lens.coefficients
    coefficients = (*coefficients, *(0.0,) * (len(_MODELS[model]) - len(values) - len(coefficients)))
    return " ".join(
        [f"1 {model} {camera.width_px} {camera.height_px}", *map(repr, map(float, (*values, *coefficients)))]
    )


LAYOUT = ColmapLayout()
