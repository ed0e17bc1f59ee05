# SPDX-License-Identifier: GPL-3.0-or-later
"""A run at an address: shards are made in a scratch folder, put there, and merged there into a packed dataset."""

import math
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..core.datasets.agreement import identity_mismatch
from ..core.datasets.dataset import Dataset
from ..core.datasets.dataset_state import MANIFEST_SHA256, RUN, WORK_FOLDER, journal_folders, read_dataset_state
from ..core.datasets.differences import why_not
from ..core.datasets.overview import looked_at
from ..core.datasets.provenance import plain_identity
from ..core.datasets.removal import remove_journals
from ..core.datasets.shard_merging import remove_shard
from ..core.datasets.shard_record import read_shard, shard_folder, shard_folders
from ..core.datasets.storage import FolderLock, storage_errors
from ..core.errors import BusyError, StorageError
from ..core.machine import peak_memory_bytes
from ..core.planning.estimate import estimate, size_text
from ..core.planning.plan import Plan
from ..core.planning.shards import Shard, render_of, shards_of
from ..core.presets.preset import canonical
from ..core.progress import Progress
from ..storage.address import Address
from ..storage.content import read_written
from ..storage.packing import claim, pack, remove_work, sealed_manifest
from ..storage.scratch_place import REMEDY, make_own, scratch_folder
from ..storage.shard_objects import ShardImages, StoredShard, get_shard, put_shard, record_of_shard, shard_records
from .completion import Completion
from .frame_maker import FrameMaker
from .report import Report, processors_of
from .run import SHARDS_PER_JOB, Work, Workers
from .shard import ShardMaker
from .stock import Finished, Holding
from .versions import versions_of

SHARD_BYTES = 10**9  # of a shard at most, roughly; chosen: several fit on any disk, and take minutes to put
UPLOADS = 2  # shards that are put while others are made; those that wait take room
ELSEWHERE = "choose another address with --out"


class AddressRun:
    """A run of a plan that ends in a packed dataset at an address."""

    def __init__(
        self,
        plan: Plan,
        address: Address,
        *,
        progress: Progress,
        stop: threading.Event,
        scratch: Path | None = None,
        jobs: int = 1,
    ) -> None:
        """Prepare a run. scratch: where shards are made; None for the system's folder of temporary files."""
        self._plan = plan
        self._address = address
        self._progress = progress
        self._stop = stop
        self._jobs = jobs
        self._scratch = scratch_folder(address, scratch)
        self._dataset = Dataset(self.folder, plan.format)
        self._images = ShardImages(address)
        self._shards: list[dict[str, Any]] = []  # the summaries of those that are there
        self._identity: dict[str, Any] = {}
        self.report = Report(jobs=jobs)

    @property
    def folder(self) -> Path:
        """The folder in which workers make shards, laid out as a dataset's."""
        return self._scratch / "dataset"

    def make_dataset(self, workers: Workers | None = None) -> Report:
        """Make what is missing of the dataset, put it to the address, and merge it there.

        Raises InterruptedRunError when stopped, StorageError where scratch folder or store refuse. Shards that are
        there stay, and another run of the same plan continues from there.
        """
        return self._run(lambda work: self._make(work, workers))

    def make_apart(self, workers: Workers, count: int) -> Report:
        """Make the dataset as `make_dataset` does, in about `count` shards that the workers put to the address."""

        def make(work: Work) -> None:
            shards = shards_of(self._plan, count, work) if work else ()
            if shards:
                self._start()
                self.report.merge(workers(shards, lambda shard: self._add(self._there(shard)), self._progress))
                self._progress.finish()

        return self._run(make)

    def merge(self, missing: Callable[[Work, list[Path]], StorageError]) -> Report:
        """Merge the shards at the address. missing: returns the error that says which frames are missing."""

        def refuse(work: Work) -> None:
            if work:
                raise missing(work, [])

        return self._run(refuse)

    def make_shard(self, shard: Shard, *, threads: int = 0) -> Report:
        """Make a shard and put it to the address, unless it is there."""
        render_of(self._plan, shard)
        if self._begin():
            return self.report
        if self._stored(record_of_shard(shard)) is not None:
            self._progress.note(f"{self._address.text}: holds this shard already")
            return self.report
        make_own(self._scratch)
        folder = self._scratch / "shards" / shard.folder_name
        with storage_errors(folder):
            folder.parent.mkdir(exist_ok=True)
        with ShardMaker(self._plan, progress=self._progress, stop=self._stop, threads=threads) as maker:
            report = maker.make(folder, shard)
        self._put(folder)
        self._tidy()
        return report

    # --- the course of a run ---

    def _run(self, make: Callable[[Work], None]) -> Report:
        """Look at what is there, make what is missing, and merge. make: gets the frames that are missing."""
        start_s = time.perf_counter()
        if self._begin():
            self._progress.note(f"{self._address.text}: holds this dataset already; nothing to do")
            self.report.frames_kept = self._plan.frame_count
            self._remove_left()
            return self.report
        make_own(self._scratch)
        try:
            lock = FolderLock(self._scratch / "lock")
        except BusyError as error:
            raise BusyError(f"{self._address.text}: another run of this machine is writing there") from error
        try:
            self._open_staging()
            self._put_left()
            self._take_stock()
            make(self._missing())
            self._merge(start_s)
        finally:
            self._progress.finish()
            self._dataset.close()
            lock.release()
        self._remove_staging()
        return self.report

    def _begin(self) -> bool:
        """Tell whether the dataset is there; else begin to write it. Raises StorageError where another one is there."""
        self._address.check()
        self._identity = plain_identity(self._plan, versions_of(self._plan))
        sealed = sealed_manifest(self._address)
        if sealed is not None:
            problem = self._difference(sealed["identity"]) or self._other_frames(sealed["frames"])
            if problem:
                remedy = f"a dataset at an address does not grow: {ELSEWHERE}"
                raise StorageError(f"{self._address.text}: holds another dataset: {problem}; {remedy}")
            remove_work(self._address)
            return True
        chosen = None if self._plan.chosen is None else [self._plan.chosen.start, self._plan.chosen.stop]
        there = claim(self._address, self._identity, chosen)
        problem = self._difference(there["identity"])
        if not problem and there["chosen"] != chosen:
            problem = f"other frames: --frames was {_spoken(there['chosen'])}, is {_spoken(chosen)}"
        if problem:
            raise StorageError(f"{self._address.text}: another dataset is being made there: {problem}; {ELSEWHERE}")
        return False

    @property
    def _any_processor(self) -> bool:
        return self._plan.preset.spec.render.processors == "any"

    def _difference(self, there: dict[str, Any]) -> str:
        """Return in which way what an identity says is another dataset than the plan's; "" where it is the same."""
        problem = (why_not(there, self._identity, self._plan) or "").partition("; ")[0]
        for one, other in ((there, self._identity), (self._identity, there)):
            problem = problem or identity_mismatch(one, other, any_processor=self._any_processor)
        return problem

    def _other_frames(self, counts: dict[str, int]) -> str:
        """Return which sequence has another number of frames than the plan's; "" where none has."""
        planned = {sequence.folder: len(sequence.frames) for sequence in self._plan.sequences if sequence.frames}
        folder = next((name for name in sorted({*counts, *planned}) if counts.get(name) != planned.get(name)), None)
        return "" if folder is None else f"{folder} has {counts.get(folder, 0)} frames, not {planned.get(folder, 0)}"

    def _open_staging(self) -> None:
        """Take the scratch folder: what an earlier run began to make stays, what it had read is forgotten."""
        standing = read_dataset_state(self.folder)
        other = standing is not None and standing.identity is not None and bool(self._difference(standing.identity))
        work = self.folder / WORK_FOLDER
        for sequence in journal_folders(work):
            remove_journals(work, sequence)
        if self.folder.is_dir():
            for path in self.folder.iterdir():
                if path.name != WORK_FOLDER:
                    _remove(path)
        self._dataset.open(self._identity, lambda there: self._difference(there) or None, overwrite=other)

    def _put_left(self) -> None:
        """Put the shards that an earlier run has finished, but not put."""
        for folder in shard_folders(self.folder):
            try:
                record = read_shard(folder)
            except ValueError:
                continue  # making it again says what is wrong with it
            if record is not None:
                self._put(folder)

    def _take_stock(self) -> None:
        """Read the records of the shards at the address."""
        for name in shard_records(self._address):
            if (stored := self._stored(name)) is not None:
                self._add(stored)

    def _stored(self, name: str) -> StoredShard | None:
        """Return a finished shard at the address. Raises StorageError where it does not belong to the dataset."""
        stored = get_shard(self._address, name)
        if stored is None:
            return None
        made_from = stored.record.identity
        if problem := identity_mismatch(self._identity, made_from, any_processor=self._any_processor):
            remedy = f"remove {name} there, and make the shard again"
            raise StorageError(
                f"{self._address.of(name)}: this shard does not belong to the dataset: {problem}; {remedy}"
            )
        return stored

    def _add(self, stored: StoredShard) -> None:
        for sequence, records in stored.record.frames.items():
            self._dataset.append_merged(sequence, records)
        self._images.add(stored)
        self._shards.append(stored.record.summary())

    def _missing(self) -> Work:
        """Return the source frames that a sequence needs for a missing image, by the name of the render."""
        work: Work = {}
        for render in self._plan.renders:
            finished = Finished([Holding(self._dataset, render)])
            if lacking := finished.lacking(render, self._plan.format.modalities, render.frames):
                work[render.name] = lacking
        self.report.frames_kept = self._plan.frame_count - sum(map(len, work.values()))
        return work

    # --- shards ---

    def _make(self, work: Work, workers: Workers | None) -> None:
        """Make frames in shards, and put each while the next are made."""
        if not work:
            return
        share = sum(map(len, work.values())) / self._plan.frame_count
        bytes_to_make = int(estimate(self._plan).bytes_written * share)
        least = SHARDS_PER_JOB * self._jobs if self._jobs > 1 else 1
        shards = shards_of(self._plan, max(least, math.ceil(bytes_to_make / SHARD_BYTES)), work)
        self._check_space(bytes_to_make, len(shards))
        self._start()
        waiting: list[Future[StoredShard]] = []
        with ThreadPoolExecutor(UPLOADS, thread_name_prefix="upload") as pool:

            def made(shard: Shard) -> None:
                waiting.append(pool.submit(self._put, shard_folder(self.folder, shard)))
                while len(waiting) > UPLOADS:  # so that the scratch folder does not fill up
                    self._add(waiting.pop(0).result())

            if workers is not None and self._jobs > 1:
                self.report.merge(workers(shards, made, self._progress))
            else:
                self._make_here(shards, made)
            for future in waiting:
                self._add(future.result())
        self._progress.finish()

    def _start(self) -> None:
        self._progress.start("rendering", self._plan.frame_count, self.report.frames_kept)
        if self._plan.format.note:
            self._progress.note(self._plan.format.note)

    def _there(self, shard: Shard) -> StoredShard:
        """Return a shard that another process has put to the address."""
        stored = self._stored(record_of_shard(shard))
        if stored is None:
            raise StorageError(
                f"{self._address.of(record_of_shard(shard))}: is gone or torn; run the same command again"
            )
        return stored

    def _make_here(self, shards: tuple[Shard, ...], made: Callable[[Shard], None]) -> None:
        with ShardMaker(self._plan, progress=self._progress, stop=self._stop) as maker:
            for shard in shards:
                self.report.add(
                    maker.make(shard_folder(self.folder, shard), shard, self._dataset, joining=True).content()
                )
                made(shard)

    def _put(self, folder: Path) -> StoredShard:
        """Put a finished shard to the address, and remove it here."""
        record = read_shard(folder)
        assert record is not None, "just made"
        stored = put_shard(self._address, folder, record)
        remove_shard(folder)
        return stored

    def _check_space(self, bytes_to_make: int, count: int) -> None:
        """Say where the scratch folder is too small for the shards that lie in it at once. The sizes are rough."""
        needed = bytes_to_make // count * min(count, self._jobs + UPLOADS)
        free = shutil.disk_usage(self._scratch).free
        if needed > free:
            told = f"about {size_text(needed)} are needed at once and {size_text(free)} are free"
            raise StorageError(f"{self._scratch}: no space for shards: {told}; make room, or {REMEDY}")

    # --- the end ---

    def _merge(self, start_s: float) -> None:
        """Write the text files, and pack all at the address."""
        paths = FrameMaker(self._plan, progress=self._progress, stop=self._stop)
        if self._plan.preset.spec.output.overview:
            self._fetch_pictured()
        manifest_sha256 = Completion(self._plan, self._dataset, paths.paths_of, self._note).write()

        def run_text() -> dict[str, bytes]:
            self.report.processors = processors_of(self._shards)
            self.report.total_s = time.perf_counter() - start_s
            self.report.merge(Report(peak_memory_bytes=peak_memory_bytes()))
            return {RUN: canonical({**self.report.content(), MANIFEST_SHA256: manifest_sha256}).encode()}

        pack(read_written(self.folder), self._images, self._address, self._progress, self._stop, beside=run_text)

    def _fetch_pictured(self) -> None:
        """Fetch the images that the contact sheet shows."""
        stamps_of = {scene.name: scene.source.frame_stamps for scene in self._plan.scenes}
        records = {item.folder: self._dataset.records(item.folder) for item in self._plan.sequences if item.frames}
        for folder, numbers in looked_at({folder: list(found) for folder, found in records.items()}).items():
            names = self._plan.format.names(stamps_of[folder.split("/")[1]])
            self._dataset.make_folders(folder)
            for number in sorted(numbers):
                for name in names.of(number):
                    digest = records[folder][number].files[name]
                    self._dataset.write_file(folder, name, self._images.read_one(f"{folder}/{name}", digest))

    def _note(self, text: str) -> None:
        self.report.notes.append(text)
        self._progress.note(text)

    def _remove_left(self) -> None:
        """Remove what a run left in the scratch folder that was killed when it had packed all."""
        if not self._scratch.is_dir():
            return
        make_own(self._scratch)  # which refuses a folder of somebody else's
        try:
            lock = FolderLock(self._scratch / "lock")
        except BusyError:
            return  # the run that packed all is removing it
        lock.release()
        shutil.rmtree(self._scratch / "shards", ignore_errors=True)
        self._remove_staging()

    def _remove_staging(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        (self._scratch / "lock").unlink(missing_ok=True)
        self._tidy()

    def _tidy(self) -> None:
        """Remove what is empty of the scratch folder."""
        for empty in (self._scratch / "shards", self._scratch):
            if empty.is_dir() and not any(empty.iterdir()):
                empty.rmdir()


def _remove(path: Path) -> None:
    with storage_errors(path):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _spoken(chosen: list[int | None] | None) -> str:
    if chosen is None:
        return "not given"
    start, stop = chosen
    return f"{start or 0}:{'' if stop is None else stop}"
