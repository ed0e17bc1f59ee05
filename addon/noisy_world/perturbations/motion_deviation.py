# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion deviation: a robot shakes, so its camera is not exactly where the path says."""

from dataclasses import dataclass

import numpy as np

from ..core.geometry import rotation_from_euler_deg
from ..core.perturbing.kinds import MotionPerturbation, SequenceContext
from ..core.schema import key
from ..core.trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class MotionDeviation:
    """Standard deviations of a normal deviation, drawn independently for each pose; 0 does not change poses."""

    rotation_deg: float = key("standard deviation, each camera axis", unit="deg", default=3.0, minimum=0, maximum=180)
    translation_m: float = key("standard deviation, each world axis", unit="m", default=0.025, minimum=0, maximum=100)


def apply(trajectory: Trajectory, parameters: MotionDeviation, context: SequenceContext) -> Trajectory:
    """Return the deviated trajectory, which is the ground truth of what is rendered from it.

    R' = R dR with dR = Rz Ry Rx about the camera's axes, t' = t + dt along the world's (paper, section "Robot motion").
    Rotations are composed as matrices in float64, never by adding angles. Each pose draws from its own frame's stream.
    """
    normals = np.array([context.stream(frame=k).standard_normal(6) for k in range(len(trajectory))])
    c2w = trajectory.c2w.copy()
    if parameters.rotation_deg:
        c2w[:, :3, :3] @= rotation_from_euler_deg(*(parameters.rotation_deg * normals[:, :3].T))
    c2w[:, :3, 3] += parameters.translation_m * normals[:, 3:]
    return Trajectory(c2w, trajectory.stamps_s)


PERTURBATION = MotionPerturbation(
    name="motion_deviation",
    label="Motion deviation",
    order=10,
    parameters=MotionDeviation,
    severities={},
    source='paper, section "Benchmark Statistics": {0, 1, 3, 5} degrees, {0, 0.0125, 0.025, 0.05} m',
    apply=apply,
)
