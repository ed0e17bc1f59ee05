# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths that deviate smoothly, with a spectrum.

Named spectra of vibration: for each axis of a body how far it goes, and which bands of frequency hold the power.

Axes are those of a path's poses: x right, y down, z forward; turns are pitch about x, yaw about y, roll about z. What
is written as guess was not measured. Sources: trot: a simulated quadruped of ours. walk, run: rates of steps and
harmonics as a survey of head motion has them, amplitudes guessed. wheels: the power of a rough floor falls as the
square of the frequency (ISO 8608), the size guessed. tremor: 8 to 12 Hz, the size guessed. rotors: guess.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from ...core.camera_motion import DeviatingCurve, Signal, Sines
from ...core.trajectory import Trajectory

SourceName: TypeAlias = Literal["tremor", "walk", "run", "trot", "wheels", "rotors", "band"]
Band: TypeAlias = tuple[float, float, float]
"""From, to (Hz), and the share of the power that is spread evenly between."""

LINES = 32  # sines in each band of an axis, chosen: their sum is nearly normal
_LEAST_HZ = 1e-6


@dataclass(frozen=True)
class AxisSpectrum:
    """How one axis vibrates. rms: metres, or degrees. bands: their shares add up to 1."""

    rms: float
    bands: tuple[Band, ...]


@dataclass(frozen=True)
class Spectrum:
    """How a body vibrates: translation along x, y and z, m, and turns about them, deg."""

    translation_m: tuple[AxisSpectrum, AxisSpectrum, AxisSpectrum]
    rotation_deg: tuple[AxisSpectrum, AxisSpectrum, AxisSpectrum]


def falling(low_hz: float, high_hz: float, octaves: int) -> tuple[Band, ...]:
    """Return bands of equal ratio whose power falls as the square of the frequency."""
    edges = np.geomspace(low_hz, high_hz, octaves + 1)
    power = 1 / edges[:-1] - 1 / edges[1:]
    return tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), (power / power.sum()).tolist(), strict=True))


_SHAKE: tuple[Band, ...] = ((2.0, 8.0, 0.2), (8.0, 12.0, 0.8))
_STRIDE: tuple[Band, ...] = ((0.9, 1.1, 1.0),)
_STEP: tuple[Band, ...] = ((1.8, 2.2, 0.97), (3.6, 4.4, 0.028), (5.4, 6.6, 0.002))
_RUN_STRIDE: tuple[Band, ...] = ((1.5, 1.7, 1.0),)
_RUN_STEP: tuple[Band, ...] = ((3.0, 3.4, 0.989), (6.0, 6.8, 0.01), (9.0, 10.2, 9e-4), (12.0, 20.0, 1e-4))
_TROT_STRIDE: tuple[Band, ...] = ((1.9, 2.1, 0.9), (3.8, 4.2, 0.1))
_TROT_STEP: tuple[Band, ...] = ((3.8, 4.2, 0.8), (7.6, 8.4, 0.15), (11.0, 20.0, 0.05))
_FLOOR = falling(1.0, 32.0, 5)
_ROTOR: tuple[Band, ...] = ((45.0, 55.0, 0.1), (90.0, 110.0, 0.6), (180.0, 220.0, 0.3))
_OPEN_M = AxisSpectrum(0.001 / 3**0.5, ((0.5, 20.0, 1.0),))
_OPEN_DEG = AxisSpectrum(0.1 / 3**0.5, ((0.5, 20.0, 1.0),))

SPECTRA: Mapping[SourceName, Spectrum] = {
    "tremor": Spectrum(
        (AxisSpectrum(1e-4, _SHAKE), AxisSpectrum(1e-4, _SHAKE), AxisSpectrum(5e-5, _SHAKE)),
        (AxisSpectrum(0.03, _SHAKE), AxisSpectrum(0.03, _SHAKE), AxisSpectrum(0.02, _SHAKE)),
    ),
    "walk": Spectrum(
        (AxisSpectrum(0.01, _STRIDE), AxisSpectrum(0.02, _STEP), AxisSpectrum(0.007, _STEP)),
        (AxisSpectrum(1.0, _STEP), AxisSpectrum(0.5, _STRIDE), AxisSpectrum(0.5, _STRIDE)),
    ),
    "run": Spectrum(
        (AxisSpectrum(0.015, _RUN_STRIDE), AxisSpectrum(0.03, _RUN_STEP), AxisSpectrum(0.01, _RUN_STEP)),
        (AxisSpectrum(1.5, _RUN_STEP), AxisSpectrum(1.0, _RUN_STRIDE), AxisSpectrum(0.8, _RUN_STRIDE)),
    ),
    "trot": Spectrum(
        (AxisSpectrum(0.003, _TROT_STRIDE), AxisSpectrum(0.004, _TROT_STEP), AxisSpectrum(0.002, _TROT_STEP)),
        (AxisSpectrum(0.22, _TROT_STEP), AxisSpectrum(0.2, _TROT_STRIDE), AxisSpectrum(0.66, _TROT_STRIDE)),
    ),
    "wheels": Spectrum(
        (AxisSpectrum(1e-4, _FLOOR), AxisSpectrum(5e-4, _FLOOR), AxisSpectrum(1e-4, _FLOOR)),
        (AxisSpectrum(0.1, _FLOOR), AxisSpectrum(0.02, _FLOOR), AxisSpectrum(0.1, _FLOOR)),
    ),
    "rotors": Spectrum(
        (AxisSpectrum(7e-6, _ROTOR), AxisSpectrum(1e-5, _ROTOR), AxisSpectrum(7e-6, _ROTOR)),
        (AxisSpectrum(0.006, _ROTOR), AxisSpectrum(0.003, _ROTOR), AxisSpectrum(0.006, _ROTOR)),
    ),
    "band": Spectrum((_OPEN_M, _OPEN_M, _OPEN_M), (_OPEN_DEG, _OPEN_DEG, _OPEN_DEG)),
}


def limited(axis: AxisSpectrum, low_hz: float, high_hz: float, *, open_band: bool = False) -> AxisSpectrum:
    """Return an axis's spectrum between two frequencies, below 0 its own; rms as it was.

    open_band: the one band goes where the limits are; else bands are cut, and what is left keeps its density.
    """
    low = axis.bands[0][0] if low_hz < 0 else max(low_hz, _LEAST_HZ)
    high = axis.bands[-1][1] if high_hz < 0 else high_hz
    if open_band:
        return AxisSpectrum(axis.rms, ((low, high, 1.0),)) if low < high else AxisSpectrum(axis.rms, ())
    cut = [(max(low, a), min(high, b), share / (b - a)) for a, b, share in axis.bands]
    left = [(a, b, density * (b - a)) for a, b, density in cut if a < b]
    whole = sum(share for *_, share in left)
    return AxisSpectrum(axis.rms, tuple((a, b, share / whole) for a, b, share in left))


def drawn_sines(axes: tuple[AxisSpectrum, ...], rms: float, generator: np.random.Generator) -> Sines:
    """Draw sums of sines with these spectra. rms: of all axes together, in the signal's unit, < 0 for their own.

    Each band has LINES sines of equal power, one at a random place in each of LINES equal parts of it.
    """
    own = sum(axis.rms**2 for axis in axes if axis.bands) ** 0.5
    scale = 0.0 if own == 0.0 else (1.0 if rms < 0 else rms / own)
    most = max(1, *(LINES * len(axis.bands) for axis in axes))
    place, phase = generator.random((2, 3, most))
    angular_hz, amplitude = np.zeros((3, most)), np.zeros((3, most))
    for row, axis in enumerate(axes):
        for number, (low_hz, high_hz, share) in enumerate(axis.bands):
            part = slice(LINES * number, LINES * (number + 1))
            between = (np.arange(LINES) + place[row, part]) / LINES
            angular_hz[row, part] = 2 * np.pi * (low_hz + between * (high_hz - low_hz))
            amplitude[row, part] = scale * axis.rms * (2 * share / LINES) ** 0.5
    return Sines(angular_hz, amplitude, 2 * np.pi * phase)


# Paths of bodies that deviate smoothly.


def deviated(trajectory: Trajectory, translation_m: Signal, turn: Signal) -> Trajectory:
    """Return a path whose body deviates in its own axes: metres and rotation vectors, since the first stamp.

    Poses that are independent of one another deviate alike, and stay so.
    """
    curve = DeviatingCurve(trajectory.continuous, float(trajectory.stamps_s[0]), translation_m, turn)
    c2w = trajectory.c2w @ curve.deviation_at(trajectory.stamps_s)
    return replace(trajectory, c2w=c2w, curve=None if trajectory.independent else curve)
