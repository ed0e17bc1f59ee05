# SPDX-License-Identifier: GPL-3.0-or-later
"""Intrinsics stated in a trajectory file, compared with the camera that is rendered."""

import math
from dataclasses import dataclass

from ..geometry import Intrinsics

# Principal points are half a pixel apart between the two conventions of where a pixel's centre is. Chosen beside it.
_TOLERANCE_PX = 0.51
_TOLERANCE_RAD = 1e-3


@dataclass(frozen=True)
class StatedCamera:
    """What a file says of its camera; None where it says nothing.

    angle_x_rad: the horizontal field of view. varies: whether frames differ. distorts: whether its lens does.
    """

    width_px: float | None = None
    height_px: float | None = None
    fx_px: float | None = None
    fy_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    angle_x_rad: float | None = None
    varies: bool = False
    distorts: bool = False

    def difference(self, camera: Intrinsics) -> str:
        """Return a sentence where this is not the camera, "" where it is."""
        names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
        said = {name: value for name in names if (value := getattr(self, name)) is not None}
        parts = [
            f"{name.removesuffix('_px')} {value:g} (the preset's: {getattr(camera, name):g})"
            for name, value in said.items()
            if not abs(value - getattr(camera, name)) <= _TOLERANCE_PX
        ]
        angle_rad = 2.0 * math.atan(camera.width_px / (2.0 * camera.fx_px))
        stated_rad = self.angle_x_rad if self.fx_px is None else None
        if stated_rad is not None and not abs(stated_rad - angle_rad) <= _TOLERANCE_RAD:
            shown = [f"{math.degrees(value):.4g}" for value in (stated_rad, angle_rad)]
            parts.append(f"a view of {shown[0]} degrees (the preset's: {shown[1]})")
        if self.varies:
            parts.append("intrinsics that vary from frame to frame")
        if self.distorts:
            parts.append("a lens that distorts")
        return f"states another camera, {', '.join(parts)}; the preset's camera is used" if parts else ""
