# SPDX-License-Identifier: GPL-3.0-or-later
"""The public names for authors of packages that bring perturbations, layouts, channels, sources, metrics, subcommands.

    from noisy_world.extend import DepthPerturbation, FrameContext, key

Each is one file with a `PERTURBATION`, a `SOURCE`, a `LAYOUT`, a `FORMAT` of trajectories, a `CHANNEL`, a `METRIC`, a
`CAMERA` or a `COMMAND`; an installed package brings it by an entry point of the group `noisy_world.perturbations`,
`noisy_world.sources`, `noisy_world.layouts`, `noisy_world.trajectory_formats`, `noisy_world.channels`,
`noisy_world.metrics`, `noisy_world.map_metrics`, `noisy_world.cameras` or `noisy_world.commands`. docs/extend.md has
examples, and `noisy_world.testing` tells whether one keeps its contract. Importing this needs no Blender.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .channels.channel import PairChannel, Surface, SurfaceChannel, View
    from .cli.command import Command
    from .cli.entry import Entry
    from .core.errors import InputError
    from .core.frame_request import FrameRequest, Shutter
    from .core.geometry import Intrinsics
    from .core.lens import PINHOLE, Optics
    from .core.node_graph import Graph, Socket
    from .core.schema import key
    from .core.trajectory import FrameStamps, Trajectory
    from .evaluate.map_metrics import ComparedMap, MapMetric
    from .evaluate.metrics import Compared, TrajectoryMetric
    from .layouts.cam_params import CAM_PARAMS, cam_params_text, read_cam_params
    from .layouts.described import (
        DepthFilesSpec,
        DescribedLayout,
        ImageFilesSpec,
        IntrinsicsSpec,
        PoseFilesSpec,
        SequenceSpec,
        StampFilesSpec,
        Told,
    )
    from .layouts.layout import Layout, RecordedLayout, SequenceFacts, lines, numbered
    from .layouts.numbered import (
        Cameras,
        ImageFiles,
        NumberedLayout,
        NumberedPoses,
        folder_of_poses,
        numbered_frames,
        numbered_images,
    )
    from .layouts.stored_recording import MatchedFrames, PosePolicy, StoredSequence, read_frame_times, truth_file
    from .layouts.with_reader import LayoutWithReader
    from .perturbations.groups import Canvas
    from .perturbations.kinds import (
        About,
        Automatic,
        ColourPerturbation,
        DepthPerturbation,
        ExposurePerturbation,
        FrameContext,
        MotionPerturbation,
        Nodes,
        PairingPerturbation,
        SequenceContext,
    )
    from .preset.camera_devices import CameraDevice
    from .preset.scene_keys import SceneKeys
    from .render.source import ComputedSource, RenderedFrame, SimpleSource, SourceCapabilities
    from .sources.scene_kinds import SceneEntry, SingleSceneKind
    from .trajectories.formats import read_trajectory
    from .trajectories.pose_files import FilePoses, PoseFile, ReadOptions, TrajectoryFormat
    from .trajectories.stamped_poses import tum_text

__all__ = [
    "CAM_PARAMS",
    "PINHOLE",
    "About",
    "Automatic",
    "CameraDevice",
    "Cameras",
    "Canvas",
    "ColourPerturbation",
    "Command",
    "Compared",
    "ComparedMap",
    "ComputedSource",
    "DepthFilesSpec",
    "DepthPerturbation",
    "DescribedLayout",
    "Entry",
    "ExposurePerturbation",
    "FilePoses",
    "FrameContext",
    "FrameRequest",
    "FrameStamps",
    "Graph",
    "ImageFiles",
    "ImageFilesSpec",
    "InputError",
    "Intrinsics",
    "IntrinsicsSpec",
    "Layout",
    "LayoutWithReader",
    "MapMetric",
    "MatchedFrames",
    "MotionPerturbation",
    "Nodes",
    "NumberedLayout",
    "NumberedPoses",
    "Optics",
    "PairChannel",
    "PairingPerturbation",
    "PoseFile",
    "PoseFilesSpec",
    "PosePolicy",
    "ReadOptions",
    "RecordedLayout",
    "RenderedFrame",
    "SceneEntry",
    "SceneKeys",
    "SequenceContext",
    "SequenceFacts",
    "SequenceSpec",
    "Shutter",
    "SimpleSource",
    "SingleSceneKind",
    "Socket",
    "SourceCapabilities",
    "StampFilesSpec",
    "StoredSequence",
    "Surface",
    "SurfaceChannel",
    "Told",
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

_NAMES = {
    "channels.channel": "PairChannel Surface SurfaceChannel View",
    "cli.command": "Command",
    "cli.entry": "Entry",
    "core.errors": "InputError",
    "core.frame_request": "FrameRequest Shutter",
    "core.geometry": "Intrinsics",
    "core.lens": "Optics PINHOLE",
    "core.node_graph": "Graph Socket",
    "core.schema": "key",
    "core.trajectory": "FrameStamps Trajectory",
    "evaluate.map_metrics": "ComparedMap MapMetric",
    "evaluate.metrics": "Compared TrajectoryMetric",
    "layouts.cam_params": "CAM_PARAMS cam_params_text read_cam_params",
    "layouts.described": "DepthFilesSpec DescribedLayout ImageFilesSpec IntrinsicsSpec PoseFilesSpec SequenceSpec "
    "StampFilesSpec Told",
    "layouts.layout": "Layout RecordedLayout SequenceFacts lines numbered",
    "layouts.numbered": "Cameras ImageFiles NumberedLayout NumberedPoses folder_of_poses "
    "numbered_frames numbered_images",
    "layouts.with_reader": "LayoutWithReader",
    "layouts.stored_recording": "MatchedFrames PosePolicy StoredSequence read_frame_times truth_file",
    "perturbations.groups": "Canvas",
    "perturbations.kinds": "About Automatic ColourPerturbation DepthPerturbation ExposurePerturbation "
    "FrameContext MotionPerturbation Nodes PairingPerturbation SequenceContext",
    "preset.camera_devices": "CameraDevice",
    "preset.scene_keys": "SceneKeys",
    "render.source": "ComputedSource RenderedFrame SimpleSource SourceCapabilities",
    "sources.scene_kinds": "SceneEntry SingleSceneKind",
    "trajectories.formats": "read_trajectory",
    "trajectories.pose_files": "FilePoses PoseFile ReadOptions TrajectoryFormat",
    "trajectories.stamped_poses": "tum_text",
}
"""The names by the modules that have them, each of which is imported when one of its names is."""

_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Return a name of a module of ours: a package may be looked for while that of another name is being imported."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__package__}.{_HOMES[name]}"), name)
