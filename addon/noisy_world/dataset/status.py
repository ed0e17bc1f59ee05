# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a dataset has come: what is done, what is missing or damaged, and how long the rest will take.

Everything is read from the dataset's folder or address, while a run writes there or after that; the preset is not
needed, and nothing is changed.
"""

import contextlib
import threading
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..core.atomic_files import Hasher, sha256_of_bytes
from ..core.errors import StorageError
from ..core.json_text import parse_json, read_json
from ..core.progress import Progress
from .finished import Packed, is_packed, sealed_state, tar_name
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
from .identity import FORMAT, Described, identity_problem
from .inventory import (
    FileInventory,
    FolderPart,
    HashedPart,
    JournalTimes,
    PackedFiles,
    Part,
    SequenceInTar,
    counted,
    inventory,
    journals_of,
)
from .packing import CLAIM, PACKED_SEQUENCES, claimed
from .shard_folders import ShardRecord, merged_shards, read_shard, shard_folders
from .shard_objects import PLACE, StoredShard, damaged_contents, get_shard, shard_records
from .store import Store, open_store

# How fast a run goes, by when its newest files were written, and how long the rest takes at that pace.
#
# Frames differ in cost: a frame of a render of its own takes many times what a link to a clean image takes. So the pace
# is in seconds of the estimate a second, and what is left is weighed in the same way.


WINDOW_S = 600.0  # of the newest files that count: long enough for a scene to be loaded in it, chosen
SILENCE_S = 60.0  # without a new file for this long, and for ten times the usual, no run seems to go on; chosen


@dataclass(frozen=True)
class Pace:
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
) -> Pace:
    """Return the pace of a run.

    written: when the newest frames of its journals were written, with the folder of the sequence. costs_s: what a frame
    of each sequence costs, by its folder. left: how many frames of each sequence are missing; None where that is
    unknown. now_s: since the epoch.
    """
    times = [time_s for _, item in written for time_s in item.times_s]
    if not times:
        return Pace()
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
        return Pace(age_s)
    rate = sum(count * costs_s[folder] for folder, count in counts.items()) / window_s
    left_s = None if left is None else sum(count * costs_s[folder] for folder, count in left.items()) / rate
    return Pace(age_s, window_s, sum(counts.values()) / window_s, left_s)


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
    parts: dict[str, list[Part]] = field(default_factory=dict)
    identities: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, sequence: str, part: Part) -> None:
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
        found.add(sequence, FolderPart(folder / sequence, sequence, records=records))


def _add_unfinished(found: Shards, folder: Path) -> None:
    work = folder / WORK_FOLDER
    journals = journals_of(work)
    for sequence in sorted(journals.sequences):
        found.add(sequence, FolderPart(folder / sequence, sequence, journals))
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
            digest = partial(_digest, damaged)
            for sequence, records in stored.record.frames.items():
                found.add(sequence, HashedPart(records, digest, times_s.get(name)))
        progress.advance()
    progress.finish()
    return found


def _digest(damaged: frozenset[str], name: str, wanted: str) -> str:
    """Return the SHA-256 of a content of a tar that is whole. damaged: those that have another, which is not known."""
    del name
    return "" if wanted in damaged else wanted


def _stored(store: Store, names: list[str]) -> Iterator[tuple[str, StoredShard | None]]:
    with ThreadPoolExecutor(READERS, thread_name_prefix="shard-reader") as pool:
        for at in range(0, len(names), READERS):  # a record has megabytes
            part = names[at : at + READERS]
            yield from zip(part, pool.map(lambda name: get_shard(store, name), part), strict=True)


NOTHING = "holds no dataset of Noisy World, nor one that was begun"


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
    pace: Pace
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
    seen = _read_place(place, chosen, progress, check=check)
    described = seen.whole() or _described(seen)
    seen.begin(described)
    progress.start("checking", sum(len(item.frames or ()) for item in described))
    found: list[SequenceStatus] = []
    for item in described:
        found.append(SequenceStatus(item.setting, item.scene, seen.count(item), seen.inventory(item)))
        progress.advance(len(item.frames or ()))
    progress.finish()
    seen.check_texts()
    if check and seen.ended:
        seen.check_manifest()
    return Status(
        seen.out,
        seen.ended,
        check,
        tuple(found),
        tuple(dict.fromkeys((*seen.lost, *(name for item in found for name in item.inventory.lost)))),
        tuple(dict.fromkeys((*seen.damaged, *(name for item in found for name in item.inventory.damaged)))),
        _pace(_described(seen) if any(not item.whole for item in found) else described, found),
        _total_s(seen.run) if seen.ended else None,
        seen.shards,
        (*seen.notes, *seen.shards.notes),
    )


def _described(seen: "_Seen") -> tuple[Described, ...]:
    """Return the sequences, with what their frames cost: steps that decide which they are have to be known for that."""
    from ..perturbations import registry
    from .estimate import described_sequences

    return described_sequences(seen.identity, registry(), seen.chosen)


def _read_place(place: Path | str, chosen: slice | None, progress: Progress, *, check: bool) -> "_Seen":
    if isinstance(place, Path) and not is_packed(place):
        return _Folder(place, chosen, check=check)
    store = open_store(place)
    state = sealed_state(store)
    if state is not None and (state.problem or state.manifest is None):
        raise StorageError(state.problem, file=store.text)
    if state is not None and state.manifest is not None:
        return _Packed(Packed(store, state.manifest), chosen, check=check)
    begun = claimed(store)
    if begun is None:
        raise StorageError(NOTHING, file=store.text)
    if problem := identity_problem(begun["identity"]):
        raise StorageError(problem, file=store.of(CLAIM))
    return _UnderWay(store, begun, chosen, read_shards_at(store, progress, check=check))


def _pace(described: Sequence[Described], found: Sequence[SequenceStatus]) -> Pace:
    costs_s = {item.folder: item.seconds_each for item in described}
    left = {f"{item.setting}/{item.scene}": item.of - item.inventory.done for item in found if item.of is not None}
    written = [(f"{item.setting}/{item.scene}", part) for item in found for part in item.inventory.written]
    return pace_of(written, costs_s, left if len(left) == len(found) else None, time.time())


def _total_s(run: Any) -> float | None:
    """Return how long the run took that has ended, by what run.json says; None where it does not say so."""
    found = run.get("total_s") if isinstance(run, dict) else None
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None


class _Seen:
    """What is seen of a dataset.

    identity, manifest: as of `DatasetState`. chosen: the frames that are asked for, or that it is made of. ended:
    whether its run has come to its end. run: what run.json says. lost, damaged: files that are no images.
    """

    manifest: dict[str, Any] | None = None
    ended = False
    run: Any = None

    def __init__(self, out: Path | str, identity: dict[str, Any], chosen: slice | None, shards: Shards) -> None:
        self.out = out
        self.identity = identity
        self.chosen = chosen
        self.shards = shards
        self.notes: list[str] = []
        self.lost: list[str] = []
        self.damaged: list[str] = []
        self._images_each = len(identity["output"].get("modalities") or ("rgb", "depth"))

    def whole(self) -> tuple[Described, ...]:
        """Return the sequences of a dataset whose run has ended, as its manifest counts them; else none."""
        frames = {} if self.manifest is None or not self.ended or self.chosen is not None else self.manifest["frames"]
        if not frames.keys() >= set(self.identity["sequences"]):
            return ()
        names = [folder.split("/") for folder in self.identity["sequences"]]
        return tuple(Described(setting, scene, range(frames[f"{setting}/{scene}"]), 1.0) for setting, scene in names)

    def begin(self, described: Sequence[Described]) -> None:
        """Hear which sequences will be asked for."""

    def count(self, item: Described) -> int | None:
        """Return how many frames a sequence has to have."""
        made = self.manifest["frames"].get(item.folder) if self.manifest and self.ended else None
        if made is not None and self.chosen is None:
            return made  # by --frames it may have fewer than its path
        return None if item.frames is None else len(item.frames)

    def _asked(self, item: Described) -> Container[int] | None:
        return None if self.chosen is None or item.frames is None else frozenset(item.frames)

    def inventory(self, item: Described) -> FileInventory:
        """Return what there is of a sequence."""
        return inventory(item.folder, self.shards.parts.get(item.folder, ()), self._images_each, self._asked(item))

    def check_texts(self) -> None:
        """Find the dataset's files other than images that are lost or damaged; after the sequences."""
        for name, wanted in _texts(self.manifest).items():
            digest = self._digest(name, wanted)
            if digest != wanted:
                (self.lost if digest is None else self.damaged).append(name)

    def check_manifest(self) -> None:
        """Compare the manifest with what run.json says of it."""
        known = manifest_sha256_in(self.run)
        if known is None:
            self.notes.append(UNCHECKED)
        elif known != self._manifest_sha256():
            self.damaged.append(MANIFEST)

    def _digest(self, name: str, wanted: str) -> str | None:
        """Return the SHA-256 of a text file, `wanted` where it is there and not to be hashed; None where it is not."""
        del name
        return wanted

    def _manifest_sha256(self) -> str | None:
        return None


def _texts(manifest: dict[str, Any] | None) -> dict[str, str]:
    """Return the files that a manifest names, SHA-256 by name from the dataset on; none of another version's."""
    named: dict[str, str] = {}
    if manifest is not None and manifest["identity"]["format"] == FORMAT:
        for name, found in manifest["files"].items():
            named |= {name: found} if isinstance(found, str) else {f"{name}/{key}": found[key] for key in found}
    return named


class _UnderWay(_Seen):
    """A dataset that is being made at an address."""

    def __init__(self, store: Store, begun: dict[str, Any], chosen: slice | None, shards: Shards) -> None:
        made = None if begun["chosen"] is None else slice(*begun["chosen"])
        super().__init__(store.text, begun["identity"], chosen or made, shards)
        self._packed = len([name for name in store.sizes(PACKED_SEQUENCES) if name.endswith(".json")])

    def begin(self, described: Sequence[Described]) -> None:
        if self._packed:
            self.notes.append(f"{self._packed} of {len(described)} tars are packed from the shards")


class _Folder(_Seen):
    """A dataset in a folder, finished or under way."""

    def __init__(self, out: Path, chosen: slice | None, *, check: bool) -> None:
        if not out.is_dir():
            raise StorageError("is not a folder" if out.exists() else "there is no such folder", file=out)
        shards = read_shards(out)
        state = _state(out, shards)
        assert state.identity is not None
        super().__init__(out, state.identity, chosen, shards)
        check_no_links(out, state.sequences)
        self._folder, self._work = out, out / WORK_FOLDER
        self.manifest = state.manifest
        self.notes += [state.note] if state.note else []
        begun = (self._work / IDENTITY).exists() or bool(shards.finished or shards.unfinished)
        self.ended = state.manifest is not None and not begun
        with contextlib.suppress(FileNotFoundError, ValueError):
            self.run = read_json(out / RUN)
        self._journals = journals_of(self._work)
        self._hasher = Hasher() if check else None

    def inventory(self, item: Described) -> FileInventory:
        made = self.manifest["frames"].get(item.folder) if self.manifest else None
        own = FolderPart(self._folder / item.folder, item.folder, self._journals)
        of_shards = self.shards.parts.get(item.folder, [])
        if (
            self._hasher is None
            and self.chosen is None
            and made is not None
            and not (item.folder in self._journals.sequences or of_shards)
        ):
            quick = counted(own.images, made, self._images_each)
            if quick is not None:
                return quick
        return inventory(item.folder, (*of_shards, own), self._images_each, self._asked(item), self._hasher)

    def _digest(self, name: str, wanted: str) -> str | None:
        path = self._folder / name
        if not path.is_file():
            return None
        return wanted if self._hasher is None else self._hasher.sha256(path) or ""

    def _manifest_sha256(self) -> str | None:
        return Hasher().sha256(self._folder / MANIFEST)


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
        raise StorageError(NOTHING, file=out)
    if state.problem:
        raise StorageError(state.problem, file=out)
    return state


class _Packed(_Seen):
    """A finished packed dataset."""

    ended = True

    def __init__(self, packed: Packed, chosen: slice | None, *, check: bool) -> None:
        super().__init__(packed.store.text, packed.identity, chosen, Shards())
        self.manifest = packed.manifest
        self._packed = packed
        self._check = check
        self._files = PackedFiles(packed, check=check)
        self.lost, self.damaged = self._files.own_problems()
        with contextlib.suppress(ValueError):
            self.run = parse_json((packed.store.read(RUN) or b"").decode())
        self._tars: Iterator[tuple[str, SequenceInTar]] = iter(())
        self._hashed: dict[str, str | None] = {}  # the texts of sequences

    def begin(self, described: Sequence[Described]) -> None:
        if self._check:
            there = [item.folder for item in described if self._there(item)]
            self._tars = self._files.each(there, threading.Event())

    def _there(self, item: Described) -> bool:
        return item.folder in self._packed.sequences and self._files.has(item.folder)

    def inventory(self, item: Described) -> FileInventory:
        tar, asked = tar_name(item.folder), self._asked(item)
        if not self._there(item):
            return FileInventory(0, lost=(tar,) if item.folder in self._packed.sequences else ())
        if self._check:
            return self._read(item, asked)
        description = self._packed.described.get(tar)
        if description is not None and description.size != self._packed.store.size(tar):
            return FileInventory(0, damaged=(tar,))
        if asked is None:
            return FileInventory(self._packed.manifest["frames"][item.folder])
        return FileInventory(sum(frame in asked for frame, _ in self._packed.files(item.folder)))

    def _read(self, item: Described, asked: Container[int] | None) -> FileInventory:
        """Return what a tar holds."""
        _, own = next(self._tars)
        found = inventory(item.folder, [HashedPart(own.records().values(), own.digest)], self._images_each, asked)
        texts: dict[str, str] = self._packed.manifest["files"][item.folder]
        digests = dict(zip(texts, own.digests(list(texts)), strict=True))
        self._hashed |= {f"{item.folder}/{name}": digest for name, digest in digests.items()}
        if found.lost or found.damaged or digests != texts or not (tar := own.damaged_whole()):
            return found
        return FileInventory(found.done, damaged=(tar,))  # in headers, or in samples' descriptions

    def _digest(self, name: str, wanted: str) -> str | None:
        folder = name.rpartition("/")[0]
        if self._check and folder.count("/"):
            return self._hashed.get(name, wanted)  # of a tar that is not there the tar is named alone
        return self._files.digest(name) if self._check else wanted if folder or self._files.beside_has(name) else None

    def _manifest_sha256(self) -> str | None:
        return sha256_of_bytes(self._packed.store.read(MANIFEST) or b"")
