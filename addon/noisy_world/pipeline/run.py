# SPDX-License-Identifier: GPL-3.0-or-later
"""A run takes a plan to a dataset in one pass: what is there, what is to be made, make it, complete it, seal it.

Where the dataset lies, its destination knows (`destination`, `address_destination`).
"""

import math
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeAlias

from ..core.datasets.dataset_state import MANIFEST_SHA256
from ..core.datasets.provenance import plain_identity
from ..core.datasets.shard_record import shard_folder
from ..core.errors import StorageError
from ..core.machine import available_threads, peak_memory_bytes
from ..core.messages import Message
from ..core.planning.estimate import estimate
from ..core.planning.memory import check_memory
from ..core.planning.plan import Plan
from ..core.planning.plan_notes import plan_notes
from ..core.planning.shards import Shard
from ..core.presets.preset import canonical
from ..core.progress import Progress
from .completed_images import CompletedImages, FinishedImages, find_missing
from .completion import Completion
from .destination import SHARDS_PER_JOB, Destination, Made, Work
from .frame_maker import FrameMaker
from .report import Report, processors_of
from .shard import ShardMaker
from .versions import versions_of

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
            if any(render.scene is scene and work.get(render.name) for render in self._plan.renders):
                for text in scene.source.remarks(self._plan.cameras[scene.name]):
                    self._note(Message(f"{scene.name}: ", text))

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
