# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge erosion: depth is lost where surfaces end, as multi-path interference does."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.schema import key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import without_void

JUMP = np.float32(0.05)  # of the nearer depth; chosen: the published toolbox finds edges by Canny on scaled depth
BLOCK_PX = 7  # as the published toolbox


@dataclass(frozen=True)
class DepthEdgeErosion:
    """Blocks of 7 x 7 pixels become void, centred on a share of the edge pixels, drawn without repetition.

    A pixel is on an edge where the depth jumps by more than 5 % of the nearer depth to one of its four neighbours, or
    that neighbour is void. The published toolbox also erases every edge pixel; here only `erase_edges` does.
    """

    rate: float = key("share of the edge pixels that lose their block", default=0.025, minimum=0, maximum=1)
    erase_edges: bool = key("erase every edge pixel as well, as the published toolbox does", default=False)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "rate": "Higher: more blocks are missing along the edges of things",
        "erase_edges": "On: the edges of all things are missing too",
    }


def apply(depth_m: NDArray[np.float32], parameters: DepthEdgeErosion, context: FrameContext) -> NDArray[np.float32]:
    """Erode (H, W) metres."""
    import cv2

    eroded, valid = without_void(depth_m)
    on_edge = _edges(eroded) & valid
    positions = np.flatnonzero(on_edge)
    chosen = context.stream().choice(positions, round(parameters.rate * positions.size), replace=False, shuffle=False)
    lost = np.zeros(eroded.shape, np.uint8)
    lost.reshape(-1)[chosen] = 1
    lost = np.asarray(cv2.dilate(lost, np.ones((BLOCK_PX, BLOCK_PX), np.uint8)), np.uint8).reshape(eroded.shape)
    if parameters.erase_edges:
        lost |= on_edge
    eroded[lost.view(np.bool_)] = 0
    return eroded


def _edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the mask (H, W) of jumps to a neighbour. Void is 0, so from void to a depth is a jump; to void is none."""
    edges = np.zeros(depth_m.shape, np.bool_)
    for before, after in (((slice(-1),), (slice(1, None),)), ((..., slice(-1)), (..., slice(1, None)))):
        nearer = np.minimum(depth_m[before], depth_m[after])
        jumps = np.maximum(depth_m[before], depth_m[after]) - nearer > JUMP * nearer
        edges[before] |= jumps
        edges[after] |= jumps
    return edges


PERTURBATION = DepthPerturbation(
    name="depth_edge_erosion",
    label="Depth: edge erosion",
    order=10,
    parameters=DepthEdgeErosion,
    severities={"rate": (0.015, 0.02, 0.025, 0.03, 0.035)},
    source='paper, table "Specific configurations of the depth imaging perturbations"',
    about=About(
        "Takes depth away in blocks along the edges of things",
        "blocks of 7 x 7 lost at edges of depth",
        picture="Eroded edges of depth at severities 1, 3 and 5",
        of_paper=True,
    ),
    apply=apply,
    temporals=("fresh",),
)
