# SPDX-License-Identifier: GPL-3.0-or-later
"""What the author of a package imports that brings perturbations, layouts, channels or metrics.

    from noisy_world.extend import DepthPerturbation, FrameContext, key

Each is one file with a `PERTURBATION`, a `LAYOUT`, a `CHANNEL` or a `METRIC`; an installed package brings it by an
entry point of the group `noisy_world.perturbations`, `noisy_world.layouts`, `noisy_world.channels` or
`noisy_world.metrics`. docs/extend.md and docs/layouts.md have an example of every kind, and `noisy_world.testing` tells
whether a perturbation, a layout or a metric keeps its contract. Importing this needs no Blender.
"""

from .core.channels.surface import Surface, SurfaceChannel
from .core.datasets.frame_times import read_frame_times
from .core.datasets.known_poses import PosePolicy, truth_file
from .core.datasets.layouts.cam_params import CAM_PARAMS, cam_params_text, read_cam_params
from .core.datasets.layouts.layout import Layout, SequenceFacts, lines, numbered
from .core.datasets.layouts.numbered import NumberedPoses, folder_of_poses, numbered_frames, numbered_images
from .core.datasets.layouts.recorded import RecordedLayout
from .core.datasets.stored import StoredSequence
from .core.errors import InputError
from .core.geometry import Intrinsics
from .core.node_graphs.graph import Graph, Socket
from .core.node_graphs.groups import Canvas
from .core.optics import PINHOLE, Optics
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
from .core.trajectories.files import read_trajectory, tum_text
from .core.trajectories.frame_request import Shutter
from .core.trajectories.stamps import FrameStamps
from .core.trajectories.trajectory import Trajectory
from .evaluation.metrics import Compared, TrajectoryMetric

__all__ = [
    "CAM_PARAMS",
    "PINHOLE",
    "Canvas",
    "ColourPerturbation",
    "Compared",
    "DepthPerturbation",
    "ExposurePerturbation",
    "FrameContext",
    "FrameStamps",
    "Graph",
    "InputError",
    "Intrinsics",
    "Layout",
    "MotionPerturbation",
    "NumberedPoses",
    "Optics",
    "PairingPerturbation",
    "PosePolicy",
    "RecordedLayout",
    "SequenceContext",
    "SequenceFacts",
    "Shutter",
    "Socket",
    "StoredSequence",
    "Surface",
    "SurfaceChannel",
    "Trajectory",
    "TrajectoryMetric",
    "cam_params_text",
    "folder_of_poses",
    "key",
    "lines",
    "numbered",
    "numbered_frames",
    "numbered_images",
    "read_cam_params",
    "read_frame_times",
    "read_trajectory",
    "truth_file",
    "tum_text",
]
