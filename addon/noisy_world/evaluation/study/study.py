# SPDX-License-Identifier: GPL-3.0-or-later
"""A study: systems, the sequences that they are run on, and the folder of results, which it fills case by case."""

import threading
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from ...core.presets.preset import check_document
from ...core.progress import Progress
from ..maps.names import MAP_METRICS
from ..metrics import METRICS
from ..metrics.alignment import CONDITIONING, WELL_CONDITIONED
from ..metrics.frame_errors import frame_errors_text
from ..metrics.protocols import DEFINITIONS
from ..outcome import Outcome, RunRecord
from ..systems.definition import ExpectedClean, System
from ..systems.registry import find_systems, isolating
from ..systems.running import run_system
from .cases import CLEAN, Case, SystemRun
from .describing import describe, show, worst_frames
from .found_origin import FoundOrigin
from .made_origin import MadeOrigin
from .mapping import MapsOfCase, maps_of
from .order import StudyOrder
from .origin import CaseSequence, Origin
from .results import ERRORS, SCORES, ResultsFolder
from .run_files import read_run_record
from .scoring import MAP, STRICT, score_run


class Study:
    """A study that is to be carried out. Any number of processes may work at different cases of one."""

    def __init__(self, order: StudyOrder, *, stop: threading.Event) -> None:
        """Find the systems and the files of the scenes. stop: when set, `carry_out` ends with InterruptedRunError.

        Raises InputError for what is missing or wrong.
        """
        self.order = order
        self.results = ResultsFolder(order.folder)
        self.systems = {system.name: system for system in isolating(find_systems(order.systems), order.isolate)}
        self._stop = stop

    @cached_property
    def origin(self) -> Origin:
        """Where the sequences come from."""
        order = self.order
        if order.document is None:
            return FoundOrigin(Path(order.subject), order.scenes, order.settings)
        preset = check_document(order.document, Path(order.subject))
        return MadeOrigin(
            preset, order.seeds, self.results, keep=order.keep, keep_clean=order.keep_clean, stop=self._stop
        )

    @cached_property
    def _elsewhere(self) -> frozenset[str]:
        return frozenset(self.order.elsewhere)

    def runs_of(self, case: Case) -> list[SystemRun]:
        """Return the runs on a case: one of a system that repeats itself, several of another; none from elsewhere."""
        every = [
            SystemRun(case, system.name, repeat)
            for system in self.systems.values()
            for repeat in range(1, 1 + (1 if system.repeatable else self.order.repeats))
        ]
        return [run for run in every if run.name not in self._elsewhere]

    def missing_runs(self, case: Case) -> list[SystemRun]:
        """Return the runs on a case that are not there."""
        return [run for run in self.runs_of(case) if not self.results.is_whole(run)]

    @cached_property
    def missing(self) -> list[Case]:
        """The cases of which something is not there."""
        return [
            case
            for case in self.origin.frames
            if self.missing_runs(case) or (self.runs_of(case) and not self.results.is_described(case))
        ]

    def carry_out(self, case: Case, progress: Progress) -> None:
        """Do what of a case is not there: make its sequence, run the systems on it, score them.

        Raises InterruptedRunError where `stop` was set.
        """
        missing = self.missing_runs(case)
        if not missing and self.results.is_described(case):
            return
        with self.origin.sequence(case, progress) as sequence:
            with maps_of(sequence) as maps:
                for run in missing:
                    self._run(run, sequence, maps if self.order.maps else None, progress)
            describe(self.results, case, sequence)

    def _run(self, run: SystemRun, sequence: CaseSequence, maps: MapsOfCase | None, progress: Progress) -> None:
        """Run a system, unless it was run and only its scores are missing; show its worst frames, and score it.

        maps: scores its map, if that is asked for.
        """
        system, folder = self.systems[run.system], self.results.of_run(run)
        record = read_run_record(folder)
        if record is None:
            self.results.remove(folder)  # what a run that was killed has left
            record = run_system(
                system, sequence.folder, folder, stop=self._stop, names=run.placeholders, maps=self.order.maps
            )
        _tell(run, record, progress)
        scored = score_run(
            folder, record, sequence.truth, protocol=self.order.protocol, monocular=system.reads.monocular
        )
        for note in scored.notes:
            progress.note(f"{run.system} on {run.case.name}: {note}", f"{run.system} rotations")
        self.results.write(folder / ERRORS, frame_errors_text(scored.errors))
        show(self.results, run.case, sequence, worst_frames(scored.errors))
        of_map = {} if maps is None else maps.score(folder, scored, progress)
        self.results.write_json(folder / SCORES, {**scored.content, MAP: of_map})
        if self.origin.condition(run.case.setting).perturbation == CLEAN:
            _tell_clean(run, system.expects_clean, scored.content[STRICT], progress)
        progress.advance(len(sequence.truth))

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What the study evaluates, as plain JSON values: a study with another one goes into another folder."""
        systems = {name: _described(system) for name, system in self.systems.items()}
        how: dict[str, Any] = {"maps": self.order.maps, "protocol": self.order.protocol, "definitions": DEFINITIONS}
        if brought := {
            name: str(found)
            for registry in (METRICS, MAP_METRICS)
            for name in registry
            if (found := registry.distribution(name))
        }:
            how["metrics"] = brought
        return {**how, "subject": self.origin.identity, "systems": systems}


def _described(system: System) -> dict[str, Any]:
    expected = {} if system.expects_clean is None else {"expects_clean": asdict(system.expects_clean)}
    return {"digest": system.digest, "repeatable": system.repeatable, **expected}


def _tell(run: SystemRun, record: RunRecord, progress: Progress) -> None:
    """Say how a system ended that did not end well; once for each way."""
    if record.outcome is not Outcome.FINISHED:
        where = f"{run.system} on {run.case.name}"
        progress.note(f"{where}: {record.outcome.replace('_', ' ')}: {record.detail}", f"{run.system} {record.outcome}")


def _tell_clean(run: SystemRun, expected: ExpectedClean | None, scores: Mapping[str, Any], progress: Progress) -> None:
    """Say that a clean run is not as expected, before hours go into ratios to it; once for a system and scene."""
    if expected and (unmet := expected.unmet(scores.get("ate_rmse_m"), scores.get("scale"))):
        said = f"{run.system} on {run.case.name}: {', '.join(unmet)} on clean frames; expected: {expected.text}"
        progress.note(f"{said}. The report will mark its ratios", f"{run.system} {run.case.scene} {CLEAN}")
    ratio = scores.get(CONDITIONING)
    if ratio is not None and ratio < WELL_CONDITIONED:
        said = f"the path's second extent is {ratio:.2g} ATEs of {run.system} on {run.case.name}, below "
        said += (
            f"{WELL_CONDITIONED:g}, so positions do not say how an estimate is turned; the report will mark the scene"
        )
        progress.note(said, f"{run.case.scene} {CONDITIONING}")
