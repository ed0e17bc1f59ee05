# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras in files: cam_params.json, other tools' intrinsics, lens distortion, and depth cameras."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import finite_number, parse_json_file
from ..core.geometry import Intrinsics, rotation_error
from ..core.lens import DISTORTION, MODELS, PINHOLE, DepthCamera, Distortion, DistortionModel, Optics, distortion_of
from .layout import intrinsics_of_matrix
from .stored_recording import SizePx, checked_depth_scale, checked_intrinsics, recorded_text

# Lens distortion and depth cameras, as the files of a recording state them.


INTRINSICS = ("w", "h", "fx", "fy", "cx", "cy")
_RIGID = 5e-3  # entries of R^T R - 1, as for poses: rounding passes, scale does not


def stated_optics(path: Path, document: dict[str, Any]) -> Optics:
    """Return what the keys `depth_camera` and `distortion` of a JSON document say. Raises InputError."""
    depth = _depth_camera(path, document["depth_camera"]) if "depth_camera" in document else None
    distortion = _distortion(path, document["distortion"]) if "distortion" in document else None
    return Optics(depth, distortion)


def checked_distortion(path: Path, where: str, model: object, coefficients: object) -> Distortion | None:
    """Return a lens as a file says it; None where all coefficients are zero. Raises InputError."""
    numbers = [finite_number(value) for value in coefficients] if isinstance(coefficients, list) else [None]
    found = tuple(number for number in numbers if number is not None)
    if len(found) != len(numbers):
        raise InputError(path, "has to be a list of finite numbers", where=where)
    if not any(found):
        return None
    if model not in MODELS:
        message = f"is of the model {str(model)[:40]}, but {' and '.join(MODELS)} can be read"
        raise InputError(path, message, where=where, remedy="undistort the images, and set the coefficients to zeros")
    try:
        return distortion_of(cast("DistortionModel", model), found)
    except ValueError as error:
        raise InputError(path, f"holds {error}", where=where) from None


def _distortion(path: Path, stated: object) -> Distortion | None:
    if not isinstance(stated, dict):
        raise InputError(path, "has to be a model and coefficients", where="distortion")
    return checked_distortion(path, "distortion", stated.get("model"), stated.get("coefficients"))


def _depth_camera(path: Path, stated: object) -> DepthCamera:
    where = "depth_camera"
    if not isinstance(stated, dict) or any(name not in stated for name in INTRINSICS):
        raise InputError(path, f"has to have {', '.join(INTRINSICS)}", where=where)
    places = tuple(f"{where}.{name}" for name in INTRINSICS)
    camera = checked_intrinsics(path, places, tuple(stated[name] for name in INTRINSICS))
    shares_lens = stated.get("shares_lens", False)
    if not isinstance(shares_lens, bool):
        raise InputError(path, "is neither true nor false", where=f"{where}.shares_lens")
    rows = stated.get("rgb_from_depth")
    return DepthCamera(camera, None if rows is None else _pose(path, f"{where}.rgb_from_depth", rows), shares_lens)


def _pose(path: Path, where: str, rows: object) -> tuple[tuple[float, ...], ...]:
    shape = [len(row) if isinstance(row, list) else 0 for row in rows] if isinstance(rows, list) else []
    numbers = (
        [finite_number(value) for row in rows for value in row] if isinstance(rows, list) and shape == [4] * 4 else []
    )
    found = [number for number in numbers if number is not None]
    if len(found) != 16:
        raise InputError(path, "has to be four rows of four finite numbers", where=where)
    matrix = np.array(found).reshape(4, 4)
    rigid = float(rotation_error(matrix[:3, :3])) <= _RIGID and np.linalg.det(matrix[:3, :3]) > 0
    if not rigid or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise InputError(path, "is no rigid pose", where=where, remedy="write it row by row")
    return tuple(tuple(row) for row in matrix.tolist())


CAM_PARAMS = "cam_params.json"

_REMEDY = "mend or remove it"


def cam_params_text(camera: Intrinsics, depth_scale_per_m: float, optics: Optics = PINHOLE) -> str:
    """Return the content of the file. A lens stands there by model and coefficients and, for people, by name."""
    values = {
        "w": camera.width_px,
        "h": camera.height_px,
        "fx": float(camera.fx_px),
        "fy": float(camera.fy_px),
        "cx": float(camera.cx_px),
        "cy": float(camera.cy_px),
        "scale": float(depth_scale_per_m),
    }
    beyond = optics.content()
    if optics.distortion is not None:
        beyond[DISTORTION] = {**beyond[DISTORTION], **optics.distortion.named()}
    return json.dumps({"camera": values, **beyond}, indent=2) + "\n"


@dataclass(frozen=True)
class CamParams:
    """What a cam_params.json says. depth_scale_per_m: steps per metre. camera: None where it holds the scale alone.

    optics: what the cameras have beyond one pinhole.
    """

    path: Path
    depth_scale_per_m: float
    camera: Intrinsics | None
    optics: Optics = PINHOLE


def read_cam_params(folder: Path) -> CamParams | None:
    """Return what the cam_params.json of a sequence says; None where there is no such file.

    It is looked for in the sequence's own folder, then in the folder above. Raises InputError where it is no such file,
    lacks the scale or one of the intrinsics, or holds values that no camera has.
    """
    for parent in (folder, folder.parent):
        path = parent / CAM_PARAMS
        if os.path.lexists(path):  # a link that leads nowhere is a mistake, and no missing file
            return read_cam_params_file(path)
    return None


def read_cam_params_file(path: Path) -> CamParams:
    """Return what a cam_params.json says. Raises InputError as read_cam_params does."""
    document = parse_json_file(recorded_text(path), path, remedy=_REMEDY)
    camera = document.get("camera") if isinstance(document, dict) else None
    if not isinstance(camera, dict) or "scale" not in camera:
        raise InputError(path, "holds no camera with a scale", remedy=_REMEDY)
    scale_per_m = checked_depth_scale(path, "camera.scale", camera["scale"], remedy=_REMEDY)
    return CamParams(path, scale_per_m, _intrinsics(path, camera), stated_optics(path, document))


def _intrinsics(path: Path, camera: dict[str, Any]) -> Intrinsics | None:
    lacking = [name for name in INTRINSICS if name not in camera]
    if len(lacking) == len(INTRINSICS):
        return None
    if lacking:
        problem = f"holds no {lacking[0]}, but other intrinsics"
        raise InputError(path, problem, where="camera", remedy=f"a camera has {', '.join(INTRINSICS)} and scale")
    places = tuple(f"camera.{name}" for name in INTRINSICS)
    return checked_intrinsics(path, places, tuple(camera[name] for name in INTRINSICS))


# Intrinsics from a JSON file: cam_params.json, Open3D's intrinsics, nerfstudio's transforms, or plain names.


# By the names of files: plain, with Open3D's and OpenCV's words, and nerfstudio's.
_NAMES = (("w", "h", "fx", "fy", "cx", "cy"), ("width", "height", "fx", "fy", "cx", "cy"))
_NERFSTUDIO = ("w", "h", "fl_x", "fl_y", "cx", "cy")
_HALF_PX = 0.5  # nerfstudio counts pixels from their corners, as COLMAP does
_INSIDE = ("camera", "intrinsics")
_MATRICES = ("K", "cam_K")
_CAMERA_FILE_REMEDY = "a camera has width, height, fx, fy, cx and cy"


def read_camera_file(path: Path, size_px: SizePx | None = None) -> Intrinsics:
    """Return the intrinsics that a JSON file says: fx, fy, cx and cy, a matrix K or cam_K row by row, or others' forms.

    size_px: of the images, where the file need not say it. Raises InputError where it says none, or what no camera has,
    and where it is of images of another size.
    """
    camera = _camera_of(path, size_px)
    if size_px is not None and (camera.width_px, camera.height_px) != size_px:
        problem = f"is of images of {camera.width_px} x {camera.height_px}, but these are {size_px[0]} x {size_px[1]}"
        raise InputError(path, problem, remedy="take the images that belong to it, or say intrinsics: {fx, fy, cx, cy}")
    return camera


def _camera_of(path: Path, size_px: SizePx | None) -> Intrinsics:
    document = parse_json_file(recorded_text(path), path, remedy=_CAMERA_FILE_REMEDY)
    if not isinstance(document, dict):
        raise InputError(path, "is JSON, but no mapping", remedy=_CAMERA_FILE_REMEDY)
    if isinstance(document.get("camera"), dict) and "scale" in document["camera"]:
        camera = read_cam_params_file(path).camera
        if camera is None:
            raise InputError(path, "holds a depth scale alone", where="camera", remedy=_CAMERA_FILE_REMEDY)
        return camera
    inside = next((document[name] for name in _INSIDE if isinstance(document.get(name), dict)), document)
    if size_px is not None and not {"w", "h", "width", "height"} & inside.keys():
        inside = {**inside, **dict(zip(("width", "height", "w", "h"), (*size_px, *size_px), strict=True))}
    if "intrinsic_matrix" in inside:
        return _open3d(path, inside)
    if all(name in inside for name in _NERFSTUDIO):
        found = checked_intrinsics(path, _NERFSTUDIO, tuple(inside[name] for name in _NERFSTUDIO))
        cx_px, cy_px = found.cx_px - _HALF_PX, found.cy_px - _HALF_PX
        return Intrinsics(found.width_px, found.height_px, found.fx_px, found.fy_px, cx_px, cy_px)
    for name in _MATRICES:
        if name in inside:
            matrix = matrix_in(path, inside[name], name)
            sides = ("w", "h") if "w" in inside else ("width", "height")
            names = (*sides, *(f"{name}.{at}" for at in ("fx", "fy", "cx", "cy")))
            values = (*(inside.get(side) for side in sides), *matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist())
            found = checked_intrinsics(path, names, values)
            return intrinsics_of_matrix(path, matrix, (found.width_px, found.height_px))  # and refuse skew
    for names in _NAMES:
        if all(name in inside for name in names):
            return checked_intrinsics(path, names, tuple(inside[name] for name in names))
    raise InputError(path, "says no intrinsics", remedy=_CAMERA_FILE_REMEDY)


def matrix_in(path: Path, value: Any, where: str) -> NDArray[np.float64]:
    """Return a matrix (3, 3) of JSON, row by row, flat or as rows. Raises InputError where it is none."""
    flat = (
        [each for row in value for each in (row if isinstance(row, list) else [row])] if isinstance(value, list) else []
    )
    numbers = [finite_number(each) for each in flat]
    if len(numbers) != 9 or None in numbers:
        raise InputError(path, "is no matrix of 3 x 3 numbers", where=where)
    return np.array(numbers, dtype=np.float64).reshape(3, 3)


def _open3d(path: Path, inside: dict[str, Any]) -> Intrinsics:
    """Read what Open3D's PinholeCameraIntrinsic writes: the matrix's columns, one after another."""
    matrix = inside["intrinsic_matrix"]
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise InputError(path, "is no list of nine numbers", where="intrinsic_matrix", remedy=_CAMERA_FILE_REMEDY)
    places = ("width", "height", *(f"intrinsic_matrix.{k}" for k in (0, 4, 6, 7)))
    values = (inside.get("width"), inside.get("height"), *(matrix[k] for k in (0, 4, 6, 7)))
    return checked_intrinsics(path, places, values)
