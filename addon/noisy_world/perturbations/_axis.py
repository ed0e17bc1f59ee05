# SPDX-License-Identifier: GPL-3.0-or-later
"""The optical axis in the image, for what a lens does around it."""

from ..core.geometry import Intrinsics

HALF_PX = 0.5


def axis_by_camera(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the parameters that intrinsics decide: where the axis is, as shares of the image's sides."""
    return {
        "axis_across": (intrinsics.cx_px + HALF_PX) / intrinsics.width_px,
        "axis_down": (intrinsics.cy_px + HALF_PX) / intrinsics.height_px,
    }


def axis_px(
    intrinsics: Intrinsics | None, size_px: tuple[int, int], axis_across: float, axis_down: float
) -> tuple[float, float]:
    """Return the column and row of the axis: of the intrinsics or, where they are unknown, by shares of the size."""
    if intrinsics is not None:
        return intrinsics.cx_px, intrinsics.cy_px
    return axis_across * size_px[0] - HALF_PX, axis_down * size_px[1] - HALF_PX
