# SPDX-License-Identifier: GPL-3.0-or-later
"""Fuses the frames of a path to a map."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.scenes.mesh import Mesh
from .volume import MOST_BLOCKS, ColourVolume

VOXEL_M = 0.02
FAR_M = 10.0


class SeenFrame(Protocol):
    """A frame: colour (H, W, 3) uint8 RGB, planar depth (H, W) in metres with 0 = void."""

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Depth."""
        ...


@dataclass(frozen=True)
class Fused:
    """A map that was fused.

    mesh: None where no frame saw anything. voxel_m: the edge of its voxels, more than was asked for where those would
    have taken too much memory. frames: how many were fused. excluded: how many have a pose, but one that is kilometres
    away from the first.
    """

    mesh: Mesh | None
    voxel_m: float
    frames: int
    excluded: int = 0


def fuse(
    frames: Iterable[SeenFrame],
    poses: Iterable[NDArray[np.float64] | None],
    camera: Intrinsics,
    *,
    voxel_m: float = VOXEL_M,
    far_m: float = FAR_M,
    most_blocks: int = MOST_BLOCKS,
    stopped: Callable[[], bool] = lambda: False,
) -> Fused:
    """Fuse frames along a path; a frame whose pose is None is left out, and its images are not read.

    poses: (4, 4) camera-to-world of each frame, OpenCV axes. far_m: depth beyond is left out. most_blocks: bounds the
    memory (12 kB each). stopped: asked before each frame. Colour and depth are taken as seen from one pose.
    Raises ValueError where frames and poses differ in number, or a frame is not of the camera's size.
    """
    volume = ColourVolume(camera, voxel_m, most_blocks=most_blocks)
    count, excluded = 0, 0
    for frame, c2w in zip(frames, poses, strict=True):
        if stopped():
            break
        if c2w is not None:
            pose = np.asarray(c2w, dtype=np.float64)
            within = volume.integrate(frame.depth_m, pose, frame.rgb, far_m=far_m)
            count, excluded = count + within, excluded + (not within)
    return Fused(volume.surface(), volume.voxel_m, count, excluded)
