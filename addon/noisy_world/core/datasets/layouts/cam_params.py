# SPDX-License-Identifier: GPL-3.0-or-later
"""cam_params.json: the intrinsics and the depth scale of a setting, as the successors of NICE-SLAM read them."""

import json
from pathlib import Path

from ...errors import InputError
from ...geometry import Intrinsics

CAM_PARAMS = "cam_params.json"


def cam_params_text(camera: Intrinsics, depth_scale_per_m: float) -> str:
    """Return the content of the file."""
    values = {
        "w": camera.width_px,
        "h": camera.height_px,
        "fx": float(camera.fx_px),
        "fy": float(camera.fy_px),
        "cx": float(camera.cx_px),
        "cy": float(camera.cy_px),
        "scale": float(depth_scale_per_m),
    }
    return json.dumps({"camera": values}, indent=2) + "\n"


def read_depth_scale(folder: Path) -> float | None:
    """Return the depth scale, steps a metre, of a sequence's cam_params.json; None where there is no such file.

    It lies in the folder above the sequence's; where it does not, in the sequence's own. Raises InputError.
    """
    for place in (folder.parent, folder):
        path = place / CAM_PARAMS
        if path.is_file():
            try:
                scale = float(json.loads(path.read_text(encoding="utf-8"))["camera"]["scale"])
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise InputError(path, "holds no camera with a scale", remedy="mend or remove it") from error
            if not 0 < scale < float("inf"):
                raise InputError(path, f"its scale is {scale}, but has to be above 0", remedy="mend or remove it")
            return scale
    return None
