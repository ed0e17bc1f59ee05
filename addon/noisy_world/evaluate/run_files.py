# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a run: how it ended, `run.json`, and the poses that it estimated, `estimate.txt`."""

import json
from dataclasses import MISSING, asdict, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError, StorageError
from ..core.file_access import read_text
from ..core.geometry import continuous_quats, quat_wxyz_from_rotation
from ..core.json_text import read_json
from .estimates import Asked, Estimate, Frames, estimate_of, read_poses


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

    def text(self) -> str:
        """Return it as JSON, which `read_run_record` reads."""
        return json.dumps(asdict(self), indent=1, sort_keys=True, allow_nan=False) + "\n"


# `estimate.txt`: the poses that a system estimated, in the folder of a run: TUM's format, camera-to-world.


ESTIMATE = "estimate.txt"
KEYFRAMES = "keyframes.txt"
FRAMES = "frames.csv"
"""The state of each frame, as a system writes it."""
MAP = "map.ply"


def estimate_text(estimate: Estimate) -> str:
    """Return a line a pose: stamp_s tx ty tz qx qy qz qw; nine decimals of the stamp, 17 digits of the others."""
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(estimate.c2w[:, :3, :3]))
    rows = np.concatenate([estimate.c2w[:, :3, 3], np.roll(quat_wxyz, -1, axis=1)], axis=1) + 0.0
    stamps = estimate.stamps_s.tolist()
    return "".join(
        f"{stamp:.9f} {' '.join(f'{number:.17g}' for number in row)}\n"
        for stamp, row in zip(stamps, rows.tolist(), strict=True)
    )


def read_estimate_file(path: Path) -> Estimate:
    """Read what `estimate_text` wrote. Raises InputError for anything else."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error
    lines = text.splitlines()
    if text and not text.endswith("\n"):  # which `estimate_text` ends each line with
        problem = "the file ends in the middle of a line, so it was cut"
        remedy = "remove the run's folder and run the same command again"
        raise InputError(path, problem, where=f"line {len(lines)}", remedy=remedy)
    return estimate_of(path, read_poses(path, "tum", Asked(stamp_unit="s")), Frames.of([]))


# `run.json`, which tells how a run of a system ended, read back.


RUN = "run.json"


def read_run_record(folder: Path) -> RunRecord | None:
    """Return the record of a run; None where there is none, as the run has not ended. Raises StorageError."""
    path = folder / RUN
    try:
        content: Any = read_json(path)
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise _damaged(path, str(error)) from error
    needed = {item.name for item in fields(RunRecord) if item.default is item.default_factory is MISSING}
    if not isinstance(content, dict) or not needed <= set(content) <= {item.name for item in fields(RunRecord)}:
        raise _damaged(path, "does not tell how a run ended")
    try:
        return RunRecord(**{**content, "outcome": Outcome(content["outcome"])})
    except ValueError as error:
        raise _damaged(path, str(error)) from error


def _damaged(path: Path, problem: str) -> StorageError:
    return StorageError(problem, file=path, remedy="remove its folder and run the same command again")
