# SPDX-License-Identifier: GPL-3.0-or-later
"""Intrinsics from a JSON file: cam_params.json, Open3D's intrinsics, nerfstudio's transforms, or plain names."""

from pathlib import Path
from typing import Any

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.json_text import parse_json_file
from .cam_params import read_cam_params_file
from .stored_recording import checked_intrinsics, recorded_text

# By the names of files: plain, with Open3D's and OpenCV's words, and nerfstudio's.
_NAMES = (("w", "h", "fx", "fy", "cx", "cy"), ("width", "height", "fx", "fy", "cx", "cy"))
_NERFSTUDIO = ("w", "h", "fl_x", "fl_y", "cx", "cy")
_HALF_PX = 0.5  # nerfstudio counts pixels from their corners, as COLMAP does
_REMEDY = "a camera has width, height, fx, fy, cx and cy"


def read_camera_file(path: Path) -> Intrinsics:
    """Return the intrinsics that a JSON file says. Raises InputError where it says none, or what no camera has."""
    document = parse_json_file(recorded_text(path), path, remedy=_REMEDY)
    if not isinstance(document, dict):
        raise InputError(path, "is JSON, but no mapping", remedy=_REMEDY)
    if isinstance(document.get("camera"), dict) and "scale" in document["camera"]:
        camera = read_cam_params_file(path).camera
        if camera is None:
            raise InputError(path, "holds a depth scale alone", where="camera", remedy=_REMEDY)
        return camera
    inside = document["camera"] if isinstance(document.get("camera"), dict) else document
    if "intrinsic_matrix" in inside:
        return _open3d(path, inside)
    if all(name in inside for name in _NERFSTUDIO):
        found = checked_intrinsics(path, _NERFSTUDIO, tuple(inside[name] for name in _NERFSTUDIO))
        cx_px, cy_px = found.cx_px - _HALF_PX, found.cy_px - _HALF_PX
        return Intrinsics(found.width_px, found.height_px, found.fx_px, found.fy_px, cx_px, cy_px)
    for names in _NAMES:
        if all(name in inside for name in names):
            return checked_intrinsics(path, names, tuple(inside[name] for name in names))
    raise InputError(path, "says no intrinsics", remedy=_REMEDY)


def _open3d(path: Path, inside: dict[str, Any]) -> Intrinsics:
    """Read what Open3D's PinholeCameraIntrinsic writes: the matrix's columns, one after another."""
    matrix = inside["intrinsic_matrix"]
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise InputError(path, "is no list of nine numbers", where="intrinsic_matrix", remedy=_REMEDY)
    places = ("width", "height", *(f"intrinsic_matrix.{k}" for k in (0, 4, 6, 7)))
    values = (inside.get("width"), inside.get("height"), *(matrix[k] for k in (0, 4, 6, 7)))
    return checked_intrinsics(path, places, values)
