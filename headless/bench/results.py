# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's measurements, and the spread of a figure over several turns."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Spread:
    """A figure from several turns: the median, and the distance from the least to the largest divided by it."""

    median: float
    relative: float
    turns: int

    def text(self, unit: str = "") -> str:
        """Return the figure as text: `0.283 s ± 4 %`."""
        return "-" if not self.turns else f"{self.median:.3g}{unit} ± {100 * self.relative:.0f} %"


def spread(values: Sequence[float]) -> Spread:
    """Summarise turns."""
    if not values:
        return Spread(float("nan"), float("nan"), 0)
    low, median, high = np.quantile(values, [0, 0.5, 1])
    return Spread(float(median), float((high - low) / median), len(values))


def spread_of_ratios(values: Sequence[float], others: Sequence[float]) -> Spread:
    """Summarise the ratios of neighbouring turns."""
    return spread([a / b for a, b in zip(values, others, strict=False)])


@dataclass
class Row:
    """A row of the table, for one engine at one number of samples; times in seconds, memory in bytes.

    rays_per_px: of colour, the mean.
    """

    engine: str
    samples: int
    rays_per_px: float
    frame_s: Spread
    times_embree: Spread
    first_frame_s: float
    loading_s: float
    peak_bytes: int
    rgb: dict[str, float]
    analytic: dict[str, dict[str, float]]
    cast: dict[str, float]


@dataclass
class Results:
    """Everything measured; report.json holds all of it."""

    machine: dict[str, Any]
    rows: list[Row] = field(default_factory=list)
    others: list[dict[str, Any]] = field(default_factory=list)
    million: dict[str, Any] = field(default_factory=dict)
    needs: list[dict[str, Any]] = field(default_factory=list)
    hard_cases: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
