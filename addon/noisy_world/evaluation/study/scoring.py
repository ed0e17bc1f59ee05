# SPDX-License-Identifier: GPL-3.0-or-later
"""A run of a system scored, by both protocols: `scores.json` and `errors.csv` in the run's folder."""

from pathlib import Path
from typing import Any

import numpy as np

from ...core.trajectories.trajectory import Trajectory
from ..estimate import Estimate
from ..metrics.frame_errors import FrameErrors, frame_errors_text
from ..metrics.protocols import paper_protocol
from ..metrics.score import score_trajectory
from ..outcome import Outcome, RunRecord
from ..systems.estimate_file import read_estimate_file
from .results import ERRORS, SCORES, Results

ESTIMATE = "estimate.txt"
KEYFRAMES = "keyframes.txt"
STRICT, PAPER = "strict", "paper"
PROTOCOL_NAMES = (STRICT, PAPER)

NOTHING = Estimate(np.zeros(0), np.zeros((0, 4, 4)))


def score_run(
    results: Results, folder: Path, record: RunRecord, truth: Trajectory, *, protocol: str, monocular: bool
) -> FrameErrors:
    """Score a run, and write that into its folder, the scores last. Return the errors of its frames.

    truth: of all the frames that the system was given. protocol: whose errors of frames are written. monocular: whether
    the system had no depth.
    """
    finished = record.outcome is Outcome.FINISHED
    estimate = read_estimate_file(folder / ESTIMATE) if finished else NOTHING
    keyframes = read_estimate_file(folder / KEYFRAMES) if finished and (folder / KEYFRAMES).is_file() else None
    scores = {
        STRICT: score_trajectory(estimate, truth, STRICT, monocular=monocular),
        PAPER: score_trajectory(
            estimate, truth, paper_protocol(record.system), monocular=monocular, keyframes=keyframes
        ),
    }
    errors = scores[protocol].frame_errors
    results.write(folder / ERRORS, frame_errors_text(errors))
    content: dict[str, Any] = {name: score.values for name, score in scores.items()}
    results.write_json(folder / SCORES, {"failure": scores[protocol].failure, **content})
    return errors
