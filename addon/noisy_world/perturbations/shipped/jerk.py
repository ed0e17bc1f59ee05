# SPDX-License-Identifier: GPL-3.0-or-later
"""Jerk: single shocks at seeded moments, as of a kerb, a stumble or a gust."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.camera_motion import Pulses
from ...core.schema import key
from ...core.trajectory import Trajectory
from ..kinds import About, Example, MotionPerturbation, SequenceContext
from ._deviations import deviated


@dataclass(frozen=True)
class Jerk:
    """How often shocks come, how long each lasts, and how far it throws the body; in any direction, and back."""

    per_minute: float = key("shocks a minute, on average", unit="1/min", default=20.0, minimum=0, maximum=6000)
    duration_s: float = key("length of a shock", unit="s", default=0.2, minimum=0.001, maximum=100)
    translation_m: float = key("how far a shock goes", unit="m", default=0.02, minimum=0, maximum=100)
    rotation_deg: float = key("how far a shock turns", unit="deg", default=2.0, minimum=0, maximum=90)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "per_minute": "Higher: more shocks",
        "duration_s": "Lower: shocks are shorter and harder",
        "translation_m": "Higher: a shock throws the camera further",
        "rotation_deg": "Higher: a shock turns the camera further",
    }


def moments(parameters: Jerk, last_s: float, context: SequenceContext) -> NDArray[np.float64]:
    """Draw the middles of the shocks (M,), seconds since the path's beginning: a Poisson process.

    A longer path begins with the same shocks.
    """
    if parameters.per_minute == 0:
        return np.zeros(0)
    generator, mean_s = context.stream("moments"), 60 / parameters.per_minute
    found = np.zeros(0)
    while not found.size or found[-1] < last_s:
        later = np.cumsum(generator.exponential(mean_s, 256)) + (found[-1] if found.size else 0.0)
        found = np.append(found, later)
    return found[found < last_s]


def apply(trajectory: Trajectory, parameters: Jerk, context: SequenceContext) -> Trajectory:
    """Return the path of the body that is thrown aside, in its own axes, and comes back to its path."""
    duration_s = float(trajectory.stamps_s[-1] - trajectory.stamps_s[0])
    middle_s = moments(parameters, duration_s + parameters.duration_s, context)
    signals = [
        Pulses(middle_s, parameters.duration_s / 2, size * _directions(len(middle_s), context, purpose))
        for purpose, size in (
            ("translation", parameters.translation_m),
            ("rotation", np.radians(parameters.rotation_deg)),
        )
    ]
    return deviated(trajectory, signals[0], signals[1])


def _directions(count: int, context: SequenceContext, purpose: str) -> NDArray[np.float64]:
    """Draw unit vectors (count, 3)."""
    normals = context.stream(purpose).standard_normal((count, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


PERTURBATION = MotionPerturbation(
    name="jerk",
    label="Jerk",
    order=34,
    parameters=Jerk,
    severities={"translation_m": (0.005, 0.01, 0.02, 0.04, 0.08), "rotation_deg": (0.5, 1.0, 2.0, 4.0, 8.0)},
    source="our own; severities chosen",
    about=About(
        "Throws the camera aside at single moments, as a kerb or a stumble does",
        "single shocks, and back",
        caption="five seconds with shocks.",
        picture="How far the camera goes over time, at severities 1, 3 and 5",
        example=Example(
            text="Shocks to a camera in the embedded room.",
            settings=(
                "{name: jerk1, perturb: [{jerk: {severity: 1, per_minute: 120, duration_s: 1}}]}",
                "{name: jerk3, perturb: [{jerk: {severity: 3, per_minute: 120, duration_s: 1}}]}",
                "{name: jerk5, perturb: [{jerk: {severity: 5, per_minute: 120, duration_s: 1}}]}",
            ),
        ),
    ),
    apply=apply,
    continuous=True,
)
