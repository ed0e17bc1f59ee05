# SPDX-License-Identifier: GPL-3.0-or-later
"""A run of a system scored, by both protocols."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.trajectories.trajectory import Trajectory
from ..estimate import Estimate
from ..metrics.alignment import Similarity
from ..metrics.frame_errors import FrameErrors
from ..metrics.protocols import PROTOCOLS, paper_protocol
from ..metrics.score import score_trajectory
from ..outcome import Outcome, RunRecord
from ..systems.estimate_file import ESTIMATE, KEYFRAMES, read_estimate_file

STRICT, PAPER, MAP = "strict", "paper", "map"
PROTOCOL_NAMES = (STRICT, PAPER)

NOTHING = Estimate(np.zeros(0), np.zeros((0, 4, 4)))


@dataclass(frozen=True, eq=False)
class Scored:
    """A run that was scored.

    content: of scores.json. errors: of its frames, by the study's protocol. estimate: its poses. by: what lays
    its map over the truth, by protocol strict; None where the run failed. notes: on its poses, one sentence each.
    """

    content: dict[str, Any]
    errors: FrameErrors
    estimate: Estimate
    by: Similarity | None
    notes: tuple[str, ...]


def score_run(folder: Path, record: RunRecord, truth: Trajectory, *, protocol: str, monocular: bool) -> Scored:
    """Score the run in a folder.

    truth: of all the frames that the system was given. protocol: whose errors of frames are written. monocular: whether
    the system had no depth.
    """
    finished = record.outcome is Outcome.FINISHED
    estimate = read_estimate_file(folder / ESTIMATE) if finished else NOTHING
    keyframes = read_estimate_file(folder / KEYFRAMES) if finished and (folder / KEYFRAMES).is_file() else None
    scores = {
        name: score_trajectory(
            estimate, truth, chosen, monocular=monocular, keyframes=keyframes, frames_s=truth.stamps_s
        )
        for name, chosen in ((STRICT, PROTOCOLS[STRICT]), (PAPER, paper_protocol(record.system)))
    }
    content: dict[str, Any] = {name: score.values for name, score in scores.items()}
    content |= {"failure": scores[protocol].failure, MAP: {}}
    return Scored(content, scores[protocol].frame_errors, estimate, scores[STRICT].by_poses, scores[STRICT].notes)
