# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration: a body shakes as a hand, a walker, a machine does, in bands of frequency, continuously in time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...core.camera_motion import Sines
from ...core.errors import NoisyWorldError
from ...core.schema import Choice, key
from ...core.trajectory import Trajectory
from ..kinds import About, Example, MotionPerturbation, SequenceContext
from ._deviations import SPECTRA, SourceName, deviated, drawn_sines, limited


@dataclass(frozen=True)
class Vibration:
    """What shakes, and how much. Below 0 a value is the source's own."""

    source: SourceName = key(
        "what shakes the body; band: one even band of frequencies",
        default="walk",
        choices={
            "tremor": Choice("Tremor", "A hand that holds the camera: 8 to 12 Hz"),
            "walk": Choice("Walk", "The head of someone who walks: 2 steps a second"),
            "run": Choice("Run", "The head of someone who runs: 3.2 steps a second, with harmonics"),
            "trot": Choice("Trot", "A robot on four legs that trots: 4 steps a second"),
            "wheels": Choice("Wheels", "Wheels on a rough floor: 1 to 32 Hz, ever weaker"),
            "rotors": Choice("Rotors", "The rotors of a drone: around 50, 100 and 200 Hz"),
            "band": Choice("Band", "One even band of frequencies, between Low and High"),
        },
    )
    strength: float = key("what translation and rotation are multiplied by", default=1.0, minimum=0, maximum=1000)
    translation_m: float = key(
        "root mean square of the translation, below 0 the source's",
        unit="m",
        default=-1.0,
        minimum=-1,
        maximum=100,
        slider=(0, 0.2),
    )
    rotation_deg: float = key(
        "root mean square of the rotation, below 0 the source's",
        unit="deg",
        default=-1.0,
        minimum=-1,
        maximum=90,
        slider=(0, 20),
    )
    low_hz: float = key("lowest frequency, below 0 the source's", unit="Hz", default=-1.0, minimum=-1, maximum=1e4)
    high_hz: float = key("highest frequency, below 0 the source's", unit="Hz", default=-1.0, minimum=-1, maximum=1e4)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "source": "What shakes the camera",
        "strength": "Higher: the camera shakes further",
        "translation_m": "Higher: it shakes further aside; below 0: as far as the source",
        "rotation_deg": "Higher: it turns further; below 0: as far as the source",
        "low_hz": "Higher: slow movements are left out; below 0: none",
        "high_hz": "Lower: fast movements are left out; below 0: none",
    }


def signals(parameters: Vibration, context: SequenceContext) -> tuple[Sines, Sines]:
    """Draw the translation, m, and the rotation vector, rad, of a whole sequence in the body's axes.

    Raises NoisyWorldError where nothing of the source lies between low_hz and high_hz.
    """
    spectrum, band = SPECTRA[parameters.source], parameters.source == "band"
    found: list[Sines] = []
    for purpose, axes, rms, unit in (
        ("translation", spectrum.translation_m, parameters.translation_m, 1.0),
        ("rotation", spectrum.rotation_deg, parameters.rotation_deg, np.pi / 180),
    ):
        kept = tuple(limited(axis, parameters.low_hz, parameters.high_hz, open_band=band) for axis in axes)
        if not any(axis.bands for axis in kept):
            limits = f"low_hz {parameters.low_hz:g} and high_hz {parameters.high_hz:g}"
            raise NoisyWorldError(f"vibration: nothing of {parameters.source} lies between {limits}; change them")
        sines = drawn_sines(kept, rms, context.stream(purpose))
        found.append(replace(sines, amplitude=sines.amplitude * parameters.strength * unit))
    return found[0], found[1]


def highest_hz(parameters: Vibration) -> float:
    """Return the highest frequency that it shakes with; 0 for none."""
    if parameters.source == "band" and parameters.high_hz >= 0:
        return parameters.high_hz
    spectrum = SPECTRA[parameters.source]
    axes = (*spectrum.translation_m, *spectrum.rotation_deg)
    kept = (limited(axis, parameters.low_hz, parameters.high_hz).bands for axis in axes)
    return max((high for bands in kept for _, high, _ in bands), default=0.0)


def apply(trajectory: Trajectory, parameters: Vibration, context: SequenceContext) -> Trajectory:
    """Return the path of the body that shakes: sums of seeded sines, in its own axes, since the path's first stamp."""
    return deviated(trajectory, *signals(parameters, context))


PERTURBATION = MotionPerturbation(
    name="vibration",
    label="Vibration",
    order=30,
    parameters=Vibration,
    severities={"strength": (0.25, 0.5, 1.0, 2.0, 4.0)},
    source="our own; spectra as in docs/trajectories.md",
    about=About(
        "Shakes the camera as a hand, a walker or a machine does, smoothly in time",
        "the body shakes in [named bands of frequency](trajectories.md#smooth-deviations), as a walker, a "
        "hand, a machine does",
        caption="five seconds of a walker, at severities 1, 3 and 5. How far the camera goes to the right (red), down "
        "(green) and forward (blue).",
        picture="How far the camera goes over time, at severities 1, 3 and 5",
        example=Example(
            text="Vibration in the embedded room: a walker, a hand, wheels, rotors, and a band of frequencies.",
            settings=(
                "{name: walk, perturb: [{vibration: {severity: 3}}]}",
                "{name: tremor, perturb: [{vibration: {source: tremor}}]}",
                "{name: wheels, perturb: [{vibration: {source: wheels, severity: 5}}]}",
                "{name: rotors, perturb: [{vibration: {source: rotors}}]}",
                "{name: band, perturb: [{vibration: {source: band, low_hz: 5, high_hz: 15, translation_m: "
                "0.002, rotation_deg: 0.5}}]}",
            ),
        ),
    ),
    apply=apply,
    continuous=True,
    highest_hz=highest_hz,
)
