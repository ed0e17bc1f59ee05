# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a dataset has come: what is done, what is missing or damaged, and how long the rest will take.

Everything is read from the dataset's folder or address, while a run writes there or after that; the preset is not
needed, and nothing is changed.
"""

import contextlib
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..core.atomic_files import sha256_of_bytes
from ..core.errors import StorageError
from ..core.file_access import parse_json
from ..core.progress import Progress
from .folder_state import (
    IDENTITY,
    MANIFEST,
    RUN,
    UNCHECKED,
    WORK_FOLDER,
    DatasetState,
    check_no_links,
    manifest_sha256_in,
    merged_identity,
    read_dataset_state,
)
from .identity import Described, identity_problem
from .packing import CLAIM, PACKED_SEQUENCES, PLACE, StoredShard, claimed, damaged_contents, get_shard, shard_records
from .shards import ShardRecord, merged_shards, read_shard, shard_folders
from .store import Store, open_store
from .stored import (
    Digests,
    FileInventory,
    FolderDataset,
    JournalTimes,
    PackedDataset,
    Recorded,
    StoredDataset,
    StoredPart,
    folder_part,
    hashed_part,
    is_packed,
    journals_of,
    sealed_state,
)

# How fast a run goes, by when its newest files were written, and how long the rest takes at that pace.
#
# Frames differ in cost: a frame of a render of its own takes many times what a link to a clean image takes. So the pace
# is in seconds of the estimate a second, and what is left is weighed in the same way.


WINDOW_S = 600.0  # of the newest files that count: long enough for a scene to be loaded in it, chosen
SILENCE_S = 60.0  # without a new file for this long, and for ten times the usual, no run seems to go on; chosen


@dataclass(frozen=True)
class RunPace:
    """How fast a run goes.

    last_s: seconds since the newest frame was written, None without one. frames_per_s: of all sequences together, over
    the last `window_s`; None where that is unknown. left_s: what the rest takes at that pace, None where unknown.
    """

    last_s: float | None = None
    window_s: float = 0.0
    frames_per_s: float | None = None
    left_s: float | None = None

    @property
    def silent(self) -> bool:
        """Whether no run seems to go on."""
        usual_s = 0.0 if not self.frames_per_s else 1 / self.frames_per_s
        return self.last_s is not None and self.last_s > max(SILENCE_S, 10 * usual_s)


def pace_of(
    written: Sequence[tuple[str, JournalTimes]],
    costs_s: Mapping[str, float],
    left: Mapping[str, float] | None,
    now_s: float,
) -> RunPace:
    """Return the pace of a run.

    written: when the newest frames of its journals were written, with the folder of the sequence. costs_s: what a frame
    of each sequence costs, by its folder. left: how many frames of each sequence are missing; None where that is
    unknown. now_s: since the epoch.
    """
    times = [time_s for _, item in written for time_s in item.times_s]
    if not times:
        return RunPace()
    last_s = max(times)
    # A journal of which only the end was read tells nothing of the time before that.
    begun = [min(item.times_s) for _, item in written if item.cut and max(item.times_s) > last_s - WINDOW_S]
    first_s = max([min(times), last_s - WINDOW_S, *begun])
    counts: dict[str, float] = {}
    for folder, item in written:
        later = sum(time_s > first_s for time_s in item.times_s)
        counts[folder] = counts.get(folder, 0.0) + later * item.frames_each
    window_s = last_s - first_s
    age_s = max(0.0, now_s - last_s)
    if window_s <= 0 or not any(counts.values()):
        return RunPace(age_s)
    rate = sum(count * costs_s[folder] for folder, count in counts.items()) / window_s
    left_s = None if left is None else sum(count * costs_s[folder] for folder, count in left.items()) / rate
    return RunPace(age_s, window_s, sum(counts.values()) / window_s, left_s)


# The shards of a dataset, in its folder or at its address, and what they hold of its sequences.


READERS = 8  # records of shards at an address that are read at once: stores answer late


@dataclass(frozen=True)
class Shards:
    """The shards of a dataset.

    merged: the names of those that were merged since the dataset was last complete. finished: those that wait for that.
    unfinished: when each of the others was last written to, seconds since the epoch, by the folder's name. parts: what
    they hold of sequences, by the sequence's folder. identities: what they are made from. notes: what cannot be read of
    them.
    """

    merged: tuple[str, ...] = ()
    finished: list[str] = field(default_factory=list)
    unfinished: dict[str, float] = field(default_factory=dict)
    parts: dict[str, list[StoredPart]] = field(default_factory=dict)
    identities: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, sequence: str, part: StoredPart) -> None:
        """Add what a shard holds of a sequence."""
        self.parts.setdefault(sequence, []).append(part)


# --- in a folder ---


def read_shards(out: Path) -> Shards:
    """Return the shards in a dataset's folder. Nothing is locked, so they may be made and merged meanwhile."""
    found = Shards(tuple(summary["shard"] for summary in merged_shards(out)))
    for folder in shard_folders(out):
        try:
            record = read_shard(folder)
        except ValueError as error:
            found.notes.append(f"shard {folder.name}: its record {error}; it will be made again")
            continue
        if record is None:
            _add_unfinished(found, folder)
        else:
            _add_finished(found, folder, record)
    return found


def _add_finished(found: Shards, folder: Path, record: ShardRecord) -> None:
    found.finished.append(record.shard.name)
    found.identities.append(record.identity)
    for sequence, records in record.frames.items():
        found.add(sequence, folder_part(folder / sequence, sequence, records=records))


def _add_unfinished(found: Shards, folder: Path) -> None:
    work = folder / WORK_FOLDER
    journals = journals_of(work)
    for sequence in sorted(journals.sequences):
        found.add(sequence, folder_part(folder / sequence, sequence, journals))
    times_s = [journal.stat().st_mtime for journal in journals.files if journal.exists()]
    state = read_dataset_state(folder)
    if state is not None and state.identity is not None and not state.problem:
        found.identities.append(state.identity)
    if work.is_dir():
        found.unfinished[folder.name] = max(times_s, default=work.stat().st_mtime)


# --- at an address ---


def read_shards_at(store: Store, progress: Progress, *, check: bool) -> Shards:
    """Return the shards at an address. check: whether to hash what is in their tars."""
    found, times_s, names = Shards(), store.times_s(PLACE), shard_records(store)
    progress.start("reading shards", len(names))
    for name, stored in _stored(store, names):
        if stored is None:
            found.notes.append(f"{name}: cannot be used, or its tar is not whole; the shard will be made again")
        else:
            found.finished.append(stored.record.shard.name)
            damaged = damaged_contents(store, stored) if check else frozenset[str]()
            there = partial(_digests, damaged)
            for sequence, records in stored.record.frames.items():
                found.add(sequence, hashed_part(records, there, times_s.get(name)))
        progress.advance()
    progress.finish()
    return found


def _digests(damaged: frozenset[str], files: Recorded) -> Digests:
    """Return the SHA-256 of files in a tar that is whole. damaged: those that have another, which is not known."""
    return {name: "" if wanted in damaged else wanted for name, (_, wanted) in files.items()}


def _stored(store: Store, names: list[str]) -> Iterator[tuple[str, StoredShard | None]]:
    with ThreadPoolExecutor(READERS, thread_name_prefix="shard-reader") as pool:
        for at in range(0, len(names), READERS):  # a record has megabytes
            part = names[at : at + READERS]
            yield from zip(part, pool.map(lambda name: get_shard(store, name), part), strict=True)


NOTHING = "holds no dataset of Noisy World, nor one that was begun"
NAME_ONE = "name the folder that generate wrote"


@dataclass(frozen=True)
class SequenceStatus:
    """A sequence: how many of its frames are done, of how many (None where that is unknown), and what is wrong."""

    setting: str
    scene: str
    of: int | None
    inventory: FileInventory

    @property
    def whole(self) -> bool:
        """Whether every frame is done."""
        return self.of is not None and self.inventory.done >= self.of


@dataclass(frozen=True)
class Status:
    """How far a dataset has come.

    out: its folder or address. ended: whether the last run has come to its end. checked: whether every file was hashed.
    lost, damaged: files of the dataset that are not there, or are not as they were written, relative to its place.
    total_s: how long the run took that has ended, if it says so. shards: those in its folder, or at its address.
    """

    out: Path | str
    ended: bool
    checked: bool
    sequences: tuple[SequenceStatus, ...]
    lost: tuple[str, ...]
    damaged: tuple[str, ...]
    pace: RunPace
    total_s: float | None
    shards: Shards
    notes: tuple[str, ...]

    @property
    def done(self) -> int:
        """The frames that are done."""
        return sum(item.inventory.done for item in self.sequences)

    @property
    def of(self) -> int | None:
        """The frames of all sequences; None where those of one are unknown."""
        counts = [item.of for item in self.sequences if item.of is not None]
        return sum(counts) if len(counts) == len(self.sequences) else None

    @property
    def whole(self) -> bool:
        """Whether the run has ended and every file is there, and as it was written where that was checked."""
        return self.ended and all(item.whole for item in self.sequences) and not (self.lost or self.damaged)


def read_status(place: Path | str, progress: Progress, *, chosen: slice | None = None, check: bool = False) -> Status:
    """Return how far the dataset in a folder or at an address has come.

    chosen: the frames of each sequence that are asked for, if not all.
    check: whether to hash every file.

    Raises StorageError where nothing is there, or nothing that can be understood, and where a store refuses.
    """
    seen = _look(place, chosen, progress, check=check)
    dataset, notes = seen.dataset, list(seen.notes)
    described = seen.counted() or seen.described()
    if seen.packed_tars:
        notes.append(f"{seen.packed_tars} of {len(described)} tars are packed from the shards")
    lost, damaged = dataset.own_problems(check=check)
    progress.start("checking", sum(len(item.frames or ()) for item in described))
    found: list[SequenceStatus] = []
    wanted = [(item.folder, seen.asked(item)) for item in described]
    for item, there in zip(described, dataset.inventories(wanted, check=check), strict=True):
        found.append(SequenceStatus(item.setting, item.scene, seen.count(item), there))
        progress.advance(len(item.frames or ()))
    progress.finish()
    for name, written in dataset.text_files.items():
        digest = dataset.digest(name) if check else written if dataset.holds(name) else None
        if digest != written:
            (lost if digest is None else damaged).append(name)
    run = _run_of(dataset.store)
    if check and seen.ended:
        known = manifest_sha256_in(run)
        notes += [UNCHECKED] if known is None else []
        damaged += [MANIFEST] if known not in (None, sha256_of_bytes(dataset.store.read(MANIFEST) or b"")) else []
    return Status(
        place if isinstance(place, Path) and isinstance(dataset, FolderDataset) else dataset.store.text,
        seen.ended,
        check,
        tuple(found),
        tuple(dict.fromkeys((*lost, *(name for item in found for name in item.inventory.lost)))),
        tuple(dict.fromkeys((*damaged, *(name for item in found for name in item.inventory.damaged)))),
        _pace(seen.described() if any(not item.whole for item in found) else described, found),
        _total_s(run) if seen.ended else None,
        seen.shards,
        (*notes, *seen.shards.notes),
    )


@dataclass(frozen=True)
class _Seen:
    """What is seen of a dataset.

    chosen: the frames that are asked for, or that it is made of. ended: whether its run has come to its end.
    packed_tars: how many are there of a dataset that is being packed.
    """

    dataset: StoredDataset
    chosen: slice | None
    ended: bool
    shards: Shards = Shards()
    notes: tuple[str, ...] = ()
    packed_tars: int = 0

    @property
    def _made(self) -> dict[str, int]:
        """How many frames the run has made of each sequence that has come to its end; it chose them by --frames."""
        manifest = self.dataset.state.manifest
        return manifest["frames"] if manifest is not None and self.ended and self.chosen is None else {}

    def counted(self) -> tuple[Described, ...]:
        """Return the sequences of a dataset whose run has ended, as its manifest counts them; else none."""
        sequences = self.dataset.identity["sequences"]
        if not self._made.keys() >= set(sequences):
            return ()
        names = [folder.split("/") for folder in sequences]
        return tuple(
            Described(setting, scene, range(self._made[f"{setting}/{scene}"]), 1.0) for setting, scene in names
        )

    def described(self) -> tuple[Described, ...]:
        """Return the sequences, with what their frames cost: steps that decide these have to be known for that."""
        from ..perturbations import registry
        from .estimate import described_sequences

        return described_sequences(self.dataset.identity, registry(), self.chosen)

    def count(self, item: Described) -> int | None:
        """Return how many frames a sequence has to have."""
        return self._made.get(item.folder, None if item.frames is None else len(item.frames))

    def asked(self, item: Described) -> Container[int] | None:
        """Return the frames of a sequence that are asked for; None for all."""
        return None if self.chosen is None or item.frames is None else frozenset(item.frames)


def _look(place: Path | str, chosen: slice | None, progress: Progress, *, check: bool) -> _Seen:
    if isinstance(place, Path) and not is_packed(place):
        return _look_into(place, chosen)
    store = open_store(place)
    state = sealed_state(store)
    if state is not None and (state.problem or state.manifest is None):
        raise StorageError(state.problem, file=store.text)
    if state is not None:
        return _Seen(PackedDataset(store, state), chosen, ended=True)
    begun = claimed(store)
    if begun is None:
        raise StorageError(NOTHING, file=store.text, remedy=NAME_ONE)
    identity = begun["identity"]
    if problem := identity_problem(identity):
        raise StorageError(problem, file=store.of(CLAIM))
    made = None if begun["chosen"] is None else slice(*begun["chosen"])
    shards = read_shards_at(store, progress, check=check)
    state = DatasetState(identity, None, frozenset(identity["sequences"]), holds_frames=True)
    packed = sum(name.endswith(".json") for name in store.sizes(PACKED_SEQUENCES))
    return _Seen(StoredDataset(store, state, shards.parts), chosen or made, False, shards, packed_tars=packed)


def _look_into(out: Path, chosen: slice | None) -> _Seen:
    """Look into a folder, in which the dataset is finished or under way."""
    if not out.is_dir():
        problem = "is not a folder" if out.exists() else "there is no such folder"
        raise StorageError(problem, file=out, remedy=NAME_ONE)
    shards = read_shards(out)
    state = _state(out, shards)
    check_no_links(out, state.sequences)
    begun = (out / WORK_FOLDER / IDENTITY).exists() or bool(shards.finished or shards.unfinished)
    ended = state.manifest is not None and not begun
    notes = (state.note,) if state.note else ()
    return _Seen(FolderDataset(out, state, shards.parts), chosen, ended, shards, notes)


def _state(out: Path, shards: Shards) -> DatasetState:
    """Return what the folder holds; where no run has begun to merge, what its shards say."""
    state = read_dataset_state(out)
    if state is None and shards.identities:
        identity = shards.identities[0]
        for other in shards.identities[1:]:
            identity = merged_identity(other, identity, set(other["sequences"]) - set(identity["sequences"]))
        note = "only the shards that were begun are known, as no run has begun to merge; the preset may have more"
        return DatasetState(identity, None, frozenset(identity["sequences"]), holds_frames=True, note=note)
    if state is None:
        raise StorageError(NOTHING, file=out, remedy=NAME_ONE)
    if state.problem:
        raise StorageError(state.problem, file=out)
    return state


def _run_of(store: Store) -> Any:
    """Return what run.json says; None where it says nothing that can be read."""
    with contextlib.suppress(ValueError, StorageError):
        return parse_json((store.read(RUN) or b"").decode())
    return None


def _pace(described: Sequence[Described], found: Sequence[SequenceStatus]) -> RunPace:
    costs_s = {item.folder: item.seconds_each for item in described}
    left = {f"{item.setting}/{item.scene}": item.of - item.inventory.done for item in found if item.of is not None}
    written = [(f"{item.setting}/{item.scene}", part) for item in found for part in item.inventory.written]
    return pace_of(written, costs_s, left if len(left) == len(found) else None, time.time())


def _total_s(run: Any) -> float | None:
    """Return how long the run took that has ended, by what run.json says; None where it does not say so."""
    found = run.get("total_s") if isinstance(run, dict) else None
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None
