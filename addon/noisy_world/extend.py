# SPDX-License-Identifier: GPL-3.0-or-later
"""What an author of perturbations imports: the five kinds, their contexts, and what node groups are built with.

    from noisy_world.extend import DepthPerturbation, FrameContext, key

A perturbation is one file with a `PERTURBATION`; an installed package brings it by an entry point of the group
`noisy_world.perturbations`. docs/your_perturbation.md has a whole example. Importing this needs no Blender.
"""

from .core.geometry import Intrinsics
from .core.node_graphs.graph import Graph, Socket
from .core.node_graphs.groups import Canvas
from .core.perturbing.kinds import (
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    MotionPerturbation,
    PairingPerturbation,
    SequenceContext,
)
from .core.schema import key
from .core.trajectories.frame_request import Shutter
from .core.trajectories.trajectory import Trajectory

__all__ = [
    "Canvas",
    "ColourPerturbation",
    "DepthPerturbation",
    "ExposurePerturbation",
    "FrameContext",
    "Graph",
    "Intrinsics",
    "MotionPerturbation",
    "PairingPerturbation",
    "SequenceContext",
    "Shutter",
    "Socket",
    "Trajectory",
    "key",
]
