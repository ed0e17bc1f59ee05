# SPDX-License-Identifier: GPL-3.0-or-later
"""Range clipping: a sensor sees nothing too near or too far."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.schema import key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import without_void


@dataclass(frozen=True)
class DepthRangeClipping:
    """Depth outside [min_m, max_m] becomes void; the ends belong to the range."""

    min_m: float = key("nearest depth that is seen", default=0.4, unit="m", minimum=0, maximum=1000)
    max_m: float = key("farthest depth that is seen", default=4.0, unit="m", minimum=0, maximum=1000)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "min_m": "Higher: more of what is near has no depth",
        "max_m": "Lower: more of what is far has no depth",
    }


def apply(depth_m: NDArray[np.float32], parameters: DepthRangeClipping, _context: FrameContext) -> NDArray[np.float32]:
    """Clip (H, W) metres."""
    depth, _ = without_void(depth_m)
    depth[(depth < np.float32(parameters.min_m)) | (depth > np.float32(parameters.max_m))] = 0
    return depth


PERTURBATION = DepthPerturbation(
    name="depth_range_clipping",
    label="Depth: range clipping",
    order=40,
    parameters=DepthRangeClipping,
    severities={"min_m": (0.2, 0.3, 0.4, 0.5, 0.6), "max_m": (4.4, 4.2, 4.0, 3.8, 3.6)},
    source='paper, table "Specific configurations of the depth imaging perturbations"',
    about=About(
        "Takes depth away that is too near or too far",
        "void outside a range of depth",
        picture="Clipped depth at severities 1, 3 and 5",
        of_paper=True,
    ),
    apply=apply,
)
