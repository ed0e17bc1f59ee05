# SPDX-License-Identifier: GPL-3.0-or-later
"""A run: it renders a plan's frames once, writes them for every setting, and completes the dataset."""

import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeAlias

from ..core.datasets.dataset import Dataset
from ..core.datasets.dataset_state import MANIFEST_SHA256, RUN
from ..core.datasets.differences import why_not
from ..core.datasets.provenance import plain_identity
from ..core.datasets.shard_merging import Merged, ShardRules, drop_unfinished, merge_shard, merged_shards
from ..core.datasets.shard_record import shard_folder
from ..core.errors import StorageError
from ..core.machine import available_threads, peak_memory_bytes
from ..core.planning.estimate import image_bytes, size_text
from ..core.planning.plan import Plan
from ..core.planning.shards import Shard, shards_of
from ..core.presets.preset import canonical
from ..core.progress import Progress
from .completion import Completion
from .frame_maker import FrameMaker
from .report import Report, processors_of
from .stock import Finished, Holding, take_stock
from .versions import versions_of

SHARDS_PER_JOB = 8  # chosen: the last shard of a run is a sixteenth of a job's work on average, so none waits long

Work: TypeAlias = dict[str, list[int]]
"""The source frames to render, by the name of the render."""

Made: TypeAlias = Callable[[Shard], None]
"""What is called with each shard that is finished, in its folder in the dataset."""

Workers: TypeAlias = Callable[[tuple[Shard, ...], Made, Progress], Report]
"""A function that makes shards in several processes, and returns when all are made."""


class Run:
    """A run: one execution of a plan into a folder."""

    def __init__(
        self,
        plan: Plan,
        out: Path,
        *,
        progress: Progress,
        stop: threading.Event,
        overwrite: bool = False,
        jobs: int = 1,
        workers: Workers | None = None,
        shards: int | None = None,
    ) -> None:
        """Prepare a run.

        stop: when set, the run ends after the current frame. workers: what starts the processes where there are
        several. shards: about how many shards they make; by default some for each of the jobs, if there are several.
        """
        self._plan = plan
        self._progress = progress
        self._overwrite = overwrite
        self._jobs = jobs
        self._workers = workers
        self._shards = shards if shards is not None or jobs == 1 else SHARDS_PER_JOB * jobs
        self._dataset = Dataset(out, plan.format)
        self._frames = FrameMaker(plan, progress=progress, stop=stop)
        self.report = Report(jobs=jobs)

    def make_dataset(self) -> Report:
        """Make the dataset, or the part of it that is missing.

        Raises InterruptedRunError when stopped, StorageError when the disk cannot be written. Finished frames stay, and
        another run of the same plan continues from there.
        """
        start_s = time.perf_counter()
        self._open(unfinished=True)
        try:
            work, needed_bytes = self._missing()
            self._check_space(needed_bytes)
            self._progress.start("rendering", self._plan.frame_count, self.report.frames_kept)
            if self._plan.format.note:
                self._progress.note(self._plan.format.note)
            if self._shards is not None and self._workers is not None and work:
                self._make_apart(shards_of(self._plan, self._shards, work), self._workers)
            else:
                self._make_here(work)
            self._progress.finish()
            self._complete(start_s)
        finally:
            self._progress.finish()
            self._dataset.close()
        return self.report

    def merge(self, missing: Callable[[Work, list[Path]], StorageError]) -> Report:
        """Merge the shards that are finished, and complete the dataset.

        missing: returns the error that says which frames are missing, given these and the folders of shards that are
        unfinished or under way.

        Raises that error; what was merged stays, and another merge continues from there.
        """
        start_s = time.perf_counter()
        self._open(unfinished=False)
        try:
            work, _ = self._missing()
            if work:
                raise missing(work, self._dataset.shards_left)
            if self._plan.chosen is None:
                drop_unfinished(self._dataset.shards_left)
            for summary in merged_shards(self._dataset.out):
                self.report.add(summary["report"])
            self.report.frames_kept = max(0, self.report.frames_kept - self.report.frames_rendered)
            self._complete(start_s)
        finally:
            self._dataset.close()
        return self.report

    def _open(self, *, unfinished: bool) -> None:
        """Take the folder, where what it holds can grow into the plan, with the shards that lie there."""
        made_from = plain_identity(self._plan, versions_of(self._plan))
        any_processor = self._plan.preset.spec.render.processors == "any"

        def refusal(there: dict[str, Any]) -> str | None:
            return why_not(there, made_from, self._plan)

        rules = ShardRules(unfinished=unfinished, any_processor=any_processor)
        self._dataset.open(made_from, refusal, overwrite=self._overwrite, shards=rules)
        for text in self._dataset.notes:
            self._note(text)

    def _missing(self) -> tuple[Work, int]:
        """Find what is to be rendered: the source frames that a sequence needs for a missing file.

        Returns that, and roughly how many bytes the missing files will have.
        """
        if self._dataset.holds_frames():
            self._progress.note("checking the frames that are there")
        work: Work = {}
        needed_bytes, told = 0, len(self._dataset.notes)
        for render in self._plan.renders:
            lacking = take_stock(self._dataset, self._plan, render)
            needed_bytes += lacking.bytes_to_write
            self.report.frames_kept += len(render.frames) - len(lacking.sources)
            if lacking.sources:
                work[render.name] = lacking.sources
        for text in self._dataset.notes[told:]:
            self._note(text)
        return work, needed_bytes

    def _check_space(self, needed_bytes: int) -> None:
        """Say where the disk is too small; raise StorageError where not even a frame fits. The sizes are rough."""
        out, free_bytes = self._dataset.out, shutil.disk_usage(self._dataset.out).free
        if needed_bytes <= free_bytes:
            return
        told = f"about {size_text(needed_bytes)} are to be written and {size_text(free_bytes)} are free"
        render = self._plan.renders[0]
        frame_bytes = sum(image_bytes(self._plan, render, modality) for modality in self._plan.format.modalities)
        if free_bytes < min(needed_bytes, frame_bytes):
            remedy = "make room there and run the same command again, or choose another folder with --out"
            raise StorageError(f"{out}: no space left: {told}; {remedy}")
        self._note(f"this will hardly fit: {told} in {out}; a run that fills the disk goes on once there is room")

    def _note(self, text: str) -> None:
        self.report.notes.append(text)
        self._progress.note(text)

    # --- frames ---

    def _make_here(self, work: Work) -> None:
        """Make frames in this process, in the dataset's own folder; a scene is in memory once for all its renders."""
        with self._frames as maker:
            for render in self._plan.renders:
                if frames := work.get(render.name):
                    maker.make(render, frames, self._dataset, Finished([Holding(self._dataset, render)]))
        self.report.merge(maker.report)

    def _make_apart(self, shards: tuple[Shard, ...], workers: Workers) -> None:
        """Let other processes make shards, and merge each while they make the next."""
        merging: list[Future[Merged]] = []
        with ThreadPoolExecutor(1, thread_name_prefix="merging") as pool:

            def made(shard: Shard) -> None:
                folder = shard_folder(self._dataset.out, shard)
                merging.append(pool.submit(merge_shard, self._dataset, folder))

            self.report.merge(workers(shards, made, self._progress))
        for merged in (future.result() for future in merging):
            if merged.damaged:
                where = f"{self._dataset.out / merged.damaged[0]}"
                raise StorageError(f"{where}: is not as it was written; look after the disk, and run it again")

    # --- text files ---

    def _complete(self, start_s: float) -> None:
        """Write the text files beside the images, and seal the dataset."""
        manifest_sha256 = Completion(self._plan, self._dataset, self._frames.paths_of, self._note).write()
        self.report.processors = processors_of(merged_shards(self._dataset.out))
        self.report.total_s = time.perf_counter() - start_s
        self.report.merge(Report(peak_memory_bytes=peak_memory_bytes()))
        self._dataset.write_text(RUN, canonical({**self.report.content(), MANIFEST_SHA256: manifest_sha256}))
        self._dataset.seal()


def threads_of_each(jobs: int) -> int:
    """Return how many threads the renderer has in each of several processes; 0 for all, in one."""
    return max(1, available_threads() // jobs) if jobs > 1 else 0
