# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings of telephones with a depth sensor: Record3D's EXR and JPG, and Polycam's raw data.

Record3D: nerfstudio/process_data/record3d_utils.py (metadata.json: poses are qx qy qz qw tx ty tz, c2w; K column by
column; w, h) and docs/quickstart ("export with the EXR + JPG sequence format": EXR_RGBD/rgb/0.jpg, depth/0.exr);
perFrameIntrinsicCoeffs is fx fy cx cy of each frame, frameTimestamps its seconds, fps the rate. Depth is metres, of
fewer pixels. Axes are ARKit's: x right, y up, z backward.

Polycam: nerfstudio/process_data/polycam_utils.py and docs (keyframes/images, cameras and depth, or corrected_images and
corrected_cameras after its optimisation; t_00 to t_23 are rows of c2w, fx, fy, cx, cy, width, height; depth in
millimetres, of fewer pixels). Both worlds have y up, which becomes z.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number, parse_json_file
from ..core.geometry import (
    Intrinsics,
    nearest_rotation,
    opencv_from_blender_c2w,
    pose,
    rotation_error,
    rotation_from_quat_wxyz,
)
from ..core.trajectory import Stamps
from .cam_params import matrix_in
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, SequenceSpec, Told, median_camera
from .layout import intrinsics_of_matrix
from .numbered import Cameras
from .stored_recording import checked_intrinsics, recorded_text, size_of

METADATA = "metadata.json"
UP_FROM_ARKIT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_TOLERANCE = 5e-3  # as for files of poses


class Record3DLayout(DescribedLayout):
    """`rgb/0.jpg`, `depth/0.exr` and `metadata.json`."""

    name = "record3d"
    order = 170
    label = "Record3D"
    meaning = "an EXR + JPG export of Record3D: depth in metres, poses of ARKit"
    files = "rgb/0.jpg, depth/0.exr, metadata.json"
    told_by = (METADATA, "rgb/*.*g")
    described = SequenceSpec(rgb=ImageFilesSpec("rgb/*.*g"), depth=DepthFilesSpec("depth/*.exr"))

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return the median of the cameras, and poses and times by the numbers of the images."""
        path = folder / METADATA
        said = _mapping(path)
        poses = _numbers(path, said.get("poses"), "poses", 7)
        coefficients = said.get("perFrameIntrinsicCoeffs")
        size_px = size_of(images[0])
        if coefficients:
            values = _numbers(path, coefficients, "perFrameIntrinsicCoeffs", 4)
            camera, note = median_camera(path, [_camera(path, size_px, row) for row in values.tolist()])
        else:
            camera, note = intrinsics_of_matrix(path, matrix_in(path, said.get("K"), "K").T, size_px), ""
        own_px = tuple(finite_number(said.get(name)) for name in ("w", "h"))
        if None not in own_px and own_px != size_px:
            problem = f"is of images of {own_px[0]:g} x {own_px[1]:g}, but these are {size_px[0]} x {size_px[1]}"
            raise InputError(path, problem, remedy="take the images that belong to it")
        quats = poses[:, [3, 0, 1, 2]]
        length = np.linalg.norm(quats, axis=1)
        if (wrong := np.flatnonzero(~(np.abs(length - 1) <= 1e-2))).size:
            raise InputError(path, "holds no unit quaternion", where=f"poses.{wrong[0]}")
        c2w = _upright(pose(rotation_from_quat_wxyz(quats), poses[:, 4:]))
        times = said.get("frameTimestamps")
        stamps = None
        if isinstance(times, list) and len(times) == len(images) == len(poses):
            seconds = np.array([value if (value := finite_number(each)) is not None else np.nan for each in times])
            if not np.isfinite(seconds).all() or np.any(np.diff(seconds) <= 0):
                raise InputError(path, "has to hold times, each later than the one before", where="frameTimestamps")
            stamps = Stamps(seconds)
        rate_hz = finite_number(said.get("fps"))
        if rate_hz is not None and not 1e-3 <= rate_hz <= 1e4:
            raise InputError(path, f"is {rate_hz:g}, but has to be frames a second", where="fps")
        return Told(Cameras(camera, path), _by_name(images, c2w), path, stamps, rate_hz or None, (note,))


class PolycamLayout(DescribedLayout):
    """`keyframes/images`, `keyframes/cameras` and `keyframes/depth`, or the corrected ones."""

    name = "polycam"
    order = 180
    label = "Polycam"
    meaning = "raw data of Polycam: depth in mm, poses of ARKit or, where there are any, those that it has corrected"
    files = "keyframes/images/N.jpg, keyframes/cameras/N.json, keyframes/depth/N.png (or corrected_images)"
    told_by = ("keyframes/*images/*.jpg", "keyframes/*cameras/*.json")
    described = SequenceSpec(
        rgb=ImageFilesSpec("keyframes/images/*.jpg"), depth=DepthFilesSpec("keyframes/depth/*.png")
    )

    def description(self, folder: Path) -> SequenceSpec:
        """Return where the files are: what it has corrected, where it has."""
        spec = super().description(folder)
        return replace(spec, rgb=ImageFilesSpec("keyframes/corrected_images/*.jpg")) if _corrected(folder) else spec

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return the median of the cameras, and poses by the numbers of the images."""
        place = folder / "keyframes" / ("corrected_cameras" if _corrected(folder) else "cameras")
        poses: list[NDArray[np.float64] | None] = []
        cameras: list[Intrinsics] = []
        for image in images:
            path = place / f"{image.stem}.json"
            if not path.is_file():
                poses.append(None)
                continue
            said = _mapping(path)
            size_px = (said.get("width"), said.get("height"))
            cameras.append(checked_intrinsics(path, _CAMERA, (*size_px, *(said.get(name) for name in _CAMERA[2:]))))
            rows = [[finite_number(said.get(f"t_{row}{column}")) for column in range(4)] for row in range(3)]
            matrix = np.array([[np.nan if value is None else value for value in row] for row in rows])
            if not float(rotation_error(matrix[:, :3])) <= _TOLERANCE:
                raise InputError(path, "t_00 to t_23 are no pose", remedy="as Polycam writes it")
            poses.append(_upright(pose(nearest_rotation(matrix[:, :3]), matrix[:, 3])))
        if not cameras:
            raise InputError(place, "has no camera of an image", remedy="as Polycam exports raw data")
        camera, note = median_camera(place, cameras)
        return Told(Cameras(camera, place), poses, place, notes=(note,))


_CAMERA = ("width", "height", "fx", "fy", "cx", "cy")


def _corrected(folder: Path) -> bool:
    inside = folder / "keyframes"
    return any(inside.glob("corrected_images/*.jpg")) and any(inside.glob("corrected_cameras/*.json"))


def _upright(c2w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses of ARKit, (..., 4, 4), with OpenCV's camera axes, in a world whose z is up."""
    return UP_FROM_ARKIT @ opencv_from_blender_c2w(c2w) + 0.0  # + 0.0: no negative zeros


def _by_name(images: tuple[Path, ...], c2w: NDArray[np.float64]) -> list[NDArray[np.float64] | None]:
    """Return the pose of each image by the number that it is named by."""
    numbers = [int(image.stem) if image.stem.isdecimal() and len(image.stem) < 10 else -1 for image in images]
    return [c2w[number] if 0 <= number < len(c2w) else None for number in numbers]


def _mapping(path: Path) -> Mapping[str, Any]:
    document = parse_json_file(recorded_text(path), path)
    if not isinstance(document, dict):
        raise InputError(path, "is JSON, but no mapping")
    return document


def _numbers(path: Path, value: Any, where: str, width: int) -> NDArray[np.float64]:
    rows = value if isinstance(value, list) else []
    numbers = [[finite_number(each) for each in row] if isinstance(row, list) else [] for row in rows]
    if not numbers or any(len(row) != width or None in row for row in numbers):
        raise InputError(path, f"is no list of {width} numbers each", where=where)
    return np.array(numbers, dtype=np.float64)


def _camera(path: Path, size_px: tuple[int, int], values: list[float]) -> Intrinsics:
    return checked_intrinsics(path, _CAMERA, (*size_px, *values))


LAYOUT = Record3DLayout(), PolycamLayout()
