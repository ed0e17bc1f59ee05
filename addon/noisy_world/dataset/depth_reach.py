# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the surfaces are that a plan's frames can show, and the depth scale that holds them: `depth_range: scene`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.depth_range import scale_that_holds
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory
from ..preset.keys import CameraSpec
from ..sources.scene_kinds import Scene

SPARE = 1.01  # of the farthest distance: between two poses a path goes a little beyond both; chosen


@dataclass(frozen=True)
class DepthReach:
    """farthest_m: no surface of any frame is farther. scene: the one in which it is so far. of: what says so."""

    farthest_m: float
    scene: str
    of: str

    @property
    def scale_per_m(self) -> float:
        """The largest of 1, 2, 5, 10, ... steps per metre at which 16 bits hold that."""
        return scale_that_holds(self.farthest_m)

    @property
    def note(self) -> str:
        """What is to be said of it in a plan."""
        made = f"depth_scale_per_m {self.scale_per_m:g}, a step {1000 / self.scale_per_m:.3g} mm"
        return f"depth_range: scene makes {made}: no depth is beyond {self.farthest_m:.4g} m, {self.of} ({self.scene})"


def depth_reach(
    scene: Scene, path: Trajectory, mount_m: float, camera: CameraSpec | None, place: ConfigPath
) -> DepthReach:
    """Return the farthest that frames of a scene can see: by the mesh around their path, and by the far plane.

    path: of the camera, with its deviation. mount_m: how far the camera that measures depth is from it. camera: as the
    preset gives it. place: of `depth_range`. Raises InputError for a scene of which nothing is known before it is read.
    """
    capabilities, read_mesh = scene.source.capabilities, scene.source.mesh
    if not capabilities.rendered:
        remedy = "give depth_scale_per_m, which a recording's own files say"
        raise place.error(f"is scene, but {scene.name} is a recording, whose frames are not looked at before", remedy)
    far_m = (camera or CameraSpec).far_m if capabilities.own is None else capabilities.own.far_m
    by_plane = DepthReach(far_m, scene.name, "the camera's far plane")
    if read_mesh is None:
        return by_plane
    around_m = SPARE * farthest_m(read_mesh().vertices_m, path.c2w[:, :3, 3]) + mount_m
    return min(by_plane, DepthReach(around_m, scene.name, "the mesh's farthest corner"), key=lambda one: one.farthest_m)


def farthest_m(vertices_m: NDArray[np.float64], positions_m: NDArray[np.float64]) -> float:
    """Return a distance that no vertex (V, 3) exceeds from any position (N, 3): that to its box's farthest corner."""
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    farther = np.maximum(np.abs(positions_m - low), np.abs(positions_m - high))
    return float(np.linalg.norm(farther, axis=1).max())
