# SPDX-License-Identifier: GPL-3.0-or-later
"""A run takes a plan to a dataset in a folder or at an address: what is there, what is to be made, make it, seal it.

A run takes a plan to a dataset in one pass: what is there, what is to be made, make it, complete it, seal it.

Where the dataset lies, its destination knows (`destination`, `address_destination`).
"""

import contextlib
import math
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any, Self, TypeAlias

from ..core.atomic_files import FolderLock, Hasher
from ..core.errors import Action, Message, StorageError, either
from ..core.file_access import canonical
from ..core.machine import available_threads, peak_memory_bytes
from ..core.progress import Progress
from ..sources.scene_kinds import Scene
from .completion import Completion
from .dataset_folder import CompletedImages, Dataset, FinishedImages, find_missing
from .estimate import check_memory, estimate, image_bytes, size_text
from .folder_state import MANIFEST_SHA256, RUN, WORK_FOLDER, identity_mismatch, why_not
from .identity import plain_identity, versions_of
from .making import FrameMaker, Report, processors_of
from .plan import Plan, Render, plan_notes
from .shards import (
    SHARD,
    OpenRun,
    Shard,
    ShardRecord,
    ShardRules,
    drop_unfinished,
    merge_shard,
    merged_shards,
    read_shard,
    remove_shard,
    render_of,
    shard_folder,
    shards_of,
    take_up,
    tidy,
)

# Making shards: each is made in a folder of its own, which may be anywhere, and is finished by its `shard.json`.


REPLACE = "remove that folder, or replace the shard with --overwrite"


class ShardMaker:
    """Makes one shard of a plan after another; a scene stays in memory between neighbours."""

    def __init__(self, plan: Plan, *, progress: Progress, stop: threading.Event, threads: int = 0) -> None:
        """Prepare. stop: when set, a shard ends after the current frame. threads: of the renderer; 0 for all.

        Raises NoisyWorldError where the plan's frames take more memory than there is.
        """
        check_memory(plan)
        self._plan = plan
        self._progress = progress
        self._frames = FrameMaker(plan, progress=progress, stop=stop, threads=threads)
        self._identities: dict[str, dict[str, Any]] = {}
        self._there: tuple[str, CompletedImages] | None = None  # of the render that was made last
        self._run: tuple[Path, OpenRun] | None = None  # by its folder

    def make(
        self,
        folder: Path,
        shard: Shard,
        there: Dataset | None = None,
        *,
        joining: bool = False,
        overwrite: bool = False,
    ) -> Report:
        """Make a shard in a folder, or the part of it that is missing there; return what was done.

        there: the dataset that it is for. What that has already is not made again; what it has of clean images is
        linked, or copied from another disk. joining: take part in a run that another process has opened, whose journals
        are believed; else the files that matter to the shard are hashed.

        The folder's files lie as in a dataset; one that has `shard.json` is finished: then its files are checked, and
        nothing else is done. Otherwise what a process has left there that was killed is taken up.

        Raises InterruptedRunError when stopped, BusyError where another process makes the shard, StorageError where the
        folder holds something else or the disk refuses.
        """
        render = render_of(self._plan, shard)
        identity = self._identity(render)
        if there is not None and joining:
            self._open_run(there.out).join(identity, any_processor=self._any_processor)
        start_s = time.perf_counter()
        self._frames.report = report = Report()
        if (folder / SHARD).exists() and self._is_whole(folder, identity, overwrite=overwrite):
            report.frames_kept = len(shard.frames_of(render.frames))
            report.total_s = time.perf_counter() - start_s
            return report
        completed = None if there is None else self._completed_images(there, render, shard, joining=joining)
        made = Dataset(folder, self._plan.format)
        made.open(identity, lambda other: self._why_not(other, identity), overwrite=overwrite)
        try:
            self._make_missing(made, render, shard, completed)
            report.total_s = time.perf_counter() - start_s
            made.finish_as_shard(self._record(made, render, shard, identity))
        finally:
            made.close()
        return report

    def check_dataset(self, there: Dataset, shard: Shard, folder: Path) -> None:
        """See whether a shard, which is made in a folder of it, can become part of a dataset, which others may write.

        Raises StorageError where the folder holds something else.
        """
        part = self._plan.only(render_of(self._plan, shard))
        identity = self._identity(part.renders[0])
        there.check(lambda other: why_not(other, identity, part), identity["sequences"], folder)

    def _open_run(self, out: Path) -> OpenRun:
        if self._run is None or self._run[0] != out:
            self._run = out, OpenRun(out)
        return self._run[1]

    @property
    def _any_processor(self) -> bool:
        return self._plan.preset.spec.render.processors == "any"

    def _identity(self, render: Render) -> dict[str, Any]:
        """Return what the frames of a render are made from; inputs are hashed once."""
        if render.name not in self._identities:
            part = self._plan.only(render)
            self._identities[render.name] = plain_identity(part, versions_of(part))
        return self._identities[render.name]

    def _why_not(self, there: dict[str, Any], here: dict[str, Any]) -> str:
        """Return why a folder with what one identity says is not that of a shard of another one, "" where it is."""
        difference = identity_mismatch(there, here, any_processor=self._any_processor)
        difference = difference or identity_mismatch(here, there, any_processor=self._any_processor)
        return f"{difference}; {REPLACE}" if difference else ""

    def _is_whole(self, folder: Path, identity: dict[str, Any], *, overwrite: bool) -> bool:
        """Check whether a finished shard's files are as its record says. If not, it is an unfinished one then.

        With overwrite it is removed.
        """
        lock = FolderLock(folder / WORK_FOLDER / "lock")
        try:
            record = self._read(folder)
            if record is not None and not overwrite:
                if problem := self._why_not(record.identity, identity):
                    raise StorageError(f"holds another shard: {problem}", file=folder)
                hasher = Hasher()
                if all(hasher.sha256(folder / path) == digest for path, _, digest in record.files()):
                    tidy(folder)
                    return True
                self._progress.note(f"{folder}: some files are not as they were made; they are made again")
                take_up(folder, record)
                return False
        finally:
            lock.release()
        remove_shard(folder)
        return False

    def _read(self, folder: Path) -> ShardRecord | None:
        try:
            return read_shard(folder)
        except ValueError as error:
            self._progress.note(f"{folder / SHARD} {error}; the shard is made again")
            return None

    def _make_missing(self, made: Dataset, render: Render, shard: Shard, there: CompletedImages | None) -> None:
        finished = FinishedImages([CompletedImages(made, render, hashed=True), *([] if there is None else [there])])
        wanted = shard.frames_of(render.frames)
        sources_missing = finished.sources_missing(render, self._plan.format.modalities, wanted)
        self._frames.report.frames_kept = len(wanted) - len(sources_missing)
        self._progress.start(shard.name, len(wanted), len(wanted) - len(sources_missing))
        try:
            if sources_missing:
                self._frames.make(render, sources_missing, made, finished)
        finally:
            self._progress.finish()

    def _completed_images(self, there: Dataset, render: Render, shard: Shard, *, joining: bool) -> CompletedImages:
        """Return what the dataset has of a render. Its journals are read once: others add no frames of this process."""
        if not joining:
            return CompletedImages(there, render, checked=shard)
        if self._there is None or self._there[0] != render.name:
            self._there = render.name, CompletedImages(there, render)
        return self._there[1]

    def _record(self, made: Dataset, render: Render, shard: Shard, identity: dict[str, Any]) -> ShardRecord:
        made.read_on()
        frames = {sequence.folder: tuple(made.records(sequence.folder).values()) for sequence in render.sequences}
        frames = {folder: records for folder, records in frames.items() if records}
        report = replace(self._frames.report, peak_memory_bytes=peak_memory_bytes())
        sizes: dict[tuple[int, int], int] = {}  # by device and number of the file
        record = ShardRecord(shard, identity, frames, 0, report.content())
        for path, _, _ in record.files():
            found = (made.out / path).stat()
            sizes[found.st_dev, found.st_ino] = found.st_size
        return replace(record, size_bytes=sum(sizes.values()))

    def close(self) -> None:
        """Let go of the scene that is in memory."""
        self._frames.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


# Where a run's dataset goes: a folder, in which frames lie where they are made.


SHARDS_PER_JOB = 8  # chosen: the last shard of a run is a sixteenth of a job's work on average, so none waits long

Work: TypeAlias = dict[str, list[int]]
"""The source frames to render, by the name of the render."""

Made: TypeAlias = Callable[[Shard], None]
"""What is called with each shard that is finished."""


class Destination:
    """A folder as where a dataset goes; other places differ from it.

    dataset: is written to while it is open. looking: what is said while it is asked what is there.
    merged_by_workers: whether those who make shards merge them.
    """

    looking = "checking the frames that are there"
    merged_by_workers = True

    def __init__(self, plan: Plan, folder: Path) -> None:
        """Take a plan and the dataset's folder, which `open` makes."""
        self._plan = plan
        self.folder = folder
        self.dataset = Dataset(folder, plan.format)

    def __str__(self) -> str:
        """Return the place for messages."""
        return str(self.folder)

    @property
    def _any_processor(self) -> bool:
        return self._plan.preset.spec.render.processors == "any"

    def open(self, identity: dict[str, Any], *, overwrite: bool, unfinished: bool) -> bool:
        """Take the place for a run that makes what an identity says; False where nothing of it is to be made.

        unfinished: as of `ShardRules`. Raises StorageError where something else is there, BusyError where another run
        is at it.
        """
        rules = ShardRules(unfinished=unfinished, any_processor=self._any_processor)

        def problem(there: dict[str, Any]) -> str | None:
            return why_not(there, identity, self._plan)

        self.dataset.open(identity, problem, overwrite=overwrite, shards=rules)
        return True

    def completed(self, render: Render) -> CompletedImages:
        """Return the images of a render that are there; here every file is hashed."""
        return CompletedImages(self.dataset, render, hashed=True)

    def cut(self, work: Work, needed_bytes: int, count: int | None, jobs: int) -> tuple[Shard, ...] | None:
        """Return the shards in which frames are made; None where they go straight into the dataset.

        needed_bytes: roughly what is to be written. count: about how many shards several processes are to make, None
        for one process. jobs: how many processes. Raises StorageError where there is no room.
        """
        del jobs
        self._check_space(needed_bytes)
        return None if count is None or not work else shards_of(self._plan, count, work)

    def _check_space(self, needed_bytes: int) -> None:
        """Note where the disk is too small; raise StorageError where not even a frame fits. The sizes are rough."""
        free_bytes = shutil.disk_usage(self.folder).free
        if needed_bytes <= free_bytes:
            return
        message = f"about {size_text(needed_bytes)} are to be written and {size_text(free_bytes)} are free"
        render = self._plan.renders[0]
        frame_bytes = sum(image_bytes(self._plan, render, modality) for modality in self._plan.format.modalities)
        if free_bytes < min(needed_bytes, frame_bytes):
            remedy = either(Message("make room there and ", Action.RUN_AGAIN), Action.OTHER_FOLDER)
            raise StorageError(f"no space left: {message}", file=self.folder, remedy=remedy)
        fits = "this will hardly fit"
        self.dataset.notes.append(f"{fits}: {message} in {self}; a run that fills the disk goes on once there is room")

    @contextlib.contextmanager
    def making(
        self,
        progress: Progress,
        stop: Event,
        *,
        threads: int = 0,
        overwrite: bool = False,
        joining: bool = False,
        merging: bool = False,
    ) -> Iterator[Callable[[Shard], Report]]:
        """Return what makes shards, for whoever runs beside the run that takes them in; see `ShardMaker.make`.

        merging: whether each is merged at once, by this process: one for all of a cluster could not keep up.
        """
        with ShardMaker(self._plan, progress=progress, stop=stop, threads=threads) as maker:

            def make(shard: Shard) -> Report:
                folder = shard_folder(self.folder, shard)
                if not joining:
                    maker.check_dataset(self.dataset, shard, folder)
                report = maker.make(folder, shard, self.dataset, joining=joining, overwrite=overwrite)
                if merging:
                    self._merge(folder)
                return report

            yield make

    def _merge(self, folder: Path) -> None:
        """Merge a finished shard. Raises StorageError where a file is damaged already."""
        if damaged := merge_shard(self.dataset, folder).damaged:
            where = f"{self.folder / damaged[0]}"
            raise StorageError("is not as it was written", file=where, remedy="look after the disk, and run it again")

    @contextlib.contextmanager
    def taking(self) -> Iterator[Made]:
        """Take in shards while others are made; all are in at the end of the block. Here, who makes one merges it."""

        def made(shard: Shard) -> None:
            del shard

        yield made

    def merged(self) -> list[dict[str, Any]]:
        """Return the summaries of the shards that the dataset was made from."""
        return merged_shards(self.folder)

    def drop_unfinished(self) -> None:
        """Remove shards that are unfinished, where nothing is missing."""
        if self._plan.chosen is None:
            drop_unfinished(self.dataset.shards_left)

    def fetch_pictured(self) -> None:
        """Have the images in the dataset's folder that its contact sheet shows."""

    def seal(self, run_text: Callable[[], str], progress: Progress, stop: Event) -> None:
        """End the dataset, whose manifest is written. run_text: returns run.json."""
        del progress, stop
        self.dataset.write_text(RUN, run_text())
        self.dataset.seal()

    def close(self) -> None:
        """Let go of the place."""
        self.dataset.close()


LEAST_SHARD_S = 1.0  # of a shard for a process of this machine; chosen: opening and merging one takes some 50 ms

Workers: TypeAlias = Callable[[tuple[Shard, ...], Made, Progress], Report]
"""A function that makes shards in several processes, and returns when all are made."""


class Run:
    """A run: one execution of a plan."""

    def __init__(
        self,
        plan: Plan,
        out: Path | Destination,
        *,
        progress: Progress,
        stop: threading.Event,
        overwrite: bool = False,
        jobs: int = 1,
        workers: Workers | None = None,
        shards: int | None = None,
        frames: FrameMaker | None = None,
        versions: Callable[[], dict[str, str]] | None = None,
    ) -> None:
        """Prepare a run.

        out: a folder, or another destination. stop: when set, the run ends after the current frame. workers: what
        starts the processes where there are several. shards: about how many shards they make; by default some for each
        of the jobs, if there are several. frames: makes those that this process makes, where it has a scene or clean
        frames already. versions: returns those of `versions_of`, where it is not this process that loads the renderer.
        """
        self._plan = plan
        self._progress = progress
        self._stop = stop
        self._overwrite = overwrite
        self._jobs = jobs
        self._workers = workers if jobs > 1 or shards is not None else None
        self._shards = shards
        self._out = Destination(plan, out) if isinstance(out, Path) else out
        self._frames = FrameMaker(plan, progress=progress, stop=stop) if frames is None else frames
        self._versions = versions or partial(versions_of, plan)
        self._notes_told = 0
        self.report = Report(jobs=jobs)

    def make_dataset(self) -> Report:
        """Make the dataset, or the part of it that is missing.

        Raises InterruptedRunError when stopped, StorageError when the disk or a store cannot be written. Finished
        frames stay, and another run of the same plan continues from there. NoisyWorldError where its frames take more
        memory than there is.
        """
        if self._workers is None:
            check_memory(self._plan)
        return self._through(self._make, unfinished=True)

    def merge(self, missing: Callable[[Work, list[Path]], StorageError]) -> Report:
        """Merge the shards that are finished, and complete the dataset.

        missing: returns the error that says which frames are missing, given these and the folders of shards that are
        unfinished or under way.

        Raises that error; what was merged stays, and another merge continues from there.
        """

        def merge(work: Work, needed_bytes: int) -> None:
            del needed_bytes
            if work:
                raise missing(work, self._out.dataset.shards_left)
            self._out.drop_unfinished()
            for summary in self._out.merged():
                self.report.add(summary["report"])
            self.report.frames_kept = max(0, self.report.frames_kept - self.report.frames_rendered)

        return self._through(merge, unfinished=False)

    # --- the pass ---

    def _through(self, make: Callable[[Work, int], None], *, unfinished: bool) -> Report:
        """Go from the plan to the sealed dataset.

        make: makes what is missing, given that and roughly its bytes. unfinished: whether what is finished of
        unfinished shards is merged too.
        """
        start_s = time.perf_counter()
        self.report.refused = {item.folder: f"{item.setting} {item.why}" for item in self._plan.refused}
        try:
            made_from = plain_identity(self._plan, self._versions())
            if self._out.open(made_from, overwrite=self._overwrite, unfinished=unfinished):
                self._tell_notes()
                make(*self._missing())
                self._seal(start_s)
            else:
                self._progress.note(f"{self._out}: holds this dataset already; nothing to do")
                self.report.frames_kept = self._plan.frame_count
        finally:
            self._progress.finish()
            self._out.close()
        return self.report

    def _missing(self) -> tuple[Work, int]:
        """Find what is to be made: the source frames that a sequence needs for a missing file, and roughly the bytes.

        Files that are there are hashed, where they lie in a folder.
        """
        if self._out.dataset.holds_frames():
            self._progress.note(self._out.looking)
        work: Work = {}
        needed_bytes = 0
        for render in self._plan.renders:
            missing = find_missing(self._plan, render, self._out.completed(render))
            needed_bytes += missing.bytes_to_write
            self.report.frames_kept += len(render.frames) - len(missing.sources)
            if missing.sources:
                work[render.name] = missing.sources
        self._tell_notes()
        return work, needed_bytes

    def _make(self, work: Work, needed_bytes: int) -> None:
        """Make what is missing: straight into the dataset, or in shards, which other processes may make."""
        count = None if self._workers is None else self._shards or self._useful_shards(work)
        shards = self._out.cut(work, needed_bytes, count, self._jobs)
        self._tell_notes()
        self._progress.start("rendering", self._plan.frame_count, self.report.frames_kept)
        if self._plan.format.note:
            self._progress.note(self._plan.format.note)
        for text in plan_notes(self._plan):
            self._note(text)
        self._remark(work)
        if shards is None:
            self._make_here(work)
        elif shards:
            with self._out.taking() as made:
                if self._workers is not None:
                    self.report.merge(self._workers(shards, made, self._progress))
                else:
                    self._make_shards_here(shards, made)
        self._progress.finish()

    def _useful_shards(self, work: Work) -> int:
        """Return about how many shards several processes make: some each, where there is work for so many."""
        left = sum(map(len, work.values())) / max(1, self._plan.frame_count)
        worth = math.ceil(left * estimate(self._plan).seconds / LEAST_SHARD_S)
        return min(SHARDS_PER_JOB * self._jobs, max(self._jobs, worth))

    def _remark(self, work: Work) -> None:
        """Say what is to be known of the scenes of which frames are missing."""
        for scene in self._plan.scenes:
            renders = [render for render in self._plan.renders if render.scene is scene]
            if making := sum(len(work.get(render.name, ())) * len(render.sequences) for render in renders):
                for text in self._remarks(scene, making):
                    self._note(Message(f"{scene.name}: ", text))

    def _remarks(self, scene: Scene, making: int) -> Iterable[str]:
        """Return what is to be known of a scene; of a recorded one also what is found in its frames."""
        source, camera = scene.source, self._plan.cameras[scene.name]
        if not source.capabilities.recorded:
            return source.remarks(camera)
        from ..measure.looking import remarks_on  # which is nothing for others

        return remarks_on(source, camera, making)

    def _make_here(self, work: Work) -> None:
        """Make frames in this process, in the dataset's own folder; a scene is in memory once for all its renders."""
        dataset = self._out.dataset
        with self._frames as maker:
            for render in self._plan.renders:
                if frames := work.get(render.name):
                    maker.make(render, frames, dataset, FinishedImages([CompletedImages(dataset, render)]))
        self.report.merge(maker.report)

    def _make_shards_here(self, shards: tuple[Shard, ...], made: Made) -> None:
        dataset = self._out.dataset
        with ShardMaker(self._plan, progress=self._progress, stop=self._stop) as maker:
            for shard in shards:
                report = maker.make(shard_folder(dataset.out, shard), shard, dataset, joining=True)
                self.report.add(report.content())
                made(shard)

    def _seal(self, start_s: float) -> None:
        """Write the text files beside the images, and seal the dataset."""
        self._out.fetch_pictured()
        manifest_sha256 = Completion(self._plan, self._out.dataset, self._frames.paths_of, self._note).write()

        def run_text() -> str:
            self.report.processors = processors_of(self._out.merged())
            self.report.total_s = time.perf_counter() - start_s
            self.report.merge(Report(peak_memory_bytes=peak_memory_bytes()))
            return canonical({**self.report.content(), MANIFEST_SHA256: manifest_sha256})

        self._out.seal(run_text, self._progress, self._stop)

    def _tell_notes(self) -> None:
        """Say what the dataset has noted since this was called last."""
        notes = self._out.dataset.notes
        for text in notes[self._notes_told :]:
            self._note(text)
        self._notes_told = len(notes)

    def _note(self, text: str) -> None:
        self.report.notes.append(text)
        self._progress.note(text)


def threads_of_each(jobs: int) -> int:
    """Return how many threads the renderer has in each of several processes; 0 for all, in one."""
    return max(1, available_threads() // jobs) if jobs > 1 else 0
