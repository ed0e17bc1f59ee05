# SPDX-License-Identifier: GPL-3.0-or-later
"""Shards at an address: each a tar of its files and, written after it, the shard's record, by which it counts.

In the tar lies each content once, whatever names it has, sorted by sequence and name, so that what a sequence takes
from a shard lies together. The record says where each content is, by its SHA-256.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import sha256_of_bytes
from ..core.errors import StorageError
from ..core.file_access import parse_json, read_bytes
from .folder_state import WORK_FOLDER
from .shard_folders import SHARDS, ShardRecord
from .shards import Shard
from .store import Store
from .stored import FrameImages, ReadImage
from .tar_files import TarStream

PLACE = f"{WORK_FOLDER}/{SHARDS}"
CHUNK_BYTES = 8 * 2**20  # read at once, where what is needed lies together; chosen: some frames


@dataclass(frozen=True)
class StoredShard:
    """A finished shard at an store. spans: where each content begins in its tar, and its size, by SHA-256."""

    record: ShardRecord
    spans: dict[str, tuple[int, int]]


def tar_of(shard: Shard) -> str:
    """Return the name of a shard's tar, from the address on."""
    return f"{PLACE}/{shard.folder_name}.tar"


def record_of_shard(shard: Shard) -> str:
    """Return the name of a shard's record, from the address on."""
    return f"{PLACE}/{shard.folder_name}.json"


def put_shard(store: Store, folder: Path, record: ShardRecord) -> StoredShard:
    """Put a finished shard to an address; return it. folder: holds its files.

    Raises StorageError where a file is not as its record says, and where the store refuses.
    """
    spans: dict[str, tuple[int, int]] = {}
    with store.writing(tar_of(record.shard)) as sink:
        tar = TarStream(sink)
        for name, _, digest in sorted(record.files()):
            if digest in spans:
                continue
            data = read_bytes(folder / name)
            if sha256_of_bytes(data) != digest:
                raise StorageError("is not as it was written", file=folder / name, remedy="make the shard again")
            spans[digest] = (tar.add(name, data), len(data))
        tar.close()
    description = {"record": record.content(), "spans": spans, "size": sink.size, "sha256": sink.sha256}
    store.write(
        record_of_shard(record.shard), json.dumps(description, separators=(",", ":"), ensure_ascii=False).encode()
    )
    return StoredShard(record, spans)


def get_shard(store: Store, name: str) -> StoredShard | None:
    """Return a finished shard by the name of its record; None where there is none, or a torn one."""
    data = store.read(name)
    try:
        description: Any = None if data is None else parse_json(data.decode())
        if not isinstance(description, dict):
            return None
        record = ShardRecord.of_content(description["record"])
        spans = {str(digest): (int(span[0]), int(span[1])) for digest, span in description["spans"].items()}
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None
    whole = store.size(tar_of(record.shard)) == description["size"] and all(
        digest in spans for *_, digest in record.files()
    )
    return StoredShard(record, spans) if whole else None


def shard_records(store: Store) -> list[str]:
    """Return the names of the records of shards at an address, sorted."""
    return [name for name in store.sizes(PLACE) if name.endswith(".json")]


def damaged_contents(store: Store, stored: StoredShard) -> frozenset[str]:
    """Return the contents of a shard's tar that are not as they were written, by the SHA-256 that they should have."""
    tar = tar_of(stored.record.shard)
    digests = sorted(stored.spans, key=lambda digest: stored.spans[digest])
    wrong: set[str] = set()
    for chunk, start, stop in _chunks(stored, digests):
        data = store.read_range(tar, start, stop)
        for digest in chunk:
            offset, size = stored.spans[digest]
            if sha256_of_bytes(data[offset - start : offset - start + size]) != digest:
                wrong.add(digest)
    return frozenset(wrong)


def _chunks(stored: StoredShard, digests: list[str]) -> Iterator[tuple[list[str], int, int]]:
    """Yield contents that lie together, with where the first begins and the last ends."""
    chunk: list[str] = []
    for digest in digests:
        offset, size = stored.spans[digest]
        if chunk and offset + size - stored.spans[chunk[0]][0] > CHUNK_BYTES:
            yield chunk, stored.spans[chunk[0]][0], sum(stored.spans[chunk[-1]])
            chunk = []
        chunk.append(digest)
    if chunk:
        yield chunk, stored.spans[chunk[0]][0], sum(stored.spans[chunk[-1]])


class ShardImages:
    """The images of a dataset in the shards at an address: 56 bytes of memory for each content."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._shards: list[Shard] = []
        self._parts: list[tuple[NDArray[np.bytes_], NDArray[np.int64]]] = []
        self._digests = np.zeros(0, dtype="S32")
        self._places = np.zeros((0, 3), dtype=np.int64)  # shard, offset, size

    def add(self, stored: StoredShard) -> None:
        """Add what a shard holds."""
        number = len(self._shards)
        self._shards.append(stored.record.shard)
        digests = np.array([bytes.fromhex(digest) for digest in stored.spans], dtype="S32")
        places = np.array([(number, *span) for span in stored.spans.values()], dtype=np.int64).reshape(-1, 3)
        self._parts.append((digests, places))

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images in ranges of the shards' tars, a few megabytes at once."""
        self._join()
        reads = {
            modality: _Chunks(self, [image.images[modality][1] for image in frames])
            for modality in (frames[0].images if frames else ())
        }
        of_name = {name: reads[modality] for frame in frames for modality, (name, _) in frame.images.items()}

        return lambda name, sha256: self._checked(of_name[name].read(sha256), sha256, f"{sequence}/{name}")

    def read_one(self, name: str, sha256: str) -> bytes:
        """Return a single image. name: in the dataset."""
        self._join()
        shard, offset, size = self.place(sha256)
        return self._checked(self.fetch(shard, offset, offset + size), sha256, name)

    def _join(self) -> None:
        """Sort what was added by its hash."""
        if self._parts:
            digests = np.concatenate([self._digests, *(part for part, _ in self._parts)])
            places = np.concatenate([self._places, *(part for _, part in self._parts)])
            order = np.argsort(digests, kind="stable")
            self._digests, self._places = digests[order], places[order]
            self._parts.clear()

    def place(self, sha256: str) -> tuple[int, int, int]:
        """Return where a content is: the shard's number, the offset in its tar, the size."""
        digest = np.array(bytes.fromhex(sha256), dtype="S32")
        row = int(np.searchsorted(self._digests, digest))
        if row == len(self._digests) or self._digests[row] != digest:
            raise RuntimeError(f"no shard holds {sha256}")
        shard, offset, size = self._places[row].tolist()
        return shard, offset, size

    def fetch(self, shard: int, start: int, stop: int) -> bytes:
        """Return bytes of a shard's tar."""
        return self._store.read_range(tar_of(self._shards[shard]), start, stop)

    def _checked(self, data: bytes, sha256: str, name: str) -> bytes:
        """Return a file's content. If it is not as it was written, its shard is forgotten, so that it is made again."""
        if sha256_of_bytes(data) == sha256:
            return data
        shard = self._shards[self.place(sha256)[0]]
        self._store.remove(record_of_shard(shard))
        raise StorageError(
            f"{name} in it is not as it was written",
            file=self._store.of(tar_of(shard)),
            remedy="the shard is dropped, and the same command makes it again",
        )


class _Chunks:
    """Contents that are read one after another: those that lie together in a tar are fetched at once."""

    def __init__(self, images: ShardImages, digests: list[str]) -> None:
        self._images = images
        places = [images.place(digest) for digest in digests]
        self._chunk_of: dict[str, tuple[int, int, int]] = {}  # shard, start, stop
        self._place_of = dict(zip(digests, places, strict=True))
        first = 0
        for k in range(1, len(places) + 1):
            if k < len(places) and _together(places[first], places[k - 1], places[k]):
                continue
            shard, start, _ = places[first]
            stop = places[k - 1][1] + places[k - 1][2]
            for digest in digests[first:k]:
                self._chunk_of.setdefault(digest, (shard, start, stop))
            first = k
        self._held: tuple[tuple[int, int, int], bytes] | None = None

    def read(self, sha256: str) -> bytes:
        chunk = self._chunk_of[sha256]
        if self._held is None or self._held[0] != chunk:
            self._held = (chunk, self._images.fetch(*chunk))
        _, offset, size = self._place_of[sha256]
        start = offset - chunk[1]
        return self._held[1][start : start + size]


def _together(first: tuple[int, int, int], last: tuple[int, int, int], following: tuple[int, int, int]) -> bool:
    """Tell whether a content lies right behind another in one tar, headers aside, and within a chunk from the first."""
    behind = following[1] - (last[1] + last[2])
    within = following[1] + following[2] - first[1] <= CHUNK_BYTES
    return first[0] == following[0] and 0 <= behind <= 4096 and within
