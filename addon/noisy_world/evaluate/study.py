# SPDX-License-Identifier: GPL-3.0-or-later
"""A study: systems, the sequences that they are run on, and the folder of results, which it fills case by case."""

import contextlib
import json
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.progress import Progress
from ..dataset.loader import Frame
from ..preset.keys import check_document
from ..trajectories.stamped_poses import tum_text
from .cases import CLEAN, Case, Outcome, RunRecord, SystemRun, read_run_record
from .indicators import indicators_of
from .map_metrics import MAP_METRICS, score_map
from .metrics import METRICS
from .pose_errors import CONDITIONING, DEFINITIONS, WELL_CONDITIONED, FrameErrors, columns_text, frame_errors_text
from .run_maps import map_of_run
from .study_results import (
    ERRORS,
    FRAMES,
    INDICATORS,
    MAP,
    SCORES,
    STRICT,
    THUMBS,
    TRUTH,
    ResultsFolder,
    Scored,
    score_run,
)
from .study_sequences import CaseSequence, FolderOrigin, Origin, PresetOrigin
from .system_runs import run_system
from .systems import ExpectedClean, System, find_systems, isolating
from .true_maps import TrueMap, true_map_of_mesh, true_map_of_recording

# What is kept of a sequence after its runs: the true path, indicators, and a few thumbnails.


THUMB_PX = 240  # the width of each of the two images beside each other
EVENLY = 3  # pictures along the sequence, beside the worst frames


def describe(results: ResultsFolder, case: Case, sequence: CaseSequence) -> None:
    """Write what stays of a sequence, if it is not there; the indicators last."""
    if results.is_described(case):
        return
    folder = results.of_case(case)
    numbers = list(sequence.opened.frames)
    show(results, case, sequence, _evenly(len(numbers)))
    results.write(folder / TRUTH, tum_text(sequence.truth))
    indicators = indicators_of(sequence.opened, sequence.clean)
    results.write(folder / FRAMES, columns_text({**indicators.per_frame, **severities(sequence.opened)}, {"index": 0}))
    results.write_json(folder / INDICATORS, {**_plain(indicators.values), "frames": len(numbers)})


def show(results: ResultsFolder, case: Case, sequence: CaseSequence, places: Iterable[int]) -> None:
    """Write small pictures of frames, by their places in the sequence, where they are not there."""
    numbers = list(sequence.opened.frames)
    for place in places:
        path = results.of_case(case) / THUMBS / f"{numbers[place]:06d}.jpg"
        if not path.is_file():
            results.write_bytes(path, _thumb(sequence, numbers[place]))


def severities(frames: Iterable[Frame]) -> dict[str, NDArray[np.float64]]:
    """Return the severity of each frame (N,) by perturbation, as severity_NAME; NaN where it was not perturbed so."""
    done = [[step for kind in ("rgb", "depth") for step in frame.done.get(kind, ())] for frame in frames]
    columns: dict[str, NDArray[np.float64]] = {}
    for place, steps in enumerate(done):
        for step in steps:
            column = columns.setdefault(f"severity_{step['name']}", np.full(len(done), np.nan))
            column[place] = step.get("severity", np.nan)
    return {name: column for name, column in columns.items() if np.isfinite(column).any()}


def worst_frames(errors: FrameErrors) -> list[int]:
    """Return the rows of the frame with the largest error, and of the first frame that is lost after a tracked one."""
    frames = [int(np.nanargmax(errors.error_m))] if np.isfinite(errors.error_m).any() else []
    begun = np.maximum.accumulate(errors.tracked) if len(errors) else errors.tracked
    lost = np.flatnonzero(begun & ~errors.tracked)
    return [*frames, *lost[:1].tolist()]


def _evenly(count: int) -> list[int]:
    return sorted({(2 * part + 1) * count // (2 * EVENLY) for part in range(EVENLY)}) if count else []


def _plain(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return numbers as JSON has them: what is not finite is null."""
    return {name: None if value is None or not np.isfinite(value) else float(value) for name, value in values.items()}


def _thumb(sequence: CaseSequence, number: int) -> bytes:
    """Return a small JPEG of a frame, beside its clean counterpart on the left if there is one."""
    import cv2

    shown = [sequence.opened[number].rgb]
    if sequence.clean is not None:
        shown.insert(0, sequence.clean[number].rgb)
    picture = np.hstack([_small(image) for image in shown])
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    assert done, "an image of bytes can be encoded"
    return data.tobytes()


def _small(image: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    import cv2

    assert image.dtype == np.uint8, "datasets of light, as EXR files hold it, are not evaluated"

    high, wide = image.shape[:2]
    size = (min(THUMB_PX, wide), max(1, round(high * min(THUMB_PX, wide) / wide)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


# Maps of a case's runs, held against the true scene: what the system wrote, or its frames fused along its path.


class MapsOfCase:
    """Scores the maps of a case's runs; the true map is made for the first of them."""

    def __init__(self, sequence: CaseSequence, closing: contextlib.ExitStack) -> None:
        """Take the sequence. closing: ends what the true map is seen with."""
        self._sequence = sequence
        self._closing = closing
        self._truth: TrueMap | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is something to hold a map against: the scene's mesh, or frames without noise."""
        sequence = self._sequence
        return sequence.opened.camera is not None and (sequence.mesh is not None or sequence.clean is not None)

    def score(self, folder: Path, scored: Scored, progress: Progress) -> dict[str, float | None]:
        """Return what is said of the map of the run in a folder; {} where nothing is there to hold it against."""
        camera = self._sequence.opened.camera
        if camera is None or not self.is_known:
            return {}
        frames = list(self._sequence.opened)
        mesh = map_of_run(folder, scored.estimate, scored.by, frames, camera)
        if mesh.problem and scored.by is not None:
            progress.note(f"{folder}: has no map: {mesh.problem}")
        return score_map(mesh.mesh, self._true()).values

    def _true(self) -> TrueMap:
        if self._truth is None:
            self._truth = self._closing.enter_context(self._made())
        return self._truth

    def _made(self) -> TrueMap:
        sequence = self._sequence
        camera = sequence.opened.camera
        assert camera is not None
        if sequence.mesh is not None:
            return true_map_of_mesh(sequence.mesh(), camera, sequence.truth.c2w)
        assert sequence.clean is not None
        return true_map_of_recording(list(sequence.clean), camera)


@contextlib.contextmanager
def maps_of(sequence: CaseSequence) -> Iterator[MapsOfCase]:
    """Return what scores the maps of a case's runs."""
    with contextlib.ExitStack() as closing:
        yield MapsOfCase(sequence, closing)


# The order for a study as plain values, which is sent to worker processes here and elsewhere.


@dataclass(frozen=True)
class StudyOrder:
    """What a study is to do.

    subject: the preset's file, or the folder of sequences. document: the preset's content, overrides included; None for
    a folder. out: the folder of results. systems: names, or files that define them. seeds: of the cases; () for the
    preset's own. repeats: of systems that do not repeat themselves. protocol: whose values and errors come first.
    scenes, settings: names or globs of those that are wanted of a folder; a preset's document says its own. keep:
    whether sequences stay. keep_clean: whether clean frames are kept while a scene is evaluated. maps: whether maps are
    scored too. isolate: what keeps systems apart whose definition says nothing of it; "none" for nothing. elsewhere:
    names of runs that are not done, as a record of the study has them.
    """

    subject: str
    document: dict[str, Any] | None
    out: str
    systems: tuple[str, ...]
    seeds: tuple[int, ...] = ()
    repeats: int = 3
    protocol: str = "strict"
    scenes: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    keep: bool = False
    keep_clean: bool = True
    maps: bool = False
    isolate: str = "none"
    elsewhere: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """The folder of results."""
        return Path(self.out)

    def text(self) -> str:
        """Return it as a line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> "StudyOrder":
        """Return the order in a line of JSON."""
        values = json.loads(text)
        listed = {name: tuple(values[name]) for name in ("systems", "seeds", "scenes", "settings", "elsewhere")}
        return cls(**{**values, **listed})


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
            return FolderOrigin(Path(order.subject), order.scenes, order.settings)
        preset = check_document(order.document, Path(order.subject))
        return PresetOrigin(
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
        _note_ending(run, record, progress)
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
            _note_clean_run(run, system.expects_clean, scored.content[STRICT], progress)
        progress.advance(len(sequence.truth))

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What the study evaluates, as plain JSON values: a study with another one goes into another folder."""
        systems = {name: _described(system) for name, system in self.systems.items()}
        how: dict[str, Any] = {"maps": self.order.maps, "protocol": self.order.protocol, "definitions": DEFINITIONS}
        if brought := {
            name: str(distribution)
            for registry in (METRICS, MAP_METRICS)
            for name in registry
            if (distribution := registry.distribution(name))
        }:
            how["metrics"] = brought
        return {**how, "subject": self.origin.identity, "systems": systems}


def _described(system: System) -> dict[str, Any]:
    expected = {} if system.expects_clean is None else {"expects_clean": asdict(system.expects_clean)}
    return {"digest": system.digest, "repeatable": system.repeatable, **expected}


def _note_ending(run: SystemRun, record: RunRecord, progress: Progress) -> None:
    """Say how a system ended that did not end well; once for each way."""
    if record.outcome is not Outcome.FINISHED:
        where = f"{run.system} on {run.case.name}"
        progress.note(f"{where}: {record.outcome.replace('_', ' ')}: {record.detail}", f"{run.system} {record.outcome}")


def _note_clean_run(
    run: SystemRun, expected: ExpectedClean | None, scores: Mapping[str, Any], progress: Progress
) -> None:
    """Say that a clean run is not as expected, before hours go into ratios to it; once for a system and scene."""
    if expected and (unmet := expected.unmet(scores.get("ate_rmse_m"), scores.get("scale"))):
        note = f"{run.system} on {run.case.name}: {', '.join(unmet)} on clean frames; expected: {expected.text}"
        progress.note(f"{note}. The report will mark its ratios", f"{run.system} {run.case.scene} {CLEAN}")
    ratio = scores.get(CONDITIONING)
    if ratio is not None and ratio < WELL_CONDITIONED:
        note = f"the path's second extent is {ratio:.2g} ATEs of {run.system} on {run.case.name}, below "
        note += (
            f"{WELL_CONDITIONED:g}, so positions do not say how an estimate is turned; the report will mark the scene"
        )
        progress.note(note, f"{run.case.scene} {CONDITIONING}")
