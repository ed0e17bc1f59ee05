# SPDX-License-Identifier: GPL-3.0-or-later
"""Metrics of trajectories: how far an estimate is from the truth, and how much of it there is."""

from .alignment import Alignment, Similarity
from .frame_errors import FrameErrors, frame_errors_text
from .names import METRICS, PAPER_METRICS, PAPER_PREFIX, Metric
from .protocols import PROTOCOLS, Protocol, metrics_of, paper_protocol
from .robustness import Rate, corruption_error, resilience_rate
from .score import FAILURES, Score, score_trajectory

__all__ = [
    "FAILURES",
    "METRICS",
    "PAPER_METRICS",
    "PAPER_PREFIX",
    "PROTOCOLS",
    "Alignment",
    "FrameErrors",
    "Metric",
    "Protocol",
    "Rate",
    "Score",
    "Similarity",
    "corruption_error",
    "frame_errors_text",
    "metrics_of",
    "paper_protocol",
    "resilience_rate",
    "score_trajectory",
]
