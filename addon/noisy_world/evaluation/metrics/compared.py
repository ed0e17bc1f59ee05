# SPDX-License-Identifier: GPL-3.0-or-later
"""An estimate that lies over the truth: what every metric of a trajectory is computed from."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.trajectories.trajectory import Trajectory
from ..association import Rows
from .alignment import Conditioning, Similarity, least_squares_alignment, stands_still
from .errors import (
    ErrorStatistics,
    Pairs,
    consecutive_pairs,
    pairs_apart,
    path_length_m,
    position_errors_m,
    relative_errors,
    rotation_errors_deg,
    spread_of,
    travelled_m,
)
from .protocols import Protocol

Float64: TypeAlias = NDArray[np.float64]
Delta: TypeAlias = Literal["1frame", "1s", "1m"]


@dataclass(frozen=True, eq=False)
class Compared:
    """The poses of an estimate that belong to frames of the truth.

    estimate: (P, 4, 4) float64, camera-to-world, laid over the truth by `by`; in its own world where the run failed.
    truth: the true path of all N frames that the system was given. frames: (P,) rows of the truth, increasing: which
    frame each pose belongs to. protocol: how it was laid over the truth. by: with what; None where the run failed.
    failure: "", or why the run has no errors. by_poses: what lays the cameras' rotations, and a map, over the truth: it
    is `by` where the positions decide the rotation, else full poses do. conditioning: how well the path does.
    """

    estimate: Float64
    truth: Trajectory
    frames: Rows
    protocol: Protocol
    by: Similarity | None = None
    failure: str = ""
    by_poses: Similarity | None = None
    conditioning: Conditioning | None = None

    @cached_property
    def true(self) -> Float64:
        """(P, 4, 4): the true poses of the same frames."""
        return self.truth.c2w[self.frames]

    @cached_property
    def tracked(self) -> NDArray[np.bool_]:
        """(N,): which frames of the truth have a pose."""
        found = np.zeros(len(self.truth), dtype=bool)
        found[self.frames] = True
        return found

    @property
    def tracked_share(self) -> float:
        """The share of the true frames that have a pose."""
        return float(self.tracked.mean())

    @cached_property
    def position_errors_m(self) -> Float64:
        """(P,): the distances of estimated and true positions; (0,) where the run failed."""
        return np.zeros(0) if self.failure else position_errors_m(self.estimate, self.true)

    @cached_property
    def rotation_errors_deg(self) -> Float64:
        """(P,): the angles between estimated rotations, laid by `by_poses`, and true ones; (0,) if the run failed."""
        if self.by is None or self.by_poses is None:
            return np.zeros(0)
        if self.by_poses is self.by:
            return rotation_errors_deg(self.estimate, self.true)
        laid = np.array(self.estimate)
        laid[:, :3, :3] = (self.by_poses.rotation @ self.by.rotation.T) @ laid[:, :3, :3]
        return rotation_errors_deg(laid, self.true)

    @cached_property
    def position(self) -> ErrorStatistics:
        """Statistics of the distances, of a run that did not fail."""
        return spread_of(self.position_errors_m)

    @cached_property
    def rotation(self) -> ErrorStatistics:
        """Statistics of the angles, of a run that did not fail."""
        return spread_of(self.rotation_errors_deg)

    @property
    def ate_m(self) -> float | None:
        """The RMSE of the positions; None where the run failed."""
        return None if self.failure else self.position.rmse

    @property
    def still(self) -> bool:
        """Whether the estimate or the truth stands still, so that no scale can be found."""
        return stands_still(self.estimate[:, :3, 3]) or stands_still(self.true[:, :3, 3])

    @cached_property
    def remaining_scale(self) -> float:
        """The scale that Sim(3) alignment finds beside that of the protocol's; nothing may stand still."""
        return least_squares_alignment(self.estimate[:, :3, 3], self.true[:, :3, 3], with_scale=True).scale

    @property
    def path_share(self) -> float | None:
        """The length of the estimated path over that of the whole true path; None where that is 0."""
        whole_m = path_length_m(self.truth.c2w[:, :3, 3])
        return path_length_m(self.estimate[:, :3, 3]) / whole_m if whole_m > 0.0 else None

    def relative(self, pairs: Pairs) -> tuple[Float64, Float64]:
        """Return the relative errors, metres and degrees, of those pairs (K, 2) of true frames that both have a pose.

        None of either where the run failed.
        """
        if self.failure:
            return np.zeros(0), np.zeros(0)
        row_of = np.full(len(self.truth), -1)
        row_of[self.frames] = np.arange(len(self.frames))
        both = row_of[pairs]
        return relative_errors(self.estimate, self.true, both[(both >= 0).all(axis=1)])

    @cached_property
    def motions(self) -> "dict[Delta, Motions]":
        """The relative errors from frame to frame, over one second, and over one metre of the true path.

        The pairs are those of the truth, so they are the same for every system.
        """
        stamps_s = self.truth.stamps_s
        frame_s = float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else 0.0
        pairs: dict[Delta, Pairs] = {
            "1frame": consecutive_pairs(len(stamps_s)),
            "1s": pairs_apart(stamps_s - stamps_s[0], 1.0, frame_s / 2),
            "1m": pairs_apart(travelled_m(self.truth.c2w[:, :3, 3]), 1.0, 0.1),
        }
        return {name: Motions(len(chosen), *self.relative(chosen)) for name, chosen in pairs.items()}


@dataclass(frozen=True, eq=False)
class Motions:
    """Relative errors over pairs of frames. true: how many pairs the truth has. errors_m, errors_deg: (K,)."""

    true: int
    errors_m: Float64
    errors_deg: Float64
