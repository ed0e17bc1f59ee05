# SPDX-License-Identifier: GPL-3.0-or-later
"""`run.json`, which tells how a run of a system ended, read back."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from ...core.datasets.json_text import read_json
from ...core.errors import StorageError
from ..outcome import Outcome, RunRecord

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
    names = {item.name for item in fields(RunRecord)}
    if (
        not isinstance(content, dict)
        or not {"system", "outcome", "detail", "frames", "seconds"} <= set(content) <= names
    ):
        raise _damaged(path, "does not tell how a run ended")
    try:
        return RunRecord(**{**content, "outcome": Outcome(content["outcome"])})
    except ValueError as error:
        raise _damaged(path, str(error)) from error


def _damaged(path: Path, problem: str) -> StorageError:
    return StorageError(problem, file=path, remedy="remove its folder and run the same command again")
