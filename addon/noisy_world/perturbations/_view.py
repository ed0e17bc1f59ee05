# SPDX-License-Identifier: GPL-3.0-or-later
"""The field of view, for weather whose camera may be unknown."""

import math

from ..core.geometry import Intrinsics


def by_camera(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the parameter that intrinsics decide: the field of view."""
    return {"view_deg": math.degrees(2 * math.atan(intrinsics.width_px / 2 / intrinsics.fx_px))}


def camera_of(intrinsics: Intrinsics | None, size_px: tuple[int, int], view_deg: float) -> Intrinsics:
    """Return the intrinsics or, where they are unknown, those of a field of view. size_px: width, height."""
    if intrinsics is not None:
        return intrinsics
    width, height = size_px
    focal = width / 2 / math.tan(math.radians(view_deg / 2))
    return Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
