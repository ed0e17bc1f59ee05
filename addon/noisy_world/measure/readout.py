# SPDX-License-Identifier: GPL-3.0-or-later
"""How long a rolling shutter takes to read a frame, by images alone.

Lines that are read one after another see the scene one after another. Where the camera's motion changes from frame to
frame, features in the upper lines then move by another way than those in the lower ones, as if each line had frames of
its own, a part of the interval later. The motion in between is that of a spline through what the frames themselves say.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ..core.curve import NaturalSpline
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float64
from .motion import Followed, Steps, beside, projected, tukey

# Chosen, as all below.
ITERATIONS = 4  # of Gauss and Newton's method, ended where one changes less than NEARLY an error
NEARLY = 0.1
HOPELESS = 2.0  # times the greatest error that is told: no further iteration makes up for it
LEAST_STEPS = 16
LEAST_PX = 0.05  # standard deviation of where a feature is found
LEAST_SHARE = 0.12  # of the interval between frames: standard error of a readout that is not told
REWEIGHTED = 4
ALIKE = 1.4  # times the error by blocks of frames, as what is seen stays the same for many
FOLLOWED_SHARE = 0.015  # of the interval: error by how features are followed, found on known readouts

NAMES = "readout_down_ms", "readout_right_ms"
"""What a frame's rows take to be read from top to bottom, and its columns from left to right, in milliseconds.

Below 0 they are read from below, or from the right. `readout_ms` of `rolling_shutter` is their absolute value.
"""


_Equations: TypeAlias = tuple[Float64, Float64]
"""Of a step, with its rigid motion taken out: (2, 2) and (2,) of the normal equations of both readouts."""
_Told: TypeAlias = tuple[Followed, int, NaturalSpline]
"""What tells of a step, the number of its first frame, and the motion around it."""


def readout(steps: Steps, rate_hz: float | None) -> tuple[Figure, ...]:
    """Return how long reading a frame takes along rows and along columns."""
    if rate_hz is None:
        return tuple(Figure.none(name, "there is one frame alone") for name in NAMES)
    known = np.isfinite(steps.move).all(axis=1) & ~beside(steps.same, steps.run)
    told = [
        (followed, int(steps.frames[step, 0]), spline)
        for part in _parts(steps, known)
        for step, spline in _inner(steps, part)
        if (followed := steps.followed[step]) is not None
    ]
    if len(told) < LEAST_STEPS:
        why = "too few frames in a row show features that move"
        return tuple(Figure.none(name, why) for name in NAMES)
    first = [_equations(*each, np.zeros(2)) for each in told]
    # A sensor is read along one of both: that which explains more.
    along = int(np.argmax([_right(first)[axis] ** 2 / _normal(first)[axis, axis] for axis in (0, 1)]))
    figure = _along(along, told, first, 1e3 / rate_hz)
    if figure.value is not None and figure.sure_beyond(0.0):
        why = f"lines are read along the other direction, as {NAMES[along]} says"
        other = Figure.none(NAMES[1 - along], why)
    else:
        other = _along(1 - along, told, first, 1e3 / rate_hz)
    return (figure, other) if along == 0 else (other, figure)


def _along(axis: int, told: Sequence[_Told], equations: Sequence[_Equations], interval_ms: float) -> Figure:
    """Return the readout along one axis: 0 down, 1 right. equations: of a readout of 0."""
    share = np.zeros(2)
    error = _error(equations, axis)
    for _ in range(ITERATIONS):
        if error > HOPELESS * LEAST_SHARE:
            break
        lacking = _lacking(equations, axis)
        share[axis] = np.clip(share[axis] + lacking, -1.0, 1.0)
        equations = [_equations(*each, share) for each in told]
        error = _error(equations, axis)
        if abs(lacking) < NEARLY * error:
            break
    if not error < LEAST_SHARE:
        return Figure.none(NAMES[axis], "the camera's motion changes too little from frame to frame")
    value = float(np.clip(share[axis] + _lacking(equations, axis), -1.0, 1.0))
    return Figure.within(NAMES[axis], interval_ms * value, interval_ms * error, len(told), "steps")


def _error(equations: Sequence[_Equations], axis: int) -> float:
    """Return the standard error of a readout, of the interval, that equations tell."""
    groups = blocks_of(len(equations))
    kept = [[one for one, group in zip(equations, groups, strict=True) if group != block] for block in range(BLOCKS)]
    left_out = np.array([_lacking(part, axis) for part in kept])
    return math.hypot(ALIKE * jackknifed(left_out), _normal(equations)[axis, axis] ** -0.5, FOLLOWED_SHARE)


def _parts(steps: Steps, known: np.ndarray) -> list[np.ndarray]:
    """Return rows of steps that follow one another in a run and are all known."""
    rows = np.flatnonzero(known)
    apart = (np.diff(rows) != 1) | (np.diff(steps.run[rows]) != 0)
    return [part for part in np.split(rows, np.flatnonzero(apart) + 1) if len(part) >= 5]


def _inner(steps: Steps, part: np.ndarray) -> list[tuple[int, NaturalSpline]]:
    """Return the steps of a part but those at its ends, each with the motion since the step's first frame."""
    whole = np.concatenate([np.zeros((1, 6)), np.cumsum(steps.move[part], axis=0)])
    spline = NaturalSpline(steps.frames[part[0], 0] + np.arange(len(whole), dtype=np.float64), whole)
    return [(step, spline) for step in part[1:-1].tolist()]


def _equations(found: Followed, frame: int, spline: NaturalSpline, share: Float64) -> _Equations:
    """Return the equations of what both readouts, of the interval, lack. frame: the first of both."""
    rays = np.concatenate([found.here, np.ones((len(found.here), 1))], axis=1)
    inverse = np.zeros(len(rays)) if found.inverse is None else found.inverse
    places = found.places[..., ::-1]  # down, right
    later = places @ share
    moved = spline.at(frame + 1 + later[1]) - spline.at(frame + later[0])
    rates = [spline.derivatives_at(frame + side + later[side])[0] for side in (0, 1)]
    turned = _turned(moved[:, :3], rays)
    at, slopes = projected(turned, inverse, turned + inverse[:, None] * moved[:, 3:])
    off_px, slopes = found.focal_px * (found.there - at), found.focal_px * slopes
    by_share = rates[1][:, :, None] * places[1][:, None, :] - rates[0][:, :, None] * places[0][:, None, :]
    slopes = np.concatenate([slopes, slopes @ by_share], axis=2).reshape(-1, 8)
    off = off_px.ravel()
    weight, left = np.ones(len(off)), off
    for _ in range(REWEIGHTED):
        weighted = slopes * weight[:, None]
        normal = weighted.T @ slopes + 1e-9 * np.eye(8)
        left = off - slopes @ np.linalg.solve(normal, weighted.T @ off)
        left = np.linalg.norm(left.reshape(-1, 2), axis=1)
        weight = np.repeat(tukey(left, LEAST_PX), 2)
    weighted = slopes * weight[:, None]
    normal, right = weighted.T @ slopes + 1e-9 * np.eye(8), weighted.T @ off
    taken = normal[6:, :6] @ np.linalg.inv(normal[:6, :6])
    variance = max(float(np.average(left**2, weights=weight[::2])), LEAST_PX**2)
    return (normal[6:, 6:] - taken @ normal[:6, 6:]) / variance, (right[6:] - taken @ right[:6]) / variance


def _turned(turns_rad: Float64, rays: Float64) -> Float64:
    """Return rays (N, 3), each by its own rotation vector (N, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(turns_rad, axis=1, keepdims=True)
    once = np.cross(turns_rad, rays)
    return rays + np.sinc(angle / np.pi) * once + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * np.cross(turns_rad, once)


def _lacking(equations: Sequence[_Equations], axis: int) -> float:
    return float(_right(equations)[axis] / _normal(equations)[axis, axis])


def _right(equations: Sequence[_Equations]) -> Float64:
    return sum((each[1] for each in equations), np.zeros(2))


def _normal(equations: Sequence[_Equations]) -> Float64:
    return sum((each[0] for each in equations), 1e-6 * np.eye(2))
