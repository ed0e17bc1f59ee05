# SPDX-License-Identifier: GPL-3.0-or-later
"""What the author of a package imports that brings perturbations or metrics.

    from noisy_world.extend import DepthPerturbation, FrameContext, key

Each is one file with a `PERTURBATION` or a `METRIC`; an installed package brings it by an entry point of the group
`noisy_world.perturbations` or `noisy_world.metrics`. docs/extend.md has an example of every kind, and
`noisy_world.testing` tests whether one keeps its contract. Importing this needs no Blender.
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
from .evaluation.metrics import Compared, TrajectoryMetric

__all__ = [
    "Canvas",
    "ColourPerturbation",
    "Compared",
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
    "TrajectoryMetric",
    "key",
]
