# SPDX-License-Identifier: GPL-3.0-or-later
"""How far an estimate errs along the world's z."""

import numpy as np

from noisy_world.extend import Compared, TrajectoryMetric


def compute(compared: Compared) -> float | None:
    """Return the largest distance along z."""
    return float(np.abs(compared.estimate[:, 2, 3] - compared.true[:, 2, 3]).max())


METRIC = TrajectoryMetric(
    "upward_max_m", "largest error upwards", "m", "lower", "the largest distance along the world's z.", compute
)
