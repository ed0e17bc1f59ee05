# SPDX-License-Identifier: GPL-3.0-or-later
"""A measured figure: a value with its interval and the number of samples, or why it cannot be told here."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCKS = 8  # that are left out in turn, for an error that neighbours' likeness does not make too small
WITHIN = 2.365  # Student's t of 7 degrees of freedom: 95 %


@dataclass(frozen=True)
class Figure:
    """What was measured of a recording.

    name: snake case, with the unit at its end where it has one. value: None where it cannot be told, and untold says
    why. low, high: its 95 % interval. samples: of what it was measured on, which `of` names, such as "frames".
    curve, at: the curve that it is a point of, and where; two recordings' are compared where both have points.
    """

    name: str
    value: float | None
    low: float | None = None
    high: float | None = None
    samples: int = 0
    of: str = "frames"
    untold: str = ""
    curve: str = ""
    at: float | None = None

    @classmethod
    def exact(cls, name: str, value: float, samples: int, of: str = "frames") -> "Figure":
        """Return a figure that was counted, not estimated."""
        return cls(name, value, value, value, samples, of)

    @classmethod
    def within(cls, name: str, value: float, error: float, samples: int, of: str = "frames") -> "Figure":
        """Return an estimate with its standard error, by BLOCKS blocks; without interval where that is not finite."""
        if not np.isfinite(error):
            return cls(name, value, None, None, samples, of)
        return cls(name, value, value - WITHIN * error, value + WITHIN * error, samples, of)

    @classmethod
    def none(cls, name: str, untold: str) -> "Figure":
        """Return a figure that cannot be told here, because of what `untold` says."""
        return cls(name, None, untold=untold)

    def on(self, curve: str, at: float) -> "Figure":
        """Return it as a point of a curve: at an intensity, a distance in metres, a lag in pixels."""
        return replace(self, curve=curve, at=at)

    @property
    def half_width(self) -> float:
        """Half of the interval; infinite where there is none."""
        return (self.high - self.low) / 2 if self.low is not None and self.high is not None else np.inf

    def plus(self, more: float) -> "Figure":
        """Return it with a number added; itself where it cannot be told."""
        if self.value is None or self.low is None or self.high is None:
            return self
        return replace(self, value=self.value + more, low=self.low + more, high=self.high + more)

    @property
    def exponential(self) -> "Figure":
        """Return that of which this is the natural logarithm; itself where it cannot be told."""
        value, low, high = (None if each is None else float(np.exp(each)) for each in (self.value, self.low, self.high))
        return replace(self, value=value, low=low, high=high)

    def sure_beyond(self, limit: float) -> bool:
        """Tell whether the whole interval is farther from 0 than a limit, on one side."""
        if self.low is None or self.high is None:
            return False
        return self.low > limit or self.high < -limit

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        if self.value is None:
            return {"name": self.name, "value": None, "cannot_be_told_here_because": self.untold}
        values = {"value": self.value, "low": self.low, "high": self.high}
        on = {"curve": self.curve, "at": self.at} if self.curve else {}
        return {"name": self.name, **values, "samples": self.samples, "of": self.of, **on}


@dataclass(frozen=True)
class Place:
    """Where a figure lies on a perturbation's severities. times: its strength over severity 5's, where it is beyond.

    whose: of what, where there are several of a perturbation.
    """

    perturbation: str
    severity: float
    low: float | None
    high: float | None
    times: float
    whose: str = ""

    def __str__(self) -> str:
        whose = f", {self.whose}" if self.whose else ""
        if self.times > 1:
            return f"{self.perturbation} beyond 5, {self.times:.2g} times its strength{whose}"
        within = ""
        if self.low is not None and self.high is not None and self.low != self.high:
            within = f" ({self.low:.2g} to {self.high:.2g})"
        return f"{self.perturbation} {self.severity:.2g}{within}{whose}"

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        values: dict[str, Any] = {"perturbation": self.perturbation, "severity": self.severity}
        values |= {"low": self.low, "high": self.high, "times_severity_5": max(self.times, 1.0)}
        return values | ({"whose": self.whose} if self.whose else {})


def blocks_of(count: int) -> NDArray[np.int64]:
    """Return (count,): which of BLOCKS blocks each of a row of samples is in."""
    return np.minimum(np.arange(count) * BLOCKS // max(count, 1), BLOCKS - 1)


def jackknifed(left_out: NDArray[np.float64]) -> float:
    """Return the standard error of an estimate, of its values with each block left out in turn (Tukey's jackknife)."""
    count = len(left_out)
    return float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))
