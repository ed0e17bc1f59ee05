# SPDX-License-Identifier: GPL-3.0-or-later
"""The trials of a search: a short sequence with one value of a perturbation, a run of the system on it, its score.

Every trial has a seed of its own, which decides its noise. Its path is its scene's.
"""

import json
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ...core.datasets.differences import first_difference
from ...core.errors import InputError, StorageError
from ...core.presets.preset import Preset, check_document
from ...core.progress import Progress
from ...core.schema import ConfigPath, unknown_name
from ..metrics.names import METRICS
from ..study.cases import Case, SystemRun
from ..study.identity import FOR_PEOPLE
from ..study.made_origin import MadeOrigin
from ..study.results import ResultsFolder
from ..study.scoring import STRICT, score_run
from ..systems.definition import System
from ..systems.running import run_system
from .axis import Axis
from .search import Found, Planned, Trial

ENDING = ".threshold.json"
KIND = "search of a threshold of Noisy World"
FORMAT = 1  # raised when the file's keys change


def preset_of(preset: Preset, axis: Axis, given: Mapping[str, Any]) -> Preset:
    """Return a preset with a setting for each value that may be tried, instead of its own.

    given: the perturbation's other keys. Raises InputError where the perturbation does not take these.
    """
    kept = {key: part for key, part in preset.document.items() if key != "only"}
    only = {} if preset.spec.only.scenes is None else {"only": {"scenes": list(preset.spec.only.scenes)}}
    settings = [
        {"name": setting_of(axis, value), "perturb": [{axis.perturbation: {**given, axis.parameter: value}}]}
        for value in axis.tried()
    ]
    return check_document({**kept, **only, "settings": settings}, preset.path)


def setting_of(axis: Axis, value: float) -> str:
    """Return the name of the setting with a value."""
    return f"{axis.perturbation}_{axis.parameter}_{value:g}"


def check_success(name: str) -> None:
    """Raise InputError where no metric of this name tells success from failure."""
    known = [item for item in METRICS if item.startswith("success_") and item != "success_auc"]
    if name not in known:
        raise unknown_name(ConfigPath("--success"), "metric of success", name, known)


@dataclass(frozen=True)
class SearchFile:
    """The file of a search: what decides its trials, the trials, and what was found once it has ended.

    results: the folder of the searches along one axis, of one system each.
    """

    results: ResultsFolder
    system: str

    @property
    def path(self) -> Path:
        """Where it lies."""
        return self.results.folder / f"{self.system}{ENDING}"

    def read(self) -> dict[str, Any] | None:
        """Return its content; None where it is not there. Raises StorageError."""
        if not self.path.is_file():
            return None
        content = self.results.read_json(self.path)
        if not isinstance(content, dict) or content.get("kind") != KIND or content.get("format") != FORMAT:
            problem = "is no search of this version of Noisy World"
            raise StorageError(problem, file=self.path, remedy="remove it")
        return content

    def trials(self, identity: Mapping[str, Any]) -> list[Trial]:
        """Return the trials that were made. Raises StorageError where they are of another search, or damaged."""
        content = self.read()
        if content is None:
            return []
        if found := first_difference(content.get("identity"), identity, ""):
            remedy = "choose another folder with --out"
            raise StorageError(f"holds another search: {found}", file=self.path, remedy=remedy)
        rows, names = content.get("trials"), {item.name for item in fields(Trial)}
        if not isinstance(rows, list) or not all(isinstance(row, dict) and set(row) == names for row in rows):
            raise StorageError("is not as it was written", file=self.path, remedy="remove it")
        return [Trial(**row) for row in rows]

    def write(self, identity: Mapping[str, Any], trials: list[Trial], found: Found | None = None) -> None:
        """Write it anew. Raises StorageError."""
        content = {"kind": KIND, "format": FORMAT, "identity": identity, "trials": [asdict(item) for item in trials]}
        self.results.write_json(self.path, {**content, "found": None if found is None else asdict(found)})


@dataclass(frozen=True)
class Trials:
    """Makes the trials of a search. success: the metric that is 1 for a success. stop: ends a trial when set."""

    origin: MadeOrigin
    results: ResultsFolder
    system: System
    axis: Axis
    success: str
    stop: threading.Event

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the trials, as plain JSON values."""
        kept = {key: part for key, part in self.origin.identity.items() if key not in FOR_PEOPLE}
        found = {
            "axis": asdict(self.axis),
            "sequences": kept,
            "success": self.success,
            "system": {"name": self.system.name, "digest": self.system.digest},
        }
        return json.loads(json.dumps(found))

    def make(self, planned: Planned, progress: Progress) -> Trial:
        """Make the sequence of a trial, run the system on it, score it, and remove the sequence.

        Raises InterruptedRunError where `stop` is set.
        """
        case = Case(planned.scene, setting_of(self.axis, planned.value), planned.seed)
        run = SystemRun(case, self.system.name, 1)
        folder = self.results.of_run(run)
        self.results.remove(folder)  # what a run that was killed has left
        with self.origin.sequence(case, progress) as sequence:
            record = run_system(self.system, sequence.folder, folder, stop=self.stop, names=run.placeholders)
            monocular = self.system.reads.monocular
            scored = score_run(folder, record, sequence.truth, protocol=STRICT, monocular=monocular)
        values = scored.content[STRICT]
        if values[self.success] is None:
            raise InputError(self.origin.preset.path, f"{planned.scene} has a path that stands still", where="scenes")
        return Trial(
            **asdict(planned),
            outcome=str(record.outcome),
            ate_m=values["ate_rmse_m"],
            tracked_share=values["tracked_share"],
            succeeded=values[self.success] == 1.0,
        )
