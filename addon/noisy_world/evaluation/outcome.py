# SPDX-License-Identifier: GPL-3.0-or-later
"""How a run of a SLAM system ended. Whatever a system does is a result; an error is a fault of ours."""

from dataclasses import dataclass, field
from enum import StrEnum


class Outcome(StrEnum):
    """How a run ended."""

    FINISHED = "finished"  # exit status 0 and an estimate that can be read, of whatever length
    CRASHED = "crashed"  # another exit status, or a signal
    TIMED_OUT = "timed_out"  # stopped at its time limit
    OVER_LIMIT = "over_limit"  # it took, wrote or left more than its definition's limits say
    NO_ESTIMATE = "no_estimate"  # exit status 0 and no file with an estimate
    UNREADABLE = "unreadable"  # the file of the estimate is not what the system's definition says
    NOT_FINITE = "not_finite"  # the estimate holds NaN or infinity


@dataclass(frozen=True)
class RunRecord:
    """What is known of one run of a system on one sequence: `run.json` in the run's folder.

    detail: a sentence on what went wrong, "" where nothing did. frames: of the sequence. seconds: on the wall;
    processor_s, peak_memory_bytes: of the system's processes, None where the machine does not tell.
    versions: of the system and what it stands on, by name, as it states them. isolated: by which program, "" by none.
    """

    system: str
    outcome: Outcome
    detail: str
    frames: int
    seconds: float
    processor_s: float | None = None
    peak_memory_bytes: int | None = None
    exit_status: int | None = None
    versions: dict[str, str] = field(default_factory=dict)
    isolated: str = ""
