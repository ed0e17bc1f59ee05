# SPDX-License-Identifier: GPL-3.0-or-later
"""Water drops on the front glass: each a small lens that shows the scene upside down, dark at its rim."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ..core.perturbing.about import About, Example
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ._drop_laws import LensDrops
from ._drop_nodes import build_drops
from ._drops import seen_through
from ._view import by_camera


def apply(rgb: NDArray[np.float32], parameters: LensDrops, context: FrameContext) -> NDArray[np.float32]:
    """Look at (H, W, 3) through drops."""
    return seen_through(rgb, parameters, context)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Draw the drops on a smaller image, blur them, and lay them over the frame."""
    return build_drops(canvas, given)


PERTURBATION = ColourPerturbation(
    name="lens_drops",
    label="Lens drops",
    stage="lens",
    order=60,
    parameters=LensDrops,
    severities={
        "coverage": (0.04, 0.08, 0.14, 0.21, 0.3),
        "runs": (0.05, 0.15, 0.25, 0.35, 0.45),
    },
    source="our own: from the first drops to a lens in the rain",
    about=About(
        "Puts drops of water on the front glass, which show the scene upside down, run and dry",
        "drops of water on the front glass, which refract, run and dry",
        caption="drops on the front glass that show the scene upside down.",
        example=Example(
            said="Drops on the lens in the embedded room, which run and dry, clean and at severities 1, 3 and 5."
        ),
    ),
    apply=apply,
    build=build,
    lit_by_nodes=True,
    linear=True,
    by_camera=by_camera,
    temporals=("drift", "fixed", "fresh"),
)
