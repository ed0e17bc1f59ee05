# SPDX-License-Identifier: GPL-3.0-or-later
"""cam_params.json: the intrinsics and the depth scale of a setting, as the successors of NICE-SLAM read them."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...geometry import Intrinsics
from ...optics import DISTORTION, PINHOLE, Optics
from ..json_text import parse_given_json
from ..stored import checked_depth_scale, checked_intrinsics, recorded_text
from .stated_optics import stated_optics

CAM_PARAMS = "cam_params.json"
INTRINSICS = ("w", "h", "fx", "fy", "cx", "cy")

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
    document = parse_given_json(recorded_text(path), path, remedy=_REMEDY)
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
