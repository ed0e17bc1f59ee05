# SPDX-License-Identifier: GPL-3.0-or-later
"""What a study consists of: cases, each a sequence, the runs of systems on them, and their files."""

import json
import re
from collections.abc import Iterable
from dataclasses import MISSING, asdict, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError, StorageError
from ..core.file_access import read_json, read_text
from ..core.geometry import continuous_quats, quat_wxyz_from_rotation
from ..dataset.identity import RecordedSetting, RecordedStep
from ..perturbations.kinds import MotionPerturbation, PairingPerturbation
from ..perturbations.parsing import Registry
from .estimates import Asked, Estimate, Frames, estimate_of, read_poses

CLEAN = "clean"
"""The setting in which nothing is done, and what is said to be done there."""
RECORDED = "recorded"
"""The setting of a recording, whose folder does not tell of one."""

_CASE = re.compile(r"([^/]+)/([^/]+)/seed-([0-9]+)")


@dataclass(frozen=True, order=True)
class Case:
    """A sequence of a study: a scene in a setting, with a seed."""

    scene: str
    setting: str
    seed: int

    @property
    def name(self) -> str:
        """Its name, which is its folder in the results too: SCENE/SETTING/seed-N."""
        return f"{self.scene}/{self.setting}/seed-{self.seed}"

    @classmethod
    def parse(cls, name: str) -> "Case":
        """Return the case of a name. Raises ValueError for what names none."""
        if (match := _CASE.fullmatch(name)) is None:
            raise ValueError(f"{name!r} is no case; it has to be SCENE/SETTING/seed-N")
        return cls(match[1], match[2], int(match[3]))


@dataclass(frozen=True, order=True)
class SystemRun:
    """A run of a system on a case. repeat: counted from 1."""

    case: Case
    system: str
    repeat: int

    @property
    def name(self) -> str:
        """Its name, which is its folder in the results too: SCENE/SETTING/seed-N/SYSTEM/repeat-K."""
        return f"{self.case.name}/{self.system}/repeat-{self.repeat}"

    @property
    def placeholders(self) -> dict[str, str]:
        """What a system's command may name of it."""
        case = self.case
        return {"scene": case.scene, "setting": case.setting, "seed": str(case.seed), "repeat": str(self.repeat)}


@dataclass(frozen=True)
class Condition:
    """What is done in a setting, in the words of the tables.

    perturbation: the names of its steps, joined by +; CLEAN where there is none. mode: "static" or "dynamic" (where
    it changes from frame to frame); "" where only the motion is another, and where nothing is done. severity: 1 to 5
    where all steps have one and the same, else "".
    """

    perturbation: str
    mode: str
    severity: str

    @classmethod
    def of(cls, setting: Any, known: Registry) -> "Condition":
        """Return the condition of a setting as a dataset's identity has it, which is one that can be read."""
        steps = RecordedSetting.read(setting).steps
        if not steps:
            return cls(CLEAN, "", "")
        name = "+".join(step.name for step in steps)
        return cls(name, _mode(steps, known), _severity(step.severity for step in steps))

    @classmethod
    def of_name(cls, setting: str) -> "Condition":
        """Return the condition of a setting of which nothing but its name is known."""
        return cls(CLEAN if setting in (CLEAN, RECORDED) else setting, "", "")


def _mode(steps: Iterable[RecordedStep], known: Registry) -> str:
    kinds = [known.get(step.name) for step in steps]
    if all(isinstance(kind, MotionPerturbation) for kind in kinds):
        return ""
    dynamic = any(
        step.mode != "static"
        or (isinstance(kind, PairingPerturbation) and (step.parameters[0] or {}).get("mode") == "dynamic")
        for step, kind in zip(steps, kinds, strict=True)
    )
    return "dynamic" if dynamic else "static"


def _severity(severities: Iterable[float | None]) -> str:
    distinct = set(severities)
    severity = distinct.pop() if len(distinct) == 1 else None
    return "" if severity is None else f"{severity:g}"


# Texts in tables of comma-separated values, which people open in spreadsheets: none may be taken for a formula.
#
# A text that begins with = + - @, a tab or a carriage return gets an apostrophe before it, as spreadsheets do for a
# text that is typed in. It is taken off where this program reads its tables. Numbers stay as they are.


_FORMULA = re.compile(r"'*[=+\-@\t\r]")


def cell_of(text: str) -> str:
    """Return a text as it stands in a cell."""
    return f"'{text}" if _FORMULA.match(text) else text


def text_of(cell: str) -> str:
    """Return the text that stands in a cell: what `cell_of` was given."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


# The files of a run: how it ended, `run.json`, and the poses that it estimated, `estimate.txt`.


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
