# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses in JSON: the transforms.json of nerfstudio, Instant NGP and NeRF's Blender scenes, and Open3D's.

In a transforms.json poses are camera-to-world with OpenGL's camera axes, x right, y up, z backward
(https://docs.nerf.studio/quickstart/data_conventions.html), in the order in which the frames are listed.
"""

import itertools
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.schema import quoted
from ..core.trajectory import Direction
from .matrix_poses import rigid_poses
from .pose_files import FilePoses, PoseFile, ReadOptions, StatedCamera, TrajectoryFormat, all_finite, named_rows

_REMEDY = "frames is a list, each with transform_matrix: four rows of four numbers"
# nerfstudio's rays go through half-numbered pixels (cameras.py adds 0.5), ours through whole ones.
_HALF_PX = 0.5
_LENS = ("k1", "k2", "k3", "k4", "p1", "p2")
_INTRINSICS = {"w": "width_px", "h": "height_px", "fl_x": "fx_px", "fl_y": "fy_px", "cx": "cx_px", "cy": "cy_px"}


def _transforms_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a transforms.json. Raises InputError naming the key that is wrong."""
    del options
    path = file.path
    document = _document(path, file.text)
    frames = document.get("frames")
    if not isinstance(frames, list):
        raise InputError(path, "is missing" if frames is None else "is no list", where="frames", remedy=_REMEDY)
    if not frames:
        raise InputError(path, "is empty: no pose", where="frames", remedy=_REMEDY)
    values = np.array([_matrix(path, index, frame) for index, frame in enumerate(frames)])
    rows = named_rows(path, values, [f"frames.{index}.transform_matrix" for index in range(len(values))])
    poses = rigid_poses(all_finite(rows))
    notes = (*_order_notes(frames), *_moved_notes(document))
    numbers = np.arange(len(poses), dtype=np.float64)
    camera = _camera(path, document, frames)
    return FilePoses("transforms", poses, numbers=numbers, axes="opengl", camera=camera, notes=notes)


def _document(path: Path, text: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(path, f"is not valid JSON: {error.msg}", where=f"line {error.lineno}") from None
    except ValueError:  # whole numbers of thousands of digits
        raise InputError(path, "holds a number of too many digits") from None
    except RecursionError:
        raise InputError(path, "is nested too deeply") from None
    if not isinstance(document, dict):
        raise InputError(path, "is JSON, but no mapping with frames", remedy=_REMEDY)
    return document


def _matrix(path: Path, index: int, frame: object) -> list[float]:
    where = f"frames.{index}.transform_matrix"
    rows = frame.get("transform_matrix") if isinstance(frame, Mapping) else None
    if rows is None:
        raise InputError(path, "is missing", where=where, remedy=_REMEDY)
    shape = [len(row) if isinstance(row, list) else -1 for row in rows] if isinstance(rows, list) else []
    if shape not in ([4, 4, 4, 4], [4, 4, 4]):
        raise InputError(path, "is no 4 x 4 matrix", where=where, remedy=_REMEDY)
    numbers = [_number(value) for row in rows for value in row]
    if None in numbers:
        raise InputError(path, "holds what is no number", where=where, remedy=_REMEDY)
    found = [number for number in numbers if number is not None]
    return found if len(found) == 16 else [*found, 0.0, 0.0, 0.0, 1.0]


def _number(value: object) -> float | None:
    """Return a JSON number; None for anything else. Too large a whole number is infinite."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


# --- notes ---


def _order_notes(frames: list[Any]) -> list[str]:
    """Say that the images' names number the frames in another order than that of the list."""
    names = [str(frame.get("file_path", "")) for frame in frames]
    found = [re.search(r"(?<![0-9])([0-9]++)[^0-9]*+$", Path(name).stem) for name in names]
    if not all(found):
        return []
    numbers = [int(match[1].lstrip("0")[:300] or 0) for match in found if match]
    later = next((i for i, (a, b) in enumerate(itertools.pairwise(numbers)) if b <= a), None)
    if later is None:
        return []
    one, other = names[later], names[later + 1]
    return [f"frames are not listed by the numbers of their names ({other} comes after {one}): the path is as listed"]


def _moved_notes(document: dict[str, Any]) -> list[str]:
    notes = []
    transform = document.get("applied_transform")
    if transform is not None and not _is_identity(transform):
        notes.append(
            "poses hold the file's applied_transform, and are used as they stand; a mesh in the world before it has to "
            "be moved alike"
        )
    scale = document.get("applied_scale")
    if scale is not None and _number(scale) != 1.0:
        notes.append(f"poses hold the file's applied_scale of {scale}, and are used as metres")
    return notes


def _is_identity(transform: object) -> bool:
    return transform in (np.eye(4).tolist(), np.eye(4)[:3].tolist())


# --- the camera ---


def _camera(path: Path, document: dict[str, Any], frames: list[Any]) -> StatedCamera | None:
    stated: dict[str, Any] = {}
    varies = False
    for key, name in _INTRINSICS.items():
        values = [frame[key] for frame in frames if key in frame] or ([document[key]] if key in document else [])
        varies = varies or any(value != values[0] for value in values)
        if values:
            stated[name] = _checked(path, key, values[0]) - (_HALF_PX if key in ("cx", "cy") else 0.0)
    if "camera_angle_x" in document:
        stated["angle_x_rad"] = _checked(path, "camera_angle_x", document["camera_angle_x"])
    distorts = any(_checked(path, key, document[key]) != 0.0 for key in _LENS if key in document)
    distorts = distorts or any(frame.get(key) for frame in frames for key in _LENS)
    return StatedCamera(**stated, varies=varies, distorts=distorts) if stated or distorts else None


def _checked(path: Path, key: str, value: object) -> float:
    number = _number(value)
    if number is None or not math.isfinite(number):
        raise InputError(path, f"is {str(value)[:40]!r}, but has to be a number", where=key)
    return number


# --- Open3D ---

# A PinholeCameraTrajectory holds world-to-camera matrices, a PoseGraph camera-to-world ones; both write a matrix column
# by column (EigenMatrix4dToJsonArray in cpp/open3d/utility/IJsonConvertible.cpp).
_OPEN3D: dict[str, tuple[str, str, Direction]] = {
    "PinholeCameraTrajectory": ("parameters", "extrinsic", "w2c"),
    "PoseGraph": ("nodes", "pose", "c2w"),
}


def is_open3d(file: PoseFile) -> bool:
    """Tell whether a file is JSON that says the class of Open3D that it holds."""
    return isinstance(file.document, dict) and isinstance(file.document.get("class_name"), str)


def _open3d_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read the cameras of a trajectory or the nodes of a pose graph. Raises InputError naming the key that is wrong."""
    del options
    path = file.path
    document = _document(path, file.text)
    name = document.get("class_name")
    if name not in _OPEN3D:
        remedy = f"of Open3D's classes {' and '.join(_OPEN3D)} hold a path"
        raise InputError(path, f"is {quoted(str(name))}", where="class_name", remedy=remedy)
    listed, key, direction = _OPEN3D[name]
    items = document.get(listed)
    if not isinstance(items, list) or not items:
        raise InputError(path, "holds no pose", where=listed, remedy=f"a list of objects with {key}, 16 numbers each")
    where = [f"{listed}.{index}.{key}" for index in range(len(items))]
    values = np.array([_sixteen(path, place, item, key) for place, item in zip(where, items, strict=True)])
    columns_first = values.reshape(-1, 4, 4).transpose(0, 2, 1).reshape(-1, 16)
    poses = rigid_poses(all_finite(named_rows(path, columns_first, where)))
    return FilePoses("open3d", poses, numbers=np.arange(len(poses), dtype=np.float64), direction=direction)


def _sixteen(path: Path, where: str, item: object, key: str) -> list[float]:
    numbers = item.get(key) if isinstance(item, Mapping) else None
    values = [_number(value) for value in numbers] if isinstance(numbers, list) else []
    sixteen = [value for value in values if value is not None]
    if len(sixteen) != 16 or len(values) != 16:
        raise InputError(path, "is no list of 16 numbers", where=where, remedy="a 4 x 4 pose, column by column")
    return sixteen


OPEN3D = TrajectoryFormat(
    "open3d",
    "Open3D JSON",
    "Open3D's PinholeCameraTrajectory or PoseGraph, as JSON",
    is_open3d,
    _open3d_poses,
    one_convention=True,
    looks_like="Open3D's `trajectory.json` (`PinholeCameraTrajectory`) and pose graphs (`PoseGraph`)",
    recognised_by="JSON with `class_name`",
    times="as listed, `rate_hz`",
    order=65,
)
TRANSFORMS = TrajectoryFormat(
    "transforms",
    "Transforms",
    "The transforms.json of nerfstudio and NeRF",
    lambda file: file.begins_with("{", "[") and not is_open3d(file),
    _transforms_poses,
    looks_like="`transforms.json` of nerfstudio, Instant NGP and NeRF",
    recognised_by="`{` at the beginning",
    times="as listed, `rate_hz`",
    order=70,
)
FORMAT = OPEN3D, TRANSFORMS
