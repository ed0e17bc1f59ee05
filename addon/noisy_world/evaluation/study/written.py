# SPDX-License-Identifier: GPL-3.0-or-later
"""study.json, scores.json and indicators.json read back, as a study writes them: a disk, a tool or a person may have
changed them."""

from pathlib import Path
from typing import Any

from ...core.datasets.json_text import finite_number
from ...core.datasets.recorded_setting import setting_problem
from ...core.errors import StorageError
from .cases import Case, SystemRun
from .results import INDICATORS, SCORES, STUDY, ResultsFolder
from .scoring import MAP, PAPER, PROTOCOL_NAMES, STRICT

KIND = "study of Noisy World"
RECORD = "record of a study of Noisy World"
FORMAT = 1  # version of study.json; raised when its keys change
ANOTHER = "choose another folder with --out"


def is_record(results: ResultsFolder) -> bool:
    """Tell whether a folder holds the record of a study, which has no runs. Raises StorageError for a damaged file."""
    content = results.read_json(results.folder / STUDY)
    return isinstance(content, dict) and content.get("kind") == RECORD


def read_study(results: ResultsFolder, kind: str = KIND) -> dict[str, Any]:
    """Return what was evaluated. kind: KIND or RECORD, what the file has to be of.

    Raises StorageError where study.json is of another kind or version, or damaged.
    """
    path = results.folder / STUDY
    content = results.read_json(path)
    if kind == KIND and isinstance(content, dict) and content.get("kind") == RECORD:
        raise StorageError("is the record of a study, without its runs", file=results.folder, remedy=ANOTHER)
    if not isinstance(content, dict) or content.get("kind") != kind or content.get("format") != FORMAT:
        raise StorageError("is not of this version of Noisy World", file=path, remedy=ANOTHER)
    study: Any = content.get("study")
    if problem := _problem(study):
        raise StorageError(
            f"study: {problem}, so it is not as it was written", file=path, remedy=f"copy it again, or {ANOTHER}"
        )
    return study


def read_scores(results: ResultsFolder, run: SystemRun) -> dict[str, Any]:
    """Return the scores of a run: `failure`, and the values of each protocol by name. Raises StorageError."""
    path = results.of_run(run) / SCORES
    scores = results.read_json(path)
    if not isinstance(scores, dict) or not isinstance(scores.get("failure"), str):
        raise _not_as_written(path)
    for kind in (STRICT, PAPER, MAP):
        if not _is_values(scores.get(kind, {})):
            raise _not_as_written(path)
    return scores


def read_indicators(results: ResultsFolder, case: Case) -> dict[str, Any]:
    """Return what the frames of a case are like, numbers by name. Raises StorageError."""
    path = results.of_case(case) / INDICATORS
    found = results.read_json(path)
    if not _is_values(found):
        raise _not_as_written(path)
    return found


def _not_as_written(path: Path) -> StorageError:
    return StorageError(
        "is not as it was written", file=path, remedy="remove its folder and run the same command again"
    )


def _is_values(value: Any) -> bool:
    """Tell whether this is a mapping of numbers, or null where there is none."""
    return isinstance(value, dict) and all(map(_is_number, value.values()))


def _is_number(value: Any) -> bool:
    """Tell whether this is a finite number, or null."""
    return value is None or finite_number(value) is not None


def _problem(study: Any) -> str:
    """Return what of a study is not as it is written: its key and what is wrong, or ""."""
    if not isinstance(study, dict):
        return "is no mapping"
    protocol, subject = study.get("protocol"), study.get("subject")
    if protocol not in PROTOCOL_NAMES:
        return f"protocol: is none of {', '.join(PROTOCOL_NAMES)}"
    settings = subject.get("settings") if isinstance(subject, dict) else None
    if not isinstance(settings, dict):
        return "subject.settings: is no mapping"
    if not isinstance(study.get("systems"), dict):
        return "systems: is no mapping"
    metrics = study.get("metrics", {})  # of installed packages, with these
    if not isinstance(metrics, dict) or not all(isinstance(said, str) for said in metrics.values()):
        return "metrics: is no mapping of texts"
    if not isinstance(study.get("seeds"), list) or not all(type(seed) is int for seed in study["seeds"]):
        return "seeds: is no list of whole numbers"
    if type(study.get("repeats")) is not int:
        return "repeats: is no whole number"
    found = map(setting_problem, settings, settings.values())
    return next((f"subject.{wrong}" for wrong in found if wrong), "")
