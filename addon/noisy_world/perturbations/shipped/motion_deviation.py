# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion deviation: a robot shakes, so its camera is not exactly where the path says."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import rotation_from_euler_deg
from ...core.schema import key
from ...core.trajectory import Trajectory
from ..kinds import About, Example, MotionPerturbation, SequenceContext


@dataclass(frozen=True)
class MotionDeviation:
    """Standard deviations of a normal deviation, drawn independently for each pose; 0 does not change poses."""

    rotation_deg: float = key(
        "standard deviation, each camera axis", unit="deg", default=3.0, minimum=0, maximum=180, slider=(0, 20)
    )
    translation_m: float = key(
        "standard deviation, each world axis", unit="m", default=0.025, minimum=0, maximum=100, slider=(0, 0.2)
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "rotation_deg": "Higher: the camera shakes more; at 20 degrees it looks elsewhere in each frame",
        "translation_m": "Higher: the camera jumps further off its path",
    }


def drawn(count: int, parameters: MotionDeviation, context: SequenceContext) -> dict[str, NDArray[np.float64]]:
    """Return what is drawn for each pose, each from its own frame's stream.

    rotation_deg: (count, 3) about the camera's x, y and z. translation_m: (count, 3) along the world's axes.
    """
    normals = np.array([context.stream(frame=k).standard_normal(6) for k in range(count)])
    return {
        "rotation_deg": parameters.rotation_deg * normals[:, :3],
        "translation_m": parameters.translation_m * normals[:, 3:],
    }


def apply(trajectory: Trajectory, parameters: MotionDeviation, context: SequenceContext) -> Trajectory:
    """Return the deviated trajectory, which is the ground truth of what is rendered from it.

    R' = R dR with dR = Rz Ry Rx about the camera's axes, t' = t + dt along the world's (paper, section "Robot motion").
    Rotations are composed as matrices in float64, never by adding angles.
    """
    found = drawn(len(trajectory), parameters, context)
    c2w = trajectory.c2w.copy()
    if parameters.rotation_deg:
        c2w[:, :3, :3] @= rotation_from_euler_deg(*found["rotation_deg"].T)
    c2w[:, :3, 3] += found["translation_m"]
    return replace(trajectory, c2w=c2w)


PERTURBATION = MotionPerturbation(
    name="motion_deviation",
    label="Motion deviation",
    order=10,
    parameters=MotionDeviation,
    severities={},
    source='paper, section "Benchmark Statistics": {0, 1, 3, 5} degrees, {0, 0.0125, 0.025, 0.05} m',
    about=About(
        law="the camera deviates from the path; frames are rendered from the deviated path, which is the ground truth",
        caption="the camera leaves its path, here by 1, 3 and 5 degrees and 1.25, 2.5 and 5 cm. Each frame is laid "
        "over that of the planned path.",
        picture="Frames of the deviated camera over frames of the planned path",
        of_paper=True,
        example=Example(
            text="Motion deviation in the embedded room, as the paper has it.",
            settings=(
                "{name: rotation_3deg, perturb: [{motion_deviation: {rotation_deg: 3, translation_m: 0}}]}",
                "{name: translation_25mm, perturb: [{motion_deviation: {rotation_deg: 0, translation_m: 0.025}}]}",
                "{name: both, perturb: [{motion_deviation: {rotation_deg: 3, translation_m: 0.025}}]}",
            ),
        ),
    ),
    apply=apply,
    drawn=drawn,
)
