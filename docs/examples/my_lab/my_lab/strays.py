# SPDX-License-Identifier: GPL-3.0-or-later
"""The farthest that a map strays from the true surface."""

from noisy_world.extend import ComparedMap, MapMetric


def compute(compared: ComparedMap) -> float | None:
    """Return the largest distance; None without a map or without a truth."""
    return None if compared.accuracy_m is None else float(compared.accuracy_m.max())


METRIC = MapMetric(
    "accuracy_max_m", "accuracy, max", "m", "lower", "the largest distance to the true surface.", compute
)
