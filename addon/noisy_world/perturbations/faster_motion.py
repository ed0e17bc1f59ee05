# SPDX-License-Identifier: GPL-3.0-or-later
"""Faster motion: the same path at several times the speed."""

from dataclasses import dataclass

from ..core.perturbing.kinds import Frame, Perturbation
from ..core.schema import key
from ..core.trajectories.trajectory import Trajectory, subsample


@dataclass(frozen=True)
class FasterMotion:
    """How much faster; the frames between are left out."""

    factor: int = key("how many times as fast the camera goes", default=2, minimum=1, maximum=1000)


def apply(trajectory: Trajectory, parameters: FasterMotion, _frame: Frame) -> Trajectory:
    """Return every factor-th pose from the first on, at the stamps of a sequence of that length.

    The camera's rate is what it was (decisions: "time stamps re-spaced at the sequence's rate").
    """
    kept = subsample(trajectory, every=parameters.factor)
    return Trajectory(kept.c2w, trajectory.stamps_s[: len(kept)])


PERTURBATION = Perturbation(
    name="faster_motion",
    label="Faster motion",
    category="motion",
    parameters=FasterMotion,
    severities={},
    source='paper, section "Benchmark Statistics": factors 2, 4 and 8',
    apply=apply,
)
