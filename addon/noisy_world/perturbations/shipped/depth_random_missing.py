# SPDX-License-Identifier: GPL-3.0-or-later
"""Random missing depth: occluded or unanswered patches."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.schema import key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import without_void

PATCH = 0.1  # of the frame's height and width, as the published toolbox


@dataclass(frozen=True)
class DepthRandomMissing:
    """Rectangles of a tenth of the height by a tenth of the width become void until they cover a share of the frame.

    They may overlap; the last one is cut to as many rows as bring the share closest. Pixels that were void before are
    counted like others. The published toolbox takes 5 to 13 rectangles, by severity: 5 to 12 % of the frame.
    """

    missing_percent: float = key("share of the frame that is covered", default=20.0, unit="%", minimum=0, maximum=90)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "missing_percent": "Higher: more and larger holes without depth",
    }


def apply(depth_m: NDArray[np.float32], parameters: DepthRandomMissing, context: FrameContext) -> NDArray[np.float32]:
    """Cut the rectangles out of (H, W) metres."""
    depth, _ = without_void(depth_m)
    depth[_patches(depth.shape, parameters.missing_percent / 100, context.pattern_stream())] = 0
    return depth


def _patches(shape: tuple[int, ...], share: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    """Return a mask (H, W) of rectangles that together cover `share` of the frame."""
    height, width = (max(round(PATCH * side), 1) for side in shape)
    covered = np.zeros(shape, np.bool_)
    missing = share * covered.size
    while missing > 0:
        top = int(generator.integers(shape[0] - height + 1))
        left = int(generator.integers(shape[1] - width + 1))
        patch = covered[top : top + height, left : left + width]
        added = np.cumsum(np.sum(~patch, axis=1))
        if added[-1] >= missing:
            rows = np.argmin(np.abs(np.concatenate([[0], added]) - missing))
            patch[:rows] = True
            break
        patch[:] = True
        missing -= int(added[-1])
    return covered


PERTURBATION = DepthPerturbation(
    name="depth_random_missing",
    label="Depth: random missing",
    order=30,
    parameters=DepthRandomMissing,
    severities={"missing_percent": (10, 15, 20, 25, 30)},
    source='paper, table "Specific configurations of the depth imaging perturbations"',
    about=About(
        "Punches rectangular holes into depth",
        "rectangles without depth",
        picture="Missing depth at severities 1, 3 and 5",
        of_paper=True,
    ),
    apply=apply,
    temporals=("fresh", "fixed"),
)
