# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a packed dataset has come: one that is finished, or begun at its address. Nothing is written there."""

import re
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ..core.datasets.dataset_state import MANIFEST, RUN, UNCHECKED, identity_problem, manifest_sha256_in
from ..core.datasets.file_inventory import FileInventory, JournalTimes
from ..core.datasets.json_text import parse_json
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import StorageError
from ..core.perturbing.reading import Registry
from ..core.planning.described import Described, described_sequences
from ..core.progress import Progress
from ..storage.address import Address
from ..storage.packed import Packed, file_sha256, sealed_standing, wrong_descriptions
from ..storage.packed_table import PackedTable
from ..storage.packed_tar import TarContent, tar_contents
from ..storage.packing import CLAIM, PACKED_SEQUENCES, claimed
from ..storage.sequence_tar import tar_name
from ..storage.shard_objects import PLACE, StoredShard, damaged_contents, get_shard, shard_records
from .pace import Pace, pace_of
from .shard_status import Shards
from .status import SequenceStatus, Status, total_s_of

READERS = 8  # records of shards that are read at once: stores answer late


def read_status_at(
    address: Address, registry: Registry, progress: Progress, *, chosen: slice | None = None, check: bool = False
) -> Status:
    """Return how far the dataset at an address has come; see `read_status`.

    check: whether to read and hash every tar. Raises StorageError where nothing is there, or nothing that can be
    understood, and where the store refuses.
    """
    standing = sealed_standing(address)
    if standing is not None and standing.problem:
        raise StorageError(f"{address.text}: {standing.problem}")
    if standing is not None:
        return _Finished(Packed(address, standing), chosen, check=check).status(registry, progress)
    begun = claimed(address)
    if begun is None:
        raise StorageError(f"{address.text}: holds no dataset of Noisy World, nor one that was begun")
    if problem := identity_problem(begun["identity"]):
        raise StorageError(f"{address.of(CLAIM)}: {problem}")
    return _UnderWay(address, begun, chosen, check=check).status(registry, progress)


# --- finished ---


class _Finished:
    """Looks at the tars of a finished dataset."""

    def __init__(self, packed: Packed, chosen: slice | None, *, check: bool) -> None:
        self._packed = packed
        self._chosen = chosen
        self._check = check
        self._sizes = packed.address.sizes("")
        self._lost, self._damaged = wrong_descriptions(packed, self._sizes, check=check)
        self._loose = {text: digest for text, digest in packed.standing.files.items() if isinstance(digest, str)}
        for name in (name for name in self._loose if "/" not in name):  # the others are in tars
            if name not in self._sizes:
                self._lost.append(name)
            elif check and file_sha256(packed.address, name, self._sizes[name]) != self._loose[name]:
                self._damaged.append(name)

    def status(self, registry: Registry, progress: Progress) -> Status:
        identity = self._packed.manifest["identity"]
        described = described_sequences(identity, registry, self._chosen)
        asked = {item.folder: item.frames for item in described}
        there = [name for name in self._packed.sequences if tar_name(name) in self._sizes]
        found: dict[str, FileInventory] = {}
        progress.start("checking", sum(self._packed.manifest["frames"].values()))
        if self._check:
            for name, content in tar_contents(self._packed.address, there, self._sizes, threading.Event()):
                found[name] = self._read(name, content, asked.get(name))
                progress.advance(self._packed.manifest["frames"][name])
        else:
            found = {name: self._looked_at(name, asked.get(name)) for name in there}
        progress.finish()
        sequences = [self._sequence(item, found.get(item.folder)) for item in described]
        run = _json(self._packed.address.read(RUN))
        known = manifest_sha256_in(run)
        if self._check and known not in (None, sha256_of_bytes(self._packed.address.read(MANIFEST) or b"")):
            self._damaged.append(MANIFEST)
        return Status(
            self._packed.address.text,
            ended=True,
            checked=self._check,
            sequences=tuple(sequences),
            lost=tuple(dict.fromkeys(self._lost)),
            damaged=tuple(dict.fromkeys(self._damaged)),
            pace=Pace(),
            total_s=total_s_of(run),
            shards=Shards(),
            notes=(UNCHECKED,) if self._check and known is None else (),
        )

    def _sequence(self, item: Described, found: FileInventory | None) -> SequenceStatus:
        made = self._packed.manifest["frames"].get(item.folder)
        count = None if item.frames is None else len(item.frames)
        if self._chosen is None and made is not None:
            count = made  # by --frames it may have fewer than its path
        if found is None and made is not None:
            self._lost.append(tar_name(item.folder))
            found = FileInventory(0, lost=(tar_name(item.folder),))
        return SequenceStatus(item.setting, item.scene, count, found or FileInventory(0))

    def _looked_at(self, name: str, asked: Sequence[int] | None) -> FileInventory:
        """Return what a tar's size tells."""
        tar = tar_name(name)
        told = self._packed.described.get(tar)
        if told is not None and told.size != self._sizes[tar]:
            self._damaged.append(tar)
            return FileInventory(0, damaged=(tar,))
        if self._chosen is None or asked is None:
            return FileInventory(self._packed.manifest["frames"][name])
        rows = self._table.rows(name, ["frame"])
        return FileInventory(len(set(rows.column("frame").to_pylist()) & set(asked)))

    @cached_property
    def _table(self) -> PackedTable:
        return PackedTable(self._packed.address)

    def _read(self, name: str, content: TarContent, asked: Sequence[int] | None) -> FileInventory:
        """Return what a tar holds."""
        files, there = self._packed.standing.files, content.digests
        named = {f"{name}/{text}": digest for text, digest in files[name].items()}
        setting = name.partition("/")[0]
        named |= {text: digest for text, digest in self._loose.items() if text.rpartition("/")[0] == setting}
        done = 0
        for frame, record in content.records.items():
            images = {f"{name}/{image}": digest for image, digest in record.files.items()}
            if self._chosen is not None and asked is not None and frame not in asked:
                continue
            named |= images
            whole = len(images) == len(self._packed.modalities)
            done += whole and all(there.get(image) == digest for image, digest in images.items())
        lost = [file for file in named if file not in there]
        damaged = [file for file, digest in named.items() if there.get(file, digest) != digest]
        told = self._packed.described.get(tar_name(name))
        if not (lost or damaged) and told is not None and told.sha256 != content.sha256:
            damaged = [tar_name(name)]  # in headers, or in samples' descriptions
        self._lost += lost
        self._damaged += damaged
        return FileInventory(done, tuple(lost), tuple(damaged))


# --- under way ---


@dataclass
class _Images:
    """The images of a sequence in shards. frames: those of each kind of image, by a name like theirs."""

    frames: dict[str, set[int]] = field(default_factory=dict)
    damaged: dict[str, tuple[str, int]] = field(default_factory=dict)
    written: list[JournalTimes] = field(default_factory=list)

    def tally(self, images_each: int) -> FileInventory:
        """Return what there is of the sequence."""
        kinds = list(self.frames.values())
        done = len(set.intersection(*kinds)) if len(kinds) >= images_each else 0
        damaged = [name for name, (kind, frame) in self.damaged.items() if frame not in self.frames.get(kind, ())]
        return FileInventory(done, (), tuple(sorted(damaged)), tuple(self.written))


class _UnderWay:
    """Looks at the shards of a dataset that is being made."""

    def __init__(self, address: Address, begun: dict[str, Any], chosen: slice | None, *, check: bool) -> None:
        self._address = address
        self._identity: dict[str, Any] = begun["identity"]
        made = None if begun["chosen"] is None else slice(*begun["chosen"])
        self._chosen = chosen or made
        self._check = check
        self._images: dict[str, _Images] = {}
        self._finished: list[str] = []
        self._notes: list[str] = []

    def status(self, registry: Registry, progress: Progress) -> Status:
        described = described_sequences(self._identity, registry, self._chosen)
        asked = {item.folder: None if item.frames is None else frozenset(item.frames) for item in described}
        times_s = self._address.times_s(PLACE)
        names = shard_records(self._address)
        progress.start("checking", len(names))
        for name, stored in self._shards(names):
            if stored is None:
                self._notes.append(f"{name}: cannot be used, or its tar is not whole; the shard will be made again")
            else:
                self._add(stored, asked, times_s.get(name))
            progress.advance()
        progress.finish()
        if packed := len([name for name in self._address.sizes(PACKED_SEQUENCES) if name.endswith(".json")]):
            self._notes.append(f"{packed} of {len(described)} tars are packed from the shards")
        images_each = len(self._identity["output"]["modalities"])
        found = [
            SequenceStatus(
                item.setting,
                item.scene,
                None if item.frames is None else len(item.frames),
                self._images.get(item.folder, _Images()).tally(images_each),
            )
            for item in described
        ]
        return Status(
            self._address.text,
            ended=False,
            checked=self._check,
            sequences=tuple(found),
            lost=(),
            damaged=tuple(f"{item.setting}/{item.scene}/{name}" for item in found for name in item.tally.damaged),
            pace=_pace(described, found),
            total_s=None,
            shards=Shards(finished=self._finished),
            notes=tuple(self._notes),
        )

    def _shards(self, names: list[str]) -> Iterator[tuple[str, StoredShard | None]]:
        with ThreadPoolExecutor(READERS, thread_name_prefix="shard-reader") as pool:
            for at in range(0, len(names), READERS):  # a record has megabytes
                part = names[at : at + READERS]
                yield from zip(part, pool.map(lambda name: get_shard(self._address, name), part), strict=True)

    def _add(self, stored: StoredShard, asked: dict[str, frozenset[int] | None], time_s: float | None) -> None:
        """Count the images of a shard. time_s: when it was put."""
        self._finished.append(stored.record.shard.name)
        damaged = damaged_contents(self._address, stored) if self._check else frozenset[str]()
        images_each = len(self._identity["output"]["modalities"])
        for sequence, records in stored.record.frames.items():
            frames, there, count = asked.get(sequence), self._images.setdefault(sequence, _Images()), 0
            for record in records:
                if frames is not None and record.frame not in frames:
                    continue
                for name, digest in record.files.items():
                    kind = re.sub(r"[0-9]+", "#", name)
                    if digest in damaged:
                        there.damaged[name] = (kind, record.frame)
                        continue
                    there.frames.setdefault(kind, set()).add(record.frame)
                    count += 1
            if count and time_s is not None:
                there.written.append(JournalTimes((time_s,), count / images_each, cut=False))


def _pace(described: tuple[Described, ...], found: list[SequenceStatus]) -> Pace:
    """Return the pace by when shards were put."""
    costs_s = {item.folder: item.seconds_each for item in described}
    left = {f"{item.setting}/{item.scene}": item.of - item.tally.done for item in found if item.of is not None}
    written = [(f"{item.setting}/{item.scene}", part) for item in found for part in item.tally.written]
    return pace_of(written, costs_s, left if len(left) == len(found) else None, time.time())


def _json(data: bytes | None) -> Any:
    try:
        return None if data is None else parse_json(data.decode())
    except ValueError:
        return None
