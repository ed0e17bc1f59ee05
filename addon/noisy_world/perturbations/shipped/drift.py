# SPDX-License-Identifier: GPL-3.0-or-later
"""Drift: a rig that is badly fastened or calibrated is slowly somewhere else than where its path says."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core.schema import key
from ...core.trajectory import Trajectory
from ..kinds import About, Example, MotionPerturbation, SequenceContext
from ._deviations import AxisSpectrum, deviated, drawn_sines, falling


@dataclass(frozen=True)
class Drift:
    """How far a body drifts, and how slowly."""

    rotation_deg: float = key("root mean square of the rotation", unit="deg", default=1.0, minimum=0, maximum=90)
    translation_m: float = key("root mean square of the translation", unit="m", default=0.02, minimum=0, maximum=100)
    period_s: float = key(
        "the shortest period; the longest is ten times that", unit="s", default=10.0, above=0, maximum=1e5
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "rotation_deg": "Higher: the camera leans further",
        "translation_m": "Higher: the camera shifts further",
        "period_s": "Higher: it drifts more slowly",
    }


def apply(trajectory: Trajectory, parameters: Drift, context: SequenceContext) -> Trajectory:
    """Return the path of the body that drifts, in its own axes; power falls as the square of the frequency."""
    bands = falling(0.1 / parameters.period_s, 1 / parameters.period_s, 3)
    axes = (AxisSpectrum(1.0, bands),) * 3
    translation_m = drawn_sines(axes, parameters.translation_m, context.stream("translation"))
    turn = drawn_sines(axes, np.radians(parameters.rotation_deg), context.stream("rotation"))
    return deviated(trajectory, translation_m, turn)


PERTURBATION = MotionPerturbation(
    name="drift",
    label="Drift",
    order=32,
    parameters=Drift,
    severities={"rotation_deg": (0.25, 0.5, 1.0, 2.0, 4.0), "translation_m": (0.005, 0.01, 0.02, 0.04, 0.08)},
    source="our own; severities chosen",
    about=About(
        "Lets the camera slowly lean and shift away from its path, as a loose mount does",
        "the body is slowly somewhere else than its path says",
        caption="five seconds of a mount that gives way.",
        picture="How far the camera goes over time, at severities 1, 3 and 5",
        example=Example(
            text="A camera in the embedded room that drifts from its path.",
            settings=(
                "{name: drift1, perturb: [{drift: {severity: 1}}]}",
                "{name: drift3, perturb: [{drift: {severity: 3}}]}",
                "{name: drift5, perturb: [{drift: {severity: 5}}]}",
            ),
        ),
    ),
    apply=apply,
    continuous=True,
)
