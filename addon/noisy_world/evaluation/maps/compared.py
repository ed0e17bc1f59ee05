# SPDX-License-Identifier: GPL-3.0-or-later
"""A map that lies in the true world, beside the truth: what every metric of a map is computed from."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import rotation_angle_rad
from ...core.scenes.mesh import Mesh
from .culling import MARGIN_M
from .distances import to_points, tree_of
from .icp import lay
from .renders import Compare, Rendered, compare_renders
from .truth import SeenSurface, TrueMap, seen_surface

ICP_SAMPLES = 20_000
FEWEST_POINTS = 3  # that can be laid over others

Distances: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class PaperDistances:
    """Distances (N,) and (M,) between points drawn on the map and on the truth, after ICP: the paper's code.

    shift_m, turn_deg: by how much ICP moved the map's middle, and turned it.
    """

    accuracy_m: Distances
    completion_m: Distances
    shift_m: float
    turn_deg: float


@dataclass(frozen=True, eq=False)
class ComparedMap:
    """A map and the truth; what is derived of both is computed once, when a metric asks for it.

    map: None where there is none. lpips: how alike two images are, where it is given.
    """

    map: Mesh | None
    truth: TrueMap
    lpips: Compare | None = None

    @cached_property
    def part(self) -> SeenSurface | None:
        """The part of the map that true cameras saw; None where nothing of it was, and without a map."""
        truth = self.truth
        if self.map is None:
            return None
        return seen_surface(self.map, truth.seen, MARGIN_M, truth.sample_count, "map", truth.seed)

    @cached_property
    def accuracy_m(self) -> Distances | None:
        """(N,) from points on the map's surface to the true surface; None where one of both is missing."""
        if self.part is None or self.truth.part is None:
            return None
        return self.truth.part.surface.distances_m(self.part.samples.points_m)

    @cached_property
    def completion_m(self) -> Distances | None:
        """(N,) from points on the true surface to the map's; None where one of both is missing."""
        if self.part is None or self.truth.part is None:
            return None
        return self.part.surface.distances_m(self.truth.points_m)

    @cached_property
    def paper(self) -> PaperDistances | None:
        """Distances after ICP; None where there are too few points for it."""
        if self.part is None or self.truth.part is None:
            return None
        points_m, truth_m = self.part.samples.points_m, self.truth.points_m
        if min(len(points_m), len(truth_m)) < FEWEST_POINTS:
            return None
        by = lay(points_m[:ICP_SAMPLES], truth_m).truth_from_map
        moved_m = points_m @ by[:3, :3].T + by[:3, 3]
        middle_m = points_m.mean(axis=0)
        return PaperDistances(
            to_points(moved_m, tree_of(truth_m))[0],
            to_points(truth_m, tree_of(moved_m))[0],
            float(np.linalg.norm(by[:3, :3] @ middle_m + by[:3, 3] - middle_m)),
            float(np.degrees(rotation_angle_rad(np.eye(3), by[:3, :3]))),
        )

    @cached_property
    def rendered(self) -> Rendered | None:
        """What true cameras see of the map and of the truth; None without a surface."""
        if self.map is None or not len(self.map.face_starts):
            return None
        return compare_renders(self.map, self.truth.views, lpips=self.lpips)
