# SPDX-License-Identifier: GPL-3.0-or-later
"""What the runs of systems say together: intervals, tests, correlations, indicators, a prediction of failure."""

from .indicators import INDICATORS, Indicators, indicators_of
from .sequences_table import depth_distribution, motion_distribution
from .tables import CAPTIONS, analyse

__all__ = [
    "CAPTIONS",
    "INDICATORS",
    "Indicators",
    "analyse",
    "depth_distribution",
    "indicators_of",
    "motion_distribution",
]
