# SPDX-License-Identifier: GPL-3.0-or-later
"""Metrics of trajectories: how far an estimate is from the truth, and how much of it there is."""

from .alignment import Alignment, Similarity
from .compared import Compared
from .frame_errors import FrameErrors, frame_errors_text
from .metric import Metric, TrajectoryMetric
from .names import METRICS, PAPER_METRICS, PAPER_PREFIX, metrics_of
from .protocols import PROTOCOLS, Protocol, paper_protocol
from .robustness import Rate, corruption_error, resilience_rate

__all__ = [
    "METRICS",
    "PAPER_METRICS",
    "PAPER_PREFIX",
    "PROTOCOLS",
    "Alignment",
    "Compared",
    "FrameErrors",
    "Metric",
    "Protocol",
    "Rate",
    "Similarity",
    "TrajectoryMetric",
    "corruption_error",
    "frame_errors_text",
    "metrics_of",
    "paper_protocol",
    "resilience_rate",
]
