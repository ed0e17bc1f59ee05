# SPDX-License-Identifier: GPL-3.0-or-later
"""An address as where a dataset goes: shards are made in a scratch folder, put there, and packed there at the end."""

import contextlib
import math
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..core.atomic_files import FolderLock, sha256_of_bytes, storage_errors
from ..core.errors import BusyError, StorageError
from ..core.frame_table import remove_journals
from ..core.progress import Progress
from .completion import needed_frames
from .dataset_folder import CompletedImages
from .estimate import size_text
from .folder_state import RUN, WORK_FOLDER, identity_mismatch, read_dataset_state, why_not
from .identity import plain_identity, versions_of
from .making import Report
from .packing import ShardImages, StoredShard, get_shard, pack, put_shard, record_of_shard, shard_records, take
from .plan import Plan, Render
from .run import SHARDS_PER_JOB, Destination, Made, ShardMaker, Work
from .shards import Shard, read_shard, remove_shard, render_of, shard_folder, shard_folders, shards_of
from .store import Store
from .stored import written_dataset

SHARD_BYTES = 10**9  # of a shard at most, roughly; chosen: several fit on any disk, and take minutes to put
UPLOADS = 2  # shards that are put while others are made; those that wait take room
REMEDY = "name another folder with --scratch"


class AddressDestination(Destination):
    """A packed dataset at an address. folder: in which workers of this machine make shards, laid out as a dataset's."""

    looking = "reading which frames are there"
    merged_by_workers = False

    def __init__(self, plan: Plan, store: Store, scratch: Path | None = None, *, put_by_workers: bool = False) -> None:
        """Prepare.

        scratch: where shards are made; None for the system's folder of temporary files. put_by_workers: workers are on
        other machines, and put shards to the address themselves.
        """
        parent = Path(tempfile.gettempdir()) if scratch is None else scratch
        self._scratch = parent.absolute() / f"noisy-world-{sha256_of_bytes(store.text.encode())[:16]}"
        super().__init__(plan, self._scratch / "dataset")  # the same for each run there, so that a run goes on
        self._store = store
        self._put_by_workers = put_by_workers
        self._images = ShardImages(store)
        self._shards: list[dict[str, Any]] = []  # the summaries of those that are there
        self._identity: dict[str, Any] = {}
        self._lock: FolderLock | None = None
        self._sealed = False

    def __str__(self) -> str:
        return self._store.text

    # --- what is there ---

    def open(self, identity: dict[str, Any], *, overwrite: bool, unfinished: bool) -> bool:
        """Claim the address, take the scratch folder, and read the records of the shards that are there."""
        del overwrite, unfinished
        if not self._take(identity):
            self._remove_left()
            return False
        _make_own(self._scratch)
        try:
            self._lock = FolderLock(self._scratch / "lock")
        except BusyError as error:
            raise BusyError("another run of this machine is writing there", file=self) from error
        self._open_staging()
        for folder in shard_folders(self.folder):  # that an earlier run has finished, but not put
            with contextlib.suppress(ValueError):  # making it again says what is wrong with it
                if read_shard(folder) is not None:
                    self._put(folder)
        for name in shard_records(self._store):
            if (stored := self._stored(name)) is not None:
                self._add(stored)
        return True

    def _take(self, identity: dict[str, Any]) -> bool:
        """Begin to write the dataset, or go on; False where it is there already, finished."""
        self._identity = identity
        chosen = None if self._plan.chosen is None else [self._plan.chosen.start, self._plan.chosen.stop]
        return take(self._store, identity, chosen, self._difference, self._other_frames)

    def _difference(self, there: dict[str, Any]) -> str:
        """Return in which way what an identity says is another dataset than the plan's; "" where it is the same."""
        problem = (why_not(there, self._identity, self._plan) or "").partition("; ")[0]
        for one, other in ((there, self._identity), (self._identity, there)):
            problem = problem or identity_mismatch(one, other, any_processor=self._any_processor)
        return problem

    def _other_frames(self, manifest: dict[str, Any]) -> str:
        """Return which sequence has another number of frames than the plan's; "" where none has."""
        counts: dict[str, int] = manifest["frames"]
        planned = {sequence.folder: len(sequence.frames) for sequence in self._plan.sequences if sequence.frames}
        folder = next((name for name in sorted({*counts, *planned}) if counts.get(name) != planned.get(name)), None)
        return "" if folder is None else f"{folder} has {counts.get(folder, 0)} frames, not {planned.get(folder, 0)}"

    def _open_staging(self) -> None:
        """Take the scratch folder: what an earlier run began to make stays, what it had read is forgotten."""
        state = read_dataset_state(self.folder)
        other = state is not None and state.identity is not None and bool(self._difference(state.identity))
        work = self.folder / WORK_FOLDER
        remove_journals(work)
        if self.folder.is_dir():
            for path in self.folder.iterdir():
                if path.name != WORK_FOLDER:
                    _remove(path)
        self.dataset.open(self._identity, lambda there: self._difference(there) or None, overwrite=other)

    def _stored(self, name: str) -> StoredShard | None:
        """Return a finished shard at the address. Raises StorageError where it does not belong to the dataset."""
        stored = get_shard(self._store, name)
        if stored is None:
            return None
        made_from = stored.record.identity
        if problem := identity_mismatch(self._identity, made_from, any_processor=self._any_processor):
            remedy = f"remove {name} there, and make the shard again"
            raise StorageError(
                f"this shard does not belong to the dataset: {problem}", file=self._store.of(name), remedy=remedy
            )
        return stored

    def _add(self, stored: StoredShard) -> None:
        self.dataset.append_merged(stored.record.frames)
        self._images.add(stored)
        self._shards.append(stored.record.summary())

    # --- what is to be made ---

    def completed(self, render: Render) -> CompletedImages:
        """Return the images of a render that shards hold."""
        return CompletedImages(self.dataset, render)

    def cut(self, work: Work, needed_bytes: int, count: int | None, jobs: int) -> tuple[Shard, ...] | None:
        """Return the shards in which frames are made, of which several fit into the scratch folder."""
        if not work:
            return ()
        if self._put_by_workers:
            return shards_of(self._plan, count or 1, work)
        least = SHARDS_PER_JOB * jobs if jobs > 1 else 1
        shards = shards_of(self._plan, max(least, math.ceil(needed_bytes / SHARD_BYTES)), work)
        at_once = needed_bytes // len(shards) * min(len(shards), jobs + UPLOADS)
        free = shutil.disk_usage(self._scratch).free
        if at_once > free:
            message = f"about {size_text(at_once)} are needed at once and {size_text(free)} are free"
            raise StorageError(f"no space for shards: {message}", file=self._scratch, remedy=f"make room, or {REMEDY}")
        return shards

    # --- shards ---

    @contextlib.contextmanager
    def taking(self) -> Iterator[Made]:
        """Put shards while others are made."""
        if self._put_by_workers:
            yield lambda shard: self._add(self._there(shard))
            return
        waiting: list[Future[StoredShard]] = []
        with ThreadPoolExecutor(UPLOADS, thread_name_prefix="upload") as pool:

            def made(shard: Shard) -> None:
                waiting.append(pool.submit(self._put, shard_folder(self.folder, shard)))
                while len(waiting) > UPLOADS:  # so that the scratch folder does not fill up
                    self._add(waiting.pop(0).result())

            yield made
            for future in waiting:
                self._add(future.result())

    def _there(self, shard: Shard) -> StoredShard:
        """Return a shard that another process has put to the address."""
        name = record_of_shard(shard)
        if (stored := self._stored(name)) is None:
            raise StorageError("is gone or torn", file=self._store.of(name), remedy="run the same command again")
        return stored

    def _put(self, folder: Path) -> StoredShard:
        """Put a finished shard to the address, and remove it here."""
        record = read_shard(folder)
        assert record is not None, "just made"
        stored = put_shard(self._store, folder, record)
        remove_shard(folder)
        return stored

    def merged(self) -> list[dict[str, Any]]:
        """Return the summaries of the shards at the address."""
        return self._shards

    @contextlib.contextmanager
    def making(
        self,
        progress: Progress,
        stop: threading.Event,
        *,
        threads: int = 0,
        overwrite: bool = False,
        joining: bool = False,
        merging: bool = False,
    ) -> Iterator[Callable[[Shard], Report]]:
        """Return what makes shards and puts them to the address, unless they are there; no run needs to be open."""
        del overwrite, joining, merging
        with ShardMaker(self._plan, progress=progress, stop=stop, threads=threads) as maker:

            def make(shard: Shard) -> Report:
                render_of(self._plan, shard)
                if not self._take(self._identity or plain_identity(self._plan, versions_of(self._plan))):
                    return Report()
                if self._stored(record_of_shard(shard)) is not None:
                    progress.note(f"{self}: holds this shard already")
                    return Report()
                _make_own(self._scratch)
                folder = self._scratch / "shards" / shard.folder_name
                with storage_errors(folder):
                    folder.parent.mkdir(exist_ok=True)
                report = maker.make(folder, shard)
                self._put(folder)
                self._tidy()
                return report

            yield make

    # --- the end ---

    def fetch_pictured(self) -> None:
        """Fetch the images that the contact sheet shows."""
        if not self._plan.preset.spec.output.overview:
            return
        stamps_of = {scene.name: scene.source.frame_stamps for scene in self._plan.scenes}
        self.dataset.read_on()
        records = {item.folder: self.dataset.records(item.folder) for item in self._plan.sequences if item.frames}
        for folder, numbers in needed_frames({folder: list(found) for folder, found in records.items()}).items():
            names = self._plan.format.names(stamps_of[folder.split("/")[1]])
            self.dataset.make_folders(folder)
            for number in sorted(numbers):
                for name in names.of(number):
                    digest = records[folder][number].files[name]
                    self.dataset.write_file(folder, name, self._images.read_one(f"{folder}/{name}", digest))

    def seal(self, run_text: Callable[[], str], progress: Progress, stop: threading.Event) -> None:
        """Pack all at the address."""
        written = written_dataset(self.folder)
        pack(written, self._images, self._store, progress, stop, beside=lambda: {RUN: run_text().encode()})
        self._sealed = True

    def close(self) -> None:
        """Release the scratch folder, and remove it where it has served."""
        self.dataset.close()
        if self._lock is not None:
            self._lock.release()
        if self._sealed:
            self._remove_staging()

    def _remove_left(self) -> None:
        """Remove what a run left in the scratch folder that was killed when it had packed all."""
        if not self._scratch.is_dir():
            return
        _make_own(self._scratch)  # which refuses a folder of somebody else's
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


def _make_own(folder: Path) -> None:
    """Make a folder, unless a run left it there.

    Raises StorageError where it cannot be made, and where it is not this user's own: others could change there what is
    published.
    """
    with storage_errors(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        own = sys.platform == "win32" or folder.lstat().st_uid == os.geteuid()
    if folder.is_symlink() or not folder.is_dir() or not own:
        raise StorageError("is not a folder of this user's own", file=folder, remedy=REMEDY)
