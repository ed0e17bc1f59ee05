# SPDX-License-Identifier: GPL-3.0-or-later
"""The public names for authors of packages that bring perturbations, layouts, channels, sources, metrics, subcommands.

    from noisy_world.extend import DepthPerturbation, FrameContext, key

Each is one file with a `PERTURBATION`, a `SOURCE`, a `LAYOUT`, a `FORMAT` of trajectories, a `CHANNEL`, a `METRIC` or a
`COMMAND`; an installed package brings it by an entry point of the group `noisy_world.perturbations`,
`noisy_world.sources`, `noisy_world.layouts`, `noisy_world.trajectory_formats`, `noisy_world.channels`,
`noisy_world.metrics`, `noisy_world.map_metrics` or `noisy_world.commands`. docs/extend.md has examples, and
`noisy_world.testing` tells whether one keeps its contract. Importing this needs no Blender.
"""

from .cli.command import Command
from .cli.entry import Entry
from .core.channels.pair import PairChannel, View
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
from .core.perturbing.about import About
from .core.perturbing.kinds import (
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    MotionPerturbation,
    PairingPerturbation,
    SequenceContext,
)
from .core.planning.scene import SceneEntry, SingleSceneKind
from .core.planning.simple_source import ComputedSource, SimpleSource
from .core.planning.source import RenderedFrame, SourceCapabilities
from .core.presets.scene_keys import SceneKeys
from .core.schema import key
from .core.trajectories.files import read_trajectory
from .core.trajectories.frame_request import FrameRequest, Shutter
from .core.trajectories.pose_text import FilePoses, PoseFile, ReadOptions, TrajectoryFormat
from .core.trajectories.stamped_poses import tum_text
from .core.trajectories.stamps import FrameStamps
from .core.trajectories.trajectory import Trajectory
from .evaluation.maps.names import ComparedMap, MapMetric
from .evaluation.metrics import Compared, TrajectoryMetric

__all__ = [
    "CAM_PARAMS",
    "PINHOLE",
    "About",
    "Canvas",
    "ColourPerturbation",
    "Command",
    "Compared",
    "ComparedMap",
    "ComputedSource",
    "DepthPerturbation",
    "Entry",
    "ExposurePerturbation",
    "FilePoses",
    "FrameContext",
    "FrameRequest",
    "FrameStamps",
    "Graph",
    "InputError",
    "Intrinsics",
    "Layout",
    "MapMetric",
    "MotionPerturbation",
    "NumberedPoses",
    "Optics",
    "PairChannel",
    "PairingPerturbation",
    "PoseFile",
    "PosePolicy",
    "ReadOptions",
    "RecordedLayout",
    "RenderedFrame",
    "SceneEntry",
    "SceneKeys",
    "SequenceContext",
    "SequenceFacts",
    "Shutter",
    "SimpleSource",
    "SingleSceneKind",
    "Socket",
    "SourceCapabilities",
    "StoredSequence",
    "Surface",
    "SurfaceChannel",
    "Trajectory",
    "TrajectoryFormat",
    "TrajectoryMetric",
    "View",
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
