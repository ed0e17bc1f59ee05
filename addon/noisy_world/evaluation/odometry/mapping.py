# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of a run: the keyframes' colour and depth, fused along their poses."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.scenes.mesh import Mesh
from ...core.scenes.ply_writer import write_ply
from ..maps.fusing import VOXEL_M, fuse
from .frames import Depth, FrameEntry, FrameIndex, read_colour, read_depth
from .smoothing import smoothed
from .written import FrameResult

MAP = "map.ply"


@dataclass(frozen=True)
class MapFrame:
    """A keyframe as a map is fused from: its images are read when they are asked for."""

    entry: FrameEntry
    camera: Intrinsics
    scale_per_m: float
    smooth: bool

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB."""
        return np.ascontiguousarray(read_colour(self.entry, self.camera)[..., ::-1])

    @property
    def depth_m(self) -> Depth:
        """Depth (H, W) in metres, 0 where void, smoothed as it is for tracking."""
        depth_m = read_depth(self.entry, self.camera, self.scale_per_m)
        return np.nan_to_num(smoothed(depth_m) if self.smooth else depth_m)


def fused_map(
    index: FrameIndex,
    keyframes: Sequence[FrameResult],
    *,
    smooth: bool = True,
    voxel_m: float = VOXEL_M,
    stopped: Callable[[], bool] = lambda: False,
) -> Mesh | None:
    """Return the surface that the keyframes saw, None where they saw nothing."""
    entries = {entry.index: entry for entry in index.frames}
    camera = index.intrinsics
    kept = [frame for frame in keyframes if frame.c2w is not None]

    def frames() -> Iterator[MapFrame]:
        for frame in kept:
            yield MapFrame(entries[frame.index], camera, index.depth_scale_per_m, smooth)

    return fuse(frames(), [frame.c2w for frame in kept], camera, voxel_m=voxel_m, stopped=stopped).mesh


def write_map(folder: Path, mesh: Mesh) -> None:
    """Write the map into a run's folder. Raises StorageError where that cannot be."""
    write_ply(folder / MAP, mesh, triangulate=True)
