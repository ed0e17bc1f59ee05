# SPDX-License-Identifier: GPL-3.0-or-later
"""Where what was measured lies on the benchmark's severities, by the perturbations' own tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..perturbations import registry
from ..perturbations.kinds import SEVERITIES
from .figure import Figure, Place
from .looking import RecordingFigures

COMPARED_AT_M = 2.0  # at which noise of depth is compared with that of axial_noise; chosen
LEAST = 0.005  # of a severity that is spoken of
BISECTED = 50  # times, for a place between severities


@dataclass(frozen=True)
class _Scale:
    """A figure's perturbation. strength: of a figure's value. of: likewise of the perturbation's parameters."""

    figure: str
    perturbation: str
    of: Callable[[Any], float]
    strength: Callable[[float], float] = abs
    whose: str = ""


def places(found: RecordingFigures) -> tuple[Place, ...]:
    """Return where what was measured lies on the severities of the perturbations that make such.

    Between severities parameters are linear, as `Perturbation.at_severity` has them. Below 1 a place is the strength
    over severity 1's: a deviation, the inverse number of photons, a share, a length, a step of JPEG's tables.
    """
    made = [
        _place(scale, figure)
        for scale in SCALES
        if (figure := found.figures.get(scale.figure)) is not None and figure.value is not None
    ]
    names = ("depth_noise_offset_m", "depth_noise_quadratic_per_m")
    law = [figure for name in names if (figure := found.figures.get(name)) is not None and figure.value is not None]
    if len(law) == len(names):
        scale = _Scale("depth_noise", "axial_noise", lambda values: values.noise)
        made.append(_place(scale, _times_the_model(law)))
    return tuple(place for place in made if place.severity > LEAST)


def _trail_px(values: Any) -> float:
    """Return the length of the even smear whose variance a trail of motion_blur has."""
    at = np.arange(2 * values.radius_px + 1)
    weights = np.exp(-0.5 * (at / values.sigma_px) ** 2)
    weights /= weights.sum()
    return float(np.sqrt(12 * (weights @ at**2 - (weights @ at) ** 2)))


def _table_step(quality: float) -> float:
    """Return what libjpeg multiplies its tables by, of 1 at quality 50."""
    return 50 / quality if quality < 50 else 2 - quality / 50


SCALES = (
    _Scale("colour_gaussian_std", "gaussian_noise", lambda values: values.std),
    _Scale("colour_variance_per_intensity", "shot_noise", lambda values: 1 / values.photons),
    _Scale("motion_blur_px", "motion_blur", _trail_px, whose="the median of what is seen"),
    _Scale("motion_blur_most_px", "motion_blur", _trail_px, whose="one edge in twenty"),
    _Scale("exposure_ms", "camera_motion_blur", lambda values: values.shutter_ms),
    _Scale("readout_down_ms", "rolling_shutter", lambda values: values.readout_ms),
    _Scale(  # a disk spreads a point by half of its radius along an axis
        "defocus_sigma_px", "defocus_blur", lambda values: float(np.hypot(values.radius_px / 2, values.alias_sigma_px))
    ),
    _Scale("vignetting_corner_loss", "vignetting", lambda values: values.corner_loss),
    _Scale("flicker_swing_100_hz", "flicker", lambda values: values.modulation),
    _Scale("flicker_swing_120_hz", "flicker", lambda values: values.modulation),
    _Scale("jpeg_quality", "jpeg_compression", lambda values: _table_step(values.quality), strength=_table_step),
    _Scale("void_share", "depth_random_missing", lambda values: values.missing_percent / 100),
)


def _times_the_model(law: Sequence[Figure]) -> Figure:
    """Return how strong noise of depth is at COMPARED_AT_M, times that of axial_noise."""
    from ..perturbations.shipped.axial_noise import DEVICES

    model = DEVICES[registry()["axial_noise"].parameters().device]
    beyond_m = COMPARED_AT_M - model["from_m"]
    of_model = model["offset_m"] + model["linear"] * beyond_m + model["quadratic_per_m"] * beyond_m**2

    def times(*parts: float | None) -> float | None:
        offset, quadratic = parts
        return None if offset is None or quadratic is None else (offset + quadratic * COMPARED_AT_M**2) / of_model

    one, other = law
    return Figure("depth_noise", times(one.value, other.value), times(one.low, other.low), times(one.high, other.high))


def _place(scale: _Scale, figure: Figure) -> Place:
    """Return the place of a figure that is told."""
    tables = registry()[scale.perturbation].severities

    def of_severity(severity: float) -> float:
        values = {name: float(np.interp(severity, SEVERITIES, table)) for name, table in tables.items()}
        return scale.of(SimpleNamespace(**values))

    first, last = of_severity(SEVERITIES[0]), of_severity(SEVERITIES[-1])

    def severity(value: float) -> float:
        strength = scale.strength(value)
        if strength <= first:
            return max(strength / first, 0.0)
        low, high = float(SEVERITIES[0]), float(SEVERITIES[-1])
        if strength >= last:
            return high
        for _ in range(BISECTED):
            middle = (low + high) / 2
            low, high = (middle, high) if of_severity(middle) < strength else (low, middle)
        return (low + high) / 2

    assert figure.value is not None, "a figure that is told"
    ends: list[float | None] = [None, None]
    if figure.low is not None and figure.high is not None:
        beyond_0 = figure.low < 0 < figure.high
        known = [severity(end) if end * figure.value > 0 else 0.0 for end in (figure.low, figure.high)]
        ends = [0.0 if beyond_0 else min(known), max(known)]
    times = scale.strength(figure.value) / last
    return Place(scale.perturbation, severity(figure.value), ends[0], ends[1], times, scale.whose)
