# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a study's results: its files, what is written in them and read back, and what it evaluates."""

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.atomic_files import own_scratch, storage_errors, write_atomic
from ..core.errors import StorageError
from ..core.file_access import finite_number, read_json
from ..core.trajectory import Trajectory
from ..dataset.folder_state import WORK_FOLDER, decisive, first_difference
from ..dataset.identity import HUFFMAN, setting_problem
from .cases import ESTIMATE, KEYFRAMES, Case, Outcome, RunRecord, SystemRun, read_estimate_file
from .estimates import Estimate
from .pose_errors import PROTOCOLS, FrameErrors, Similarity, paper_protocol
from .trajectory_scores import score_trajectory

STUDY = "study.json"
SCORES = "scores.json"
ERRORS = "errors.csv"
TRUTH = "truth.txt"
FRAMES = "frames.csv"
INDICATORS = "indicators.json"
THUMBS = "thumbs"


@dataclass(frozen=True)
class ResultsFolder:
    """A folder of results. What is in its working folder goes when the study ends."""

    folder: Path

    @property
    def work(self) -> Path:
        """The working folder."""
        return self.folder / WORK_FOLDER

    def of_run(self, run: SystemRun) -> Path:
        """Return the folder of a run of a system."""
        return self.folder / "runs" / run.name

    def of_case(self, case: Case) -> Path:
        """Return the folder of a sequence: its truth and what its frames are like."""
        return self.folder / "sequences" / case.name

    def making(self, case: Case, *, keep: bool) -> Path:
        """Return the folder in which the dataset of a case is made, which stays there if it is kept."""
        return self.folder / "kept" / case.name if keep else self.work / "making" / case.name

    def clean_frames(self, scene: str) -> Path:
        """Return the folder of the clean frames of a scene."""
        return self.work / "clean" / scene

    @property
    def tables(self) -> Path:
        """The folder of tables."""
        return self.folder / "tables"

    def is_whole(self, run: SystemRun) -> bool:
        """Tell whether a run has ended and was scored: its scores are written last."""
        return (self.of_run(run) / SCORES).is_file()

    def is_described(self, case: Case) -> bool:
        """Tell whether what a case's frames are like is written: that is done last."""
        return (self.of_case(case) / INDICATORS).is_file()

    def write(self, path: Path, text: str) -> None:
        """Write a text atomically. Raises StorageError."""
        self.write_bytes(path, text.encode())

    def write_bytes(self, path: Path, data: bytes) -> None:
        """Write a file atomically. Raises StorageError."""
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, own_scratch(self.work))

    def write_json(self, path: Path, value: Any) -> None:
        """Write a value as JSON, its keys sorted. Raises ValueError for NaN and infinity, which JSON has not."""
        self.write(path, json.dumps(value, indent=1, sort_keys=True, allow_nan=False) + "\n")

    def read_json(self, path: Path) -> Any:
        """Return the value of a file of JSON. Raises StorageError where it cannot be read."""
        try:
            return read_json(path)
        except (FileNotFoundError, ValueError) as error:
            raise StorageError(
                str(error), file=path, remedy="remove its folder and run the same command again"
            ) from error

    def remove(self, folder: Path) -> None:
        """Remove a folder of ours with all that is in it, and the folders above it that are empty then."""
        with storage_errors(folder):
            if folder.is_dir():
                shutil.rmtree(folder)
        for above in folder.parents:
            if above in (self.folder, *self.folder.parents):
                return
            self.remove_empty(above)

    def tidy(self, *, alone: bool = False) -> None:
        """Remove what this process has in the working folder, and folders that are empty.

        alone: whether no other process works here, so what killed ones left goes too; frames that are taken up again
        stay.
        """
        frames = [self.work / name for name in ("making", "clean")]
        scratch = own_scratch(self.work)
        shutil.rmtree(scratch, ignore_errors=True)
        for folder in (*frames, scratch.parent):
            self.remove_empty(folder)
        if alone and not any(folder.exists() for folder in frames):
            shutil.rmtree(self.work, ignore_errors=True)
        self.remove_empty(self.work)
        self.remove_empty(self.folder)

    @staticmethod
    def remove_empty(folder: Path) -> None:
        """Remove a folder if nothing is in it."""
        with contextlib.suppress(OSError):  # it holds something, or another process has removed it
            os.rmdir(folder)  # noqa: PTH106 - says the same

    def runs(self) -> Iterator[SystemRun]:
        """Yield the runs that are whole, sorted."""
        folder = self.folder / "runs"
        folders = [path.parent.relative_to(folder) for path in folder.glob(f"*/*/*/*/*/{SCORES}")]
        yield from sorted(
            SystemRun(Case.parse("/".join(path.parts[:3])), path.parts[3], int(path.parts[4].removeprefix("repeat-")))
            for path in folders
        )

    def cases(self) -> Iterator[Case]:
        """Yield the cases whose frames are described, sorted."""
        folder = self.folder / "sequences"
        folders = [path.parent.relative_to(folder) for path in folder.glob(f"*/*/*/{INDICATORS}")]
        yield from sorted(Case.parse(path.as_posix()) for path in folders)


# A run of a system scored, by both protocols.


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


# study.json, scores.json and indicators.json read back, as a study writes them: a disk, a tool or a person may have
# changed them.


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
    if problem := _problem(study, kind):
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
    values = results.read_json(path)
    if not _is_values(values):
        raise _not_as_written(path)
    return values


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


VERSIONS = "versions"
"""In a record's study: by system what its runs say of the versions that they used."""
PROCESSORS = "processors"
"""In a record's study: the kinds of processors whose frames it has."""


def _is_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(each, str) for each in value.values())


def _is_whole_numbers(value: Any) -> bool:
    return isinstance(value, list) and all(type(each) is int for each in value)


_KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "protocol": (lambda value: value in PROTOCOL_NAMES, f"is none of {', '.join(PROTOCOL_NAMES)}"),
    "systems": (lambda value: isinstance(value, dict), "is no mapping"),
    "seeds": (_is_whole_numbers, "is no list of seeds"),
    "repeats": (lambda value: type(value) is int, "is no whole number"),
    "metrics": (_is_texts, "is no mapping of texts"),  # of installed packages, with these
    VERSIONS: (lambda value: isinstance(value, dict) and all(map(_is_texts, value.values())), "is no mapping of texts"),
    PROCESSORS: (lambda value: isinstance(value, list), "is no list"),
}
"""What study.json holds beside its subject, and what is wrong with another value."""
_OF_RECORD = (VERSIONS, PROCESSORS)


def _problem(study: Any, kind: str) -> str:
    """Return what of a study is not as it is written: its key and what is wrong, or ""."""
    if not isinstance(study, dict):
        return "is no mapping"
    subject = study.get("subject")
    settings = subject.get("settings") if isinstance(subject, dict) else None
    if not isinstance(settings, dict):
        return "subject.settings: is no mapping"
    may_lack = ("metrics", *(_OF_RECORD if kind == KIND else ()))
    for name, (is_right, problem) in _KEYS.items():
        if not is_right(study.get(name)) and not (name not in study and name in may_lack):
            return f"{name}: {problem}"
    wrong = map(setting_problem, settings, settings.values())
    return next((f"subject.{problem}" for problem in wrong if problem), "")


# `study.json`: what a folder of results evaluates. A study grows by scenes, settings, systems, seeds and repeats.


BY_NAME = ("scenes", "settings", "sequences", "found")
"""Parts of what the sequences are made from that hold something for each name: others are added."""
FOR_PEOPLE = ("preset", "preset_sha256")
"""Parts that decide nothing which other parts do not tell."""
EXPECTED = "expects_clean"
"""What a system's runs are held against, which may be said anew of runs that are there."""


def write_study_identity(results: ResultsFolder, identity: dict[str, Any], *, seeds: list[int], repeats: int) -> None:
    """Write what is evaluated, beside what was before in the same folder.

    Raises StorageError where the folder holds a study of something else, in a line that names the first difference.
    """
    path = results.folder / STUDY
    here = {**identity, "seeds": sorted(seeds), "repeats": repeats}
    if path.is_file():
        there = read_study(results)
        if problem := why_not(there, here):
            raise StorageError(f"holds another study: {problem}", file=results.folder, remedy=ANOTHER)
        here = merged(there, here)
    elif results.folder.is_dir() and any(item.name != results.work.name for item in results.folder.iterdir()):
        raise StorageError("is not empty and holds no study", file=results.folder, remedy=ANOTHER)
    results.write_json(path, {"kind": KIND, "format": FORMAT, "study": here})


def why_not(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return the first difference of two studies in what both name, or ""."""
    if difference := _run_or_scored_otherwise(there, here):
        return difference
    before, now = there["subject"], here["subject"]
    if of_any_processor(before) and of_any_processor(now):
        before, now = decisive(before), decisive(now)
    for key in sorted({*before, *now} - set(FOR_PEOPLE)):
        left, right = before.get(key), now.get(key)
        if key in BY_NAME and isinstance(left, dict) and isinstance(right, dict):
            both = [name for name in left if name in right]
            left, right = ({name: part[name] for name in both} for part in (left, right))
        if key == "output":  # systems read the same pixels
            left, right = ({**(part or {}), HUFFMAN: None} for part in (left, right))
        if difference := first_difference(left, right, key):
            return difference
    return ""


def _run_or_scored_otherwise(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return the first difference of two studies in their systems, metrics and protocol, or ""."""
    for name in sorted(there["systems"].keys() & here["systems"].keys()):
        if _deciding(there["systems"][name]) != _deciding(here["systems"][name]):
            return f"the definition of {name} is another"
    before, now = there.get("metrics", {}), here.get("metrics", {})
    for name in sorted(before):
        if name in now and before[name] != now[name]:
            return f"the metric {name} is of {before[name]}, and here of {now[name]}"
    if there.get("definitions", 1) != here.get("definitions", 1):
        return "its runs were scored by other definitions of pairing, coverage and rotation"
    for key in ("protocol", "maps"):
        if there.get(key) != here[key]:
            return first_difference(there.get(key), here[key], key) or ""
    return ""


def of_any_processor(subject: dict[str, Any]) -> bool:
    """Tell whether the preset allows frames of unlike processors: `render.processors: any`."""
    render = subject["preset"].get("render") if isinstance(subject.get("preset"), dict) else None
    return isinstance(render, dict) and render.get("processors") == "any"


def _deciding(definition: Any) -> Any:
    """Return what is said of a system's definition without what its runs are held against."""
    if not isinstance(definition, dict):
        return definition
    return {key: value for key, value in definition.items() if key != EXPECTED}


def merged(there: dict[str, Any], here: dict[str, Any]) -> dict[str, Any]:
    """Return what a folder evaluates that held `there` and takes `here`."""
    before, now = there["subject"], here["subject"]
    subject = {
        key: {**before.get(key, {}), **value} if key in BY_NAME and isinstance(value, dict) else value
        for key, value in now.items()
    }
    brought = {**there.get("metrics", {}), **here.get("metrics", {})}
    return {
        **here,
        **({"metrics": brought} if brought else {}),
        "subject": subject,
        "systems": {**there["systems"], **here["systems"]},
        "seeds": sorted({*there["seeds"], *here["seeds"]}),
        "repeats": max(there["repeats"], here["repeats"]),
    }
