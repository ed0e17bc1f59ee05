# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a study's results: where its files lie, and how they are written."""

import contextlib
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.datasets.dataset_state import WORK_FOLDER
from ...core.datasets.json_text import read_json
from ...core.datasets.storage import own_scratch, storage_errors, write_atomic
from ...core.errors import StorageError
from .cases import Case, SystemRun

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
        found = [path.parent.relative_to(folder) for path in folder.glob(f"*/*/*/*/*/{SCORES}")]
        yield from sorted(
            SystemRun(Case.parse("/".join(path.parts[:3])), path.parts[3], int(path.parts[4].removeprefix("repeat-")))
            for path in found
        )

    def cases(self) -> Iterator[Case]:
        """Yield the cases whose frames are described, sorted."""
        folder = self.folder / "sequences"
        found = [path.parent.relative_to(folder) for path in folder.glob(f"*/*/*/{INDICATORS}")]
        yield from sorted(Case.parse(path.as_posix()) for path in found)
