# SPDX-License-Identifier: GPL-3.0-or-later
"""Deviations of a body from its path that are smooth in time: sums of sines, and single pulses."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import pose, rotation_from_rotvec
from .body_motion import BodyMotion
from .curve import Curve, motion_of
from .rotation_spline import angular_motion

Float64: TypeAlias = NDArray[np.float64]
Derivatives: TypeAlias = tuple[Float64, Float64, Float64]
"""Values (N, 3) with their first and second derivatives."""


class Signal(Protocol):
    """Three numbers at any time."""

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the numbers then, and how they change."""
        ...


@dataclass(frozen=True, eq=False)
class Sines:
    """Sums of sines. angular_hz: (3, K) rad/s. amplitude, phase: (3, K). Powers add up: amplitude^2 / 2 of each."""

    angular_hz: Float64
    amplitude: Float64
    phase: Float64

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the sums then, and how they change."""
        value, first, second = (np.zeros((len(passed_s), 3)) for _ in range(3))
        for angular, amplitude, phase in zip(self.angular_hz.T, self.amplitude.T, self.phase.T, strict=True):
            turned = passed_s[:, None] * angular + phase
            sine, cosine = amplitude * np.sin(turned), amplitude * np.cos(turned)
            value += sine
            first += angular * cosine
            second -= angular**2 * sine
        return value, first, second


@dataclass(frozen=True, eq=False)
class Pulses:
    """Single pulses peak (1 - u^2)^4 with u the time from their middle, in half lengths; 0 from u = 1 on.

    middle_s: (M,) increasing. half_s: half their length. peak: (M, 3). Three derivatives are continuous.
    """

    middle_s: Float64
    half_s: float
    peak: Float64

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the sum of the pulses then, and how it changes."""
        value, first, second = (np.zeros((len(passed_s), 3)) for _ in range(3))
        order = np.argsort(passed_s, kind="stable")
        sorted_s = passed_s[order]
        begins = np.searchsorted(sorted_s, self.middle_s - self.half_s)
        ends = np.searchsorted(sorted_s, self.middle_s + self.half_s)
        for number in np.flatnonzero(ends > begins):
            rows, middle_s, peak = order[begins[number] : ends[number]], self.middle_s[number], self.peak[number]
            u = (passed_s[rows, None] - middle_s) / self.half_s
            left = 1.0 - u**2
            value[rows] += peak * left**4
            first[rows] += peak * (-8.0 * u * left**3) / self.half_s
            second[rows] += peak * (48.0 * u**2 * left**2 - 8.0 * left**3) / self.half_s**2
        return value, first, second


@dataclass(frozen=True, eq=False)
class DeviatingCurve:
    """A curve whose body deviates: its pose, times the deviation's translation and turn in the body's own axes.

    origin_s: the signals' time 0. translation_m: metres. turn: rotation vectors, rad.
    """

    curve: Curve
    origin_s: float
    translation_m: Signal
    turn: Signal

    def deviation_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4): the deviated body's pose in the frame of the body that does not deviate."""
        asked = np.asarray(times_s, dtype=np.float64)
        passed_s = asked.ravel() - self.origin_s
        turn, translation_m = self.turn.at(passed_s)[0], self.translation_m.at(passed_s)[0]
        return pose(rotation_from_rotvec(turn), translation_m).reshape(*asked.shape, 4, 4)

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return self.curve.pose_at(times_s) @ self.deviation_at(times_s)

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the deviated body's motion then."""
        passed_s = times_s - self.origin_s
        moved = motion_of(self.curve, times_s).displaced(*self.translation_m.at(passed_s))
        turn, turn_rate, turn_change = self.turn.at(passed_s)
        return moved.turned(rotation_from_rotvec(turn), *angular_motion(turn, turn_rate, turn_change))
