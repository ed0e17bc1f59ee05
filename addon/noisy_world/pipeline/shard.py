# SPDX-License-Identifier: GPL-3.0-or-later
"""Making shards: each is made in a folder of its own, which may be anywhere, and is finished by its `shard.json`."""

import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from ..core.datasets.dataset import Dataset
from ..core.datasets.dataset_state import WORK_FOLDER
from ..core.datasets.differences import why_not
from ..core.datasets.hashing import Hasher
from ..core.datasets.identity_mismatch import identity_mismatch
from ..core.datasets.open_run import OpenRun
from ..core.datasets.provenance import plain_identity
from ..core.datasets.shard_merging import remove_shard, take_up, tidy
from ..core.datasets.shard_record import SHARD, ShardRecord, read_shard
from ..core.datasets.storage import FolderLock
from ..core.errors import StorageError
from ..core.machine import peak_memory_bytes
from ..core.planning.memory import check_memory
from ..core.planning.plan import Plan, Render
from ..core.planning.shards import Shard, render_of
from ..core.progress import Progress
from .completed_images import CompletedImages, FinishedImages, keep_intact
from .frame_maker import FrameMaker
from .report import Report
from .versions import versions_of

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
        names = self._plan.format.names(render.scene.source.frame_stamps)
        for sequence in render.sequences:
            keep_intact(made, sequence, names)
        finished = FinishedImages([CompletedImages(made, render), *([] if there is None else [there])])
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
