# SPDX-License-Identifier: GPL-3.0-or-later
"""Bags of ROS as files: ROS 1 (.bag), MCAP and SQLite (.db3), their connections, and where each message lies.

A bag is looked through once, by its index where it has one; the data of a message are read when they are asked for. Of
a file no more is believed than it holds: lengths are compared with it, and chunks are decompressed up to what they say.

Sources: http://wiki.ros.org/Bags/Format/2.0, https://mcap.dev/spec, and rosbag2_storage_sqlite3's tables.
"""

import bz2
import os
import re
import sqlite3
import struct
import sys
import threading
import weakref
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import open_regular, read_bytes
from ..core.packages import need
from ..core.schema import read_yaml
from ..core.trajectory import NS_PER_S
from .described import BAG_SUFFIXES

METADATA = "metadata.yaml"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # of a frame: RFC 8878
ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC = b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\0"

# Chosen: recorders begin a new chunk after some megabytes, and one message may be an image of 8K in float.
LARGEST_CHUNK_BYTES = 2**28
LARGEST_HEADER_BYTES = 2**24  # of a record but a message: definitions of messages are some kilobytes
LARGEST_RATIO, SMALL_BYTES = 1000, 2**30  # all chunks over the file, where they are more than a gigabyte
KEPT_BYTES = 2**26  # of chunks that are decompressed; one is kept whatever its size
AHEAD_BYTES = 2**14  # read at once, as small messages follow one another
MOST_PARTS = 10_000  # files of one bag

Encoding: TypeAlias = Literal["ros1", "cdr"]
Int64: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Connection:
    """A topic of a bag, as one publisher wrote it.

    kind: ROS 2's name of the message's type, such as sensor_msgs/msg/Image. encoding: of its messages. definition,
    digest: of the type, as the bag has them. caller, latching: of ROS 1, None where the bag does not say. qos: of
    ROS 2, as the bag has it. count: of messages.
    """

    number: int
    topic: str
    kind: str
    encoding: str
    definition: str = ""
    digest: str = ""
    caller: str | None = None
    latching: int | None = None
    qos: str = ""
    count: int = 0


@dataclass(frozen=True, eq=False)
class MessageRows:
    """Where messages lie, in the order of the files. All (N,): the connection's number, the time at which the message
    was recorded, the part, the chunk in it (-1: in none), and where it begins there."""

    connection: Int64
    log_ns: Int64
    part: Int64
    chunk: Int64
    offset: Int64

    def __len__(self) -> int:
        return len(self.log_ns)

    def take(self, rows: NDArray[Any]) -> "MessageRows":
        """Return some of them."""
        return MessageRows(
            self.connection[rows], self.log_ns[rows], self.part[rows], self.chunk[rows], self.offset[rows]
        )


def is_bag(path: Path) -> bool:
    """Tell whether a path is a bag: a file by its name or its first bytes, a folder by what is in it."""
    if path.is_dir():
        return bool(_parts_in(path))
    if path.suffix.lower() in BAG_SUFFIXES:
        return True
    try:
        with open_regular(path) as file:
            start = file.read(len(SQLITE_MAGIC))
    except OSError:
        return False
    return start.startswith((ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC))


def _parts_in(folder: Path) -> list[Path]:
    """Return the files of a bag in a folder, in the order of their names; none where it is no bag of ROS 2."""
    try:
        found = sorted(
            path for path in folder.iterdir() if path.suffixes and set(path.suffixes) & set(BAG_SUFFIXES[1:])
        )
    except OSError:
        return []
    return found


class Bag:
    """A bag: a file, or a folder with metadata.yaml and files of one kind. Raises InputError where it is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts = [_opened(part) for part in _part_files(path)]

    @cached_property
    def connections(self) -> tuple[Connection, ...]:
        """Its topics; those of several files are one where they are written alike."""
        return self._read[0]

    @cached_property
    def rows(self) -> MessageRows:
        """Every message, in the order of the files."""
        return self._read[1]

    @cached_property
    def _read(self) -> tuple[tuple[Connection, ...], MessageRows]:
        merged: dict[tuple[Any, ...], int] = {}
        connections: list[Connection] = []
        columns: list[tuple[Int64, ...]] = []
        for number, part in enumerate(self.parts):
            with part.reading():
                own, (connection, log_ns, chunk, offset) = part.index()
            numbers = np.full(max((item.number for item in own), default=-1) + 2, -1, np.int64)
            for item in own:
                name = (item.topic, item.kind, item.encoding, item.caller, item.digest)
                if len(self.parts) == 1 or name not in merged:
                    merged[name] = len(connections)
                    connections.append(replace(item, number=merged[name]))
                numbers[item.number] = merged[name]
            if len(connection) and (connection.min() < 0 or connection.max() >= len(numbers) - 1):
                raise part.damaged("a message is of no topic")
            found = numbers[connection] if len(connection) else connection
            if len(found) and found.min() < 0:
                raise part.damaged("a message is of no topic")
            columns.append((found, log_ns, np.full(len(found), number, np.int64), chunk, offset))
        rows = MessageRows(*(np.concatenate(column) for column in zip(*columns, strict=True)))
        counts = np.bincount(rows.connection, minlength=len(connections)).tolist()
        return tuple(replace(item, count=counts[item.number]) for item in connections), rows

    def of_topic(self, topic: str) -> tuple[Connection, ...]:
        """Return the connections of a topic."""
        return tuple(item for item in self.connections if item.topic == topic)

    def data(self, rows: MessageRows, row: int, most: int | None = None, *, raw: bool = False) -> bytes:
        """Return the data of a message, or the first bytes of it. Raises InputError where they cannot be read.

        raw: as they are stored, where a bag of ROS 2 compresses its messages one by one.
        """
        part, chunk, offset = self.parts[int(rows.part[row])], int(rows.chunk[row]), int(rows.offset[row])
        with part.reading():
            found = part.data(chunk, offset, most)
            if raw or isinstance(part, Ros1Part) or not found.startswith(ZSTD_MAGIC):
                return found  # CDR begins with a zero
            whole = found if most is None else part.data(chunk, offset, None)
            return unpacked(whole, most or LARGEST_CHUNK_BYTES, part.path)

    def close(self) -> None:
        """Close its files; they are opened again where more is asked for."""
        for part in self.parts:
            part.close()


def _part_files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    if not (path / METADATA).is_file():
        if found := _parts_in(path):
            return found[:MOST_PARTS]
        raise InputError(path, "holds no bag of ROS 2", remedy="name the folder with metadata.yaml, or the file in it")
    file = path / METADATA
    try:
        document = read_yaml(read_bytes(file, largest_bytes=LARGEST_HEADER_BYTES), file)
    except OSError as error:
        raise InputError(file, f"cannot be read: {error.strerror or error}") from None
    stated = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    names = stated.get("relative_file_paths") if isinstance(stated, dict) else None
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
        raise InputError(file, "names no files of a bag", remedy="run ros2 bag reindex on the folder")
    files = [path / re.split(r"[/\\]", name)[-1] for name in names[:MOST_PARTS]]
    lost = next((item for item in files if not os.path.isfile(item)), None)  # noqa: PTH113 - any name, even too long
    if lost is not None:
        raise InputError(file, f"names {lost.name[:80]}, which is not there", remedy="copy the folder again")
    return files


def _opened(path: Path) -> "BagPart":
    try:
        with open_regular(path) as file:
            start = file.read(len(SQLITE_MAGIC))
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None
    for magic, kind in ((ROS1_MAGIC, Ros1Part), (MCAP_MAGIC, McapPart), (SQLITE_MAGIC, SqlitePart)):
        if start.startswith(magic):
            return kind(path)
    if not start:
        raise InputError(path, "is an empty file, no bag", remedy="copy it again")
    if path.suffix.lower() in (".zstd", ".zst"):
        raise InputError(path, "is a bag compressed as a file", remedy=f"run zstd -d, and name {path.stem}")
    raise InputError(path, "is no bag of ROS: it begins otherwise", remedy="name a .bag, .mcap or .db3, or its folder")


# --- one file ---

Columns: TypeAlias = tuple[Int64, Int64, Int64, Int64]
"""Of each message: the connection's number in the file, the time of recording, the chunk, and where it begins."""


class BagPart(ABC):
    """A file of a bag. repair: the command that mends one that was cut."""

    repair: ClassVar[str]

    def __init__(self, path: Path) -> None:
        self.path = path

    def damaged(self, what: str) -> InputError:
        """Return the error of a file that is not what it should be."""
        return InputError(self.path, f"is damaged: {what}", remedy=f"copy it again, or run {self.repair}")

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turn what a damaged file makes of reading it into one line."""
        try:
            yield
        except OSError as error:
            raise InputError(self.path, f"cannot be read: {error.strerror or error}") from None
        except (_CutError, struct.error, UnicodeDecodeError, sqlite3.Error, OverflowError) as error:
            raise self.damaged(str(error)) from None

    @abstractmethod
    def index(self) -> tuple[list[Connection], Columns]:
        """Return the topics, and where the messages lie."""

    @abstractmethod
    def data(self, chunk: int, offset: int, most: int | None) -> bytes:
        """Return the data of a message, or the first bytes of it."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


class _CutError(Exception):
    """A file, a chunk or a record ends before what it says that it holds."""


@dataclass(frozen=True)
class _Chunk:
    """A chunk: where its data are in the file, how long they are there, and decompressed."""

    start: int
    stored_bytes: int
    whole_bytes: int
    compression: str

    def __post_init__(self) -> None:
        if not self.compression and self.whole_bytes != self.stored_bytes:
            raise _CutError(f"the chunk at byte {self.start} has {self.stored_bytes} bytes, not {self.whole_bytes}")


class _ChunkedPart(BagPart):
    """A file of records, some of which lie in chunks."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.chunks: list[_Chunk] = []
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._lock = threading.Lock()
        self._file: BinaryIO | None = None
        self._ahead = (0, b"")
        self.size_bytes = path.stat().st_size

    def at(self, start: int, count: int) -> bytes:
        """Return bytes of the file. Raises _CutError where it has not as many."""
        if count < 0 or start < 0 or start + count > self.size_bytes:
            raise _CutError(f"it ends at byte {self.size_bytes}, before what it says that it holds")
        if count > AHEAD_BYTES // 4:
            return self._read(start, count)
        first, ahead = self._ahead
        if not first <= start <= start + count <= first + len(ahead):
            first, ahead = self._ahead = start, self._read(start, min(AHEAD_BYTES, self.size_bytes - start))
        return ahead[start - first : start - first + count]

    def _read(self, start: int, count: int) -> bytes:
        file = self._file
        if file is None:
            with self._lock:
                if self._file is None:
                    self._file = open_regular(self.path, buffering=0)
                    weakref.finalize(self, self._file.close)
                file = self._file
        if sys.platform != "win32":  # processes that were split from one another share where a file is read
            data = os.pread(file.fileno(), count, start)
            while len(data) < count and (more := os.pread(file.fileno(), count - len(data), start + len(data))):
                data += more
        else:
            with self._lock:
                file.seek(start)
                data = file.read(count)
        if len(data) < count:
            raise _CutError(f"it ends before byte {start + count}")
        return data

    def check_chunks(self) -> None:
        """Refuse a file whose chunks say that they are far more than they can be. Raises InputError."""
        said = sum(chunk.whole_bytes for chunk in self.chunks)
        if said > max(SMALL_BYTES, LARGEST_RATIO * self.size_bytes):
            problem = f"has {self.size_bytes} bytes, and says that its chunks are {said}: that is no recording"
            raise InputError(self.path, problem, remedy="record it again")

    def part_of_chunk(self, number: int, start: int, count: int) -> bytes:
        """Return bytes of what a chunk holds; of the file for -1. Raises _CutError where it has not as many."""
        if number < 0:
            return self.at(start, count)
        chunk = self.chunks[number]
        if count < 0 or start < 0 or start + count > chunk.whole_bytes:
            raise _CutError(f"the chunk at byte {chunk.start} ends before what it says that it holds")
        if not chunk.compression:
            return self.at(chunk.start + start, count)
        return self.whole_chunk(number)[start : start + count]

    def whole_chunk(self, number: int) -> bytes:
        """Return what a chunk holds, decompressed; some are kept."""
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
                return self._kept[number]
        chunk = self.chunks[number]
        if chunk.whole_bytes > LARGEST_CHUNK_BYTES:
            problem = f"holds a chunk that says {chunk.whole_bytes} bytes; at most {LARGEST_CHUNK_BYTES} are read"
            raise InputError(self.path, problem, remedy="record it with smaller chunks")
        whole = decompressed(self.at(chunk.start, chunk.stored_bytes), chunk.compression, chunk.whole_bytes, self.path)
        with self._lock:
            self._kept[number] = whole
            while len(self._kept) > 1 and sum(map(len, self._kept.values())) > KEPT_BYTES:
                self._kept.popitem(last=False)
        return whole

    def close(self) -> None:
        """Close the file, and forget its chunks."""
        with self._lock:
            self._kept.clear()
            file, self._file = self._file, None
        if file is not None:
            file.close()


def decompressed(data: bytes, compression: str, size: int, path: Path) -> bytes:
    """Return what was compressed, of which there are `size` bytes. Raises _CutError where there are not."""
    if size == 0:
        return b""
    if compression not in ("bz2", "lz4", "zstd"):
        problem = f"is compressed by {compression[:40]!r}, and none, bz2, lz4 and zstd are read"
        raise InputError(path, problem, remedy="convert it")
    damaged: tuple[type[Exception], ...] = (ValueError, RuntimeError, EOFError, OSError, MemoryError)
    if compression == "bz2":
        decompress = bz2.BZ2Decompressor().decompress
    elif compression == "lz4":
        need(("lz4",), "ros", for_what=str(path))
        from lz4.frame import LZ4FrameDecompressor

        decompress = LZ4FrameDecompressor().decompress
    else:
        zstd = _zstd(path)
        decompress, damaged = zstd.ZstdDecompressor().decompress, (*damaged, zstd.ZstdError)
    try:
        whole = decompress(data, max_length=size)
    except damaged as error:
        raise _CutError(f"what is compressed cannot be read: {error}") from None
    if len(whole) != size:
        raise _CutError(f"a chunk says {size} bytes, and holds {len(whole)}")
    return whole


def compressed(data: bytes, compression: str, path: Path) -> bytes:
    """Return bytes compressed, by "" not at all, by lz4 or by zstd."""
    if compression == "lz4":
        need(("lz4",), "ros", for_what=str(path))
        from lz4.frame import compress

        return bytes(compress(data))
    return _zstd(path).compress(data) if compression else data


def unpacked(data: bytes, most: int, path: Path) -> bytes:
    """Return what is in a message that is compressed by itself, at most so many bytes. Raises _CutError."""
    zstd = _zstd(path)
    try:
        return zstd.ZstdDecompressor().decompress(data, max_length=most)
    except (ValueError, EOFError, MemoryError, zstd.ZstdError) as error:
        raise _CutError(f"a message that is compressed cannot be read: {error}") from None


def packed(data: bytes, like: bytes) -> bytes:
    """Return a message compressed by itself, if another that begins so is."""
    return _zstd(Path()).compress(data) if like.startswith(ZSTD_MAGIC) else data


def _zstd(path: Path) -> Any:
    if sys.version_info >= (3, 14):
        from compression import zstd

        return zstd
    need(("rosbags",), "ros", for_what=str(path))
    from backports import zstd

    return zstd


def _concatenated(found: list[tuple[int, int, Int64, Int64]]) -> Columns:
    """Return columns of blocks: connection, chunk, times and places; in the order of the file."""
    if not found:
        none = np.zeros(0, np.int64)
        return none, none, none, none
    connection = np.concatenate([np.full(len(item[2]), item[0], np.int64) for item in found])
    chunk = np.concatenate([np.full(len(item[2]), item[1], np.int64) for item in found])
    log_ns, offset = (np.concatenate([item[at] for item in found]) for at in (2, 3))
    order = np.lexsort((offset, chunk))
    return connection[order], log_ns[order], chunk[order], offset[order]


# --- ROS 1 ---

_MESSAGE, _BAG_HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_INDEX_ENTRY = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("offset", "<u4")])


class Ros1Part(_ChunkedPart):
    """A bag of ROS 1, version 2.0."""

    repair = "rosbag reindex"

    def index(self) -> tuple[list[Connection], Columns]:
        """Read the index at the end, and each chunk's behind it."""
        line = self.at(0, min(self.size_bytes, 64)).split(b"\n", 1)[0]
        if line != b"#ROSBAG V2.0":
            raise InputError(self.path, f"is a bag of version {line[9:20].decode('ascii', 'replace')!r}; 2.0 is read")
        header, _, _ = self._record(13, _BAG_HEADER)
        if header.get(b"encryptor"):
            raise InputError(self.path, "is encrypted", remedy="decrypt it")
        (at,) = _numbers("<Q", header, b"index_pos")
        if not at:
            raise InputError(self.path, "has no index: its recording was cut", remedy=f"run {self.repair}")
        (count,) = _numbers("<L", header, b"conn_count")
        (chunks,) = _numbers("<L", header, b"chunk_count")
        connections: dict[int, Connection] = {}
        for _ in range(count):
            header, data, at = self._record(at, _CONNECTION)
            found = _ros1_connection(header, data)
            connections[found.number] = found
        places: dict[int, int] = {}
        for _ in range(chunks):
            header, data, at = self._record(at, _CHUNK_INFO)
            (place,) = _numbers("<Q", header, b"chunk_pos")
            places[place] = len(data) // 8
        if len(places) != chunks:
            raise self.damaged("its index names a chunk twice")
        blocks: list[tuple[int, int, Int64, Int64]] = []
        entries = 0
        for place in sorted(places):
            for block in self._chunk(place, places[place]):
                blocks.append(block)
                entries += len(block[2])
                if entries * _INDEX_ENTRY.itemsize > self.size_bytes:
                    raise self.damaged("its index is larger than itself")
        self.check_chunks()
        return list(connections.values()), _concatenated(blocks)

    def _chunk(self, place: int, count: int) -> Iterator[tuple[int, int, Int64, Int64]]:
        """Yield what the indexes behind a chunk say."""
        number = len(self.chunks)
        header, start, stored = self._head(place, _CHUNK)
        compression = header.get(b"compression", b"").decode()
        (whole,) = _numbers("<L", header, b"size")
        self.chunks.append(_Chunk(start, stored, whole, "" if compression == "none" else compression))
        at = start + stored
        for _ in range(count):
            header, data, at = self._record(at, _INDEX)
            (connection,) = _numbers("<L", header, b"conn")
            entries = np.frombuffer(data[: len(data) // 12 * 12], _INDEX_ENTRY)
            log_ns = entries["sec"].astype(np.int64) * NS_PER_S + entries["nsec"]
            yield connection, number, log_ns, entries["offset"].astype(np.int64)

    def _head(self, at: int, kind: int, chunk: int = -1) -> tuple[dict[bytes, bytes], int, int]:
        """Return the fields of a record, and where its data begin and how many they are."""
        (length,) = struct.unpack("<L", self.part_of_chunk(chunk, at, 4))
        if length > LARGEST_HEADER_BYTES:
            raise _CutError(f"a record at byte {at} has a header of {length} bytes")
        fields = _fields(self.part_of_chunk(chunk, at + 4, length))
        if fields.get(b"op") != bytes([kind]):
            raise _CutError(f"there is no record of kind {kind} at byte {at}")
        (stored,) = struct.unpack("<L", self.part_of_chunk(chunk, at + 4 + length, 4))
        return fields, at + 8 + length, stored

    def _record(self, at: int, kind: int) -> tuple[dict[bytes, bytes], bytes, int]:
        """Return the fields and the data of a record, and where the next begins."""
        fields, start, stored = self._head(at, kind)
        if stored > self.size_bytes:
            raise _CutError(f"a record at byte {at} says {stored} bytes")
        return fields, self.at(start, stored), start + stored

    def data(self, chunk: int, offset: int, most: int | None) -> bytes:
        """Return the data of a message."""
        _, start, stored = self._head(offset, _MESSAGE, chunk)
        if stored > LARGEST_CHUNK_BYTES:
            raise _CutError(f"a message says {stored} bytes")
        part = stored if most is None else min(stored, most)
        if start + stored > self.chunks[chunk].whole_bytes:
            raise _CutError(f"a message says {stored} bytes, and its chunk ends before")
        return self.part_of_chunk(chunk, start, part)


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header of ROS 1: a length (4), a name, =, a value."""
    found: dict[bytes, bytes] = {}
    at = 0
    while at < len(data):
        (length,) = struct.unpack_from("<L", data, at)
        name, sign, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not sign or at + 4 + length > len(data):
            raise _CutError("a header holds what is no field")
        found[name] = value
        at += 4 + length
    return found


def _numbers(layout: str, fields: dict[bytes, bytes], *names: bytes) -> tuple[int, ...]:
    lacking = next((name for name in names if name not in fields), None)
    if lacking is not None:
        raise _CutError(f"a header has no {lacking.decode()}")
    return tuple(struct.unpack(layout, fields[name])[0] for name in names)


def _ros1_connection(header: dict[bytes, bytes], data: bytes) -> Connection:
    (number,) = _numbers("<L", header, b"conn")
    if number > 2**20:
        raise _CutError(f"a topic has the number {number}")
    more = _fields(data)
    latching = more.get(b"latching", b"").decode()
    return Connection(
        number,
        header.get(b"topic", b"").decode(),
        ros2_name(more.get(b"type", b"").decode()),
        "ros1",
        more.get(b"message_definition", b"").decode(),
        more.get(b"md5sum", b"").decode(),
        more[b"callerid"].decode() if b"callerid" in more else None,
        int(latching) if latching in ("0", "1") else None,
    )


def ros2_name(kind: str) -> str:
    """Return ROS 2's name of a type: sensor_msgs/Image is sensor_msgs/msg/Image there."""
    package, _, name = kind.partition("/")
    return kind if not name or name.startswith("msg/") else f"{package}/msg/{name}"


# --- MCAP ---

_M_HEADER, _M_FOOTER, _M_SCHEMA, _M_CHANNEL, _M_MESSAGE, _M_CHUNK, _M_INDEX = 1, 2, 3, 4, 5, 6, 7
_M_MESSAGE_BYTES = 22  # before a message's data: channel, number, and two times
_M_INDEX_ENTRY = np.dtype([("log_ns", "<u8"), ("offset", "<u8")])


class McapPart(_ChunkedPart):
    """An MCAP file; its records are looked through one after another, so it needs no summary."""

    repair = "mcap recover"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, tuple[int, str, str, str]] = {}

    def index(self) -> tuple[list[Connection], Columns]:
        """Look through the records; chunks without an index behind them are decompressed for theirs."""
        if self.size_bytes < 16 or self.at(self.size_bytes - 8, 8) != MCAP_MAGIC:
            raise InputError(self.path, "has no end: its recording or copying was cut", remedy=f"run {self.repair}")
        blocks: list[tuple[int, int, Int64, Int64]] = []
        single: list[tuple[int, int, int]] = []
        bare: set[int] = set()
        at, current = len(MCAP_MAGIC), -1
        while at < self.size_bytes - len(MCAP_MAGIC):
            kind, length = struct.unpack("<BQ", self.at(at, 9))
            start = at + 9
            if start + length > self.size_bytes:
                raise _CutError(f"a record at byte {at} says {length} bytes")
            match kind:
                case _ if kind == _M_CHUNK:
                    current = len(self.chunks)
                    self.chunks.append(self._chunk(start, length))
                    bare.add(current)
                case _ if kind == _M_INDEX:
                    channel, times, places = _mcap_index(self.at(start, length))
                    if current >= 0 and len(times):
                        bare.discard(current)
                        blocks.append((channel, current, times, places))
                case _ if kind == _M_MESSAGE:
                    channel, _, log_ns = struct.unpack("<HIQ", self.at(start, 14))
                    single.append((channel, log_ns, start))
                case _:
                    self._described(kind, lambda start=start, length=length: self.at(start, length), length)
            at = start + length
        self.check_chunks()
        for channel in {item[0] for item in single}:
            chosen = np.array([item[1:] for item in single if item[0] == channel], np.int64)
            blocks.append((channel, -1, chosen[:, 0], chosen[:, 1]))
        unknown = {block[1] for block in blocks if block[0] not in self._channels} - {-1}
        for number in sorted(bare | unknown):
            found = self._inside(number)
            blocks += found if number in bare else []
        return self._connections(), _concatenated(blocks)

    def _chunk(self, start: int, length: int) -> _Chunk:
        head = self.at(start, min(length, 128))
        whole, _, name = struct.unpack_from("<QII", head, 16)
        compression = head[32 : 32 + name].decode()
        (stored,) = struct.unpack_from("<Q", head, 32 + name)
        if 40 + name + stored > length:
            raise _CutError(f"the chunk at byte {start} ends before what it says that it holds")
        return _Chunk(start + 40 + name, stored, whole, compression)

    def _described(self, kind: int, content: Any, length: int) -> None:
        """Read a record that describes types or topics; others are passed over."""
        if kind not in (_M_SCHEMA, _M_CHANNEL):
            return
        if length > LARGEST_HEADER_BYTES:
            raise _CutError(f"a record that describes a topic has {length} bytes")
        texts = _McapTexts(content())
        number = texts.number()
        if kind == _M_SCHEMA:
            name, _, definition = texts.text(), texts.text(), texts.text()
            self._schemas[number] = (name, definition)
            return
        schema = texts.number()
        topic, encoding = texts.text(), texts.text()
        self._channels[number] = (schema, topic, encoding, texts.mapping().get("offered_qos_profiles", ""))

    def _inside(self, number: int) -> list[tuple[int, int, Int64, Int64]]:
        """Look through what a chunk holds; return where its messages lie."""
        chunk = self.chunks[number]
        if chunk.whole_bytes > LARGEST_CHUNK_BYTES:
            self.whole_chunk(number)  # which refuses it
        found: dict[int, list[tuple[int, int]]] = {}
        at = 0
        while at < chunk.whole_bytes:
            kind, length = struct.unpack("<BQ", self.part_of_chunk(number, at, 9))
            start = at + 9
            if start + length > chunk.whole_bytes:
                raise _CutError(f"a record in the chunk at byte {chunk.start} says {length} bytes")
            if kind == _M_MESSAGE:
                channel, _, log_ns = struct.unpack("<HIQ", self.part_of_chunk(number, start, 14))
                found.setdefault(channel, []).append((log_ns, at))
            else:
                where = (number, start, length)
                self._described(kind, lambda where=where: self.part_of_chunk(*where), length)
            at = start + length
        tables = {channel: np.array(rows, np.int64) for channel, rows in found.items()}
        return [(channel, number, table[:, 0], table[:, 1]) for channel, table in tables.items()]

    def channels_by_topic(self) -> dict[str, int]:
        """Return the number of a channel of each topic."""
        return {topic: number for number, (_, topic, _, _) in self._channels.items()}

    def _connections(self) -> list[Connection]:
        return [
            Connection(
                number,
                topic,
                ros2_name(self._schemas.get(schema, ("", ""))[0]),
                encoding,
                self._schemas.get(schema, ("", ""))[1],
                qos=qos,
            )
            for number, (schema, topic, encoding, qos) in sorted(self._channels.items())
        ]

    def data(self, chunk: int, offset: int, most: int | None) -> bytes:
        """Return the data of a message. offset: of its record in a chunk, or of what is in the record in the file."""
        kind, length = struct.unpack("<BQ", self.part_of_chunk(chunk, offset if chunk >= 0 else offset - 9, 9))
        start = offset + 9 if chunk >= 0 else offset
        if kind != _M_MESSAGE or not _M_MESSAGE_BYTES <= length <= LARGEST_CHUNK_BYTES:
            raise _CutError(f"there is no message at byte {offset}")
        self.part_of_chunk(chunk, start + length, 0)  # it lies there whole
        count = length - _M_MESSAGE_BYTES
        return self.part_of_chunk(chunk, start + _M_MESSAGE_BYTES, count if most is None else min(count, most))


def _mcap_index(data: bytes) -> tuple[int, Int64, Int64]:
    channel, length = struct.unpack_from("<HI", data)
    if length != len(data) - 6 or length % _M_INDEX_ENTRY.itemsize:
        raise _CutError("an index of messages has another length than it says")
    entries = np.frombuffer(data, _M_INDEX_ENTRY, offset=6)
    if len(entries) and max(entries["log_ns"].max(), entries["offset"].max()) >= 2**63:
        raise _CutError("an index of messages holds what is no time")
    return channel, entries["log_ns"].astype(np.int64), entries["offset"].astype(np.int64)


class _McapTexts:
    """Numbers and texts of a record, one after another."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.place = 0

    def number(self) -> int:
        """Return a number of 16 bits."""
        (value,) = struct.unpack_from("<H", self.data, self.place)
        self.place += 2
        return value

    def text(self) -> str:
        """Return a text."""
        (length,) = struct.unpack_from("<I", self.data, self.place)
        self.place += 4 + length
        if self.place > len(self.data):
            raise _CutError("a text is longer than its record")
        return self.data[self.place - length : self.place].decode()

    def mapping(self) -> dict[str, str]:
        """Return a mapping of texts."""
        (length,) = struct.unpack_from("<I", self.data, self.place)
        self.place += 4
        end, found = self.place + length, dict[str, str]()
        while self.place < end:
            name = self.text()
            found[name] = self.text()
        return found


# --- SQLite ---

_TABLES = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"id", "topic_id", "timestamp", "data"},
}


class SqlitePart(BagPart):
    """A database of rosbag2."""

    repair = "sqlite3 FILE .recover"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._local = threading.local()

    def _database(self) -> sqlite3.Connection:
        """Return this thread's connection; one that was split off with a process is left alone."""
        if getattr(self._local, "process", None) != os.getpid():
            name = self.path.resolve().as_uri()
            made = sqlite3.connect(f"{name}?mode=ro&immutable=1", uri=True, check_same_thread=False)
            weakref.finalize(self, made.close)
            made.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_CHUNK_BYTES)
            made.execute("PRAGMA trusted_schema = OFF")
            made.execute("PRAGMA cell_size_check = ON")
            self._local.database, self._local.process = made, os.getpid()
        return self._local.database

    def index(self) -> tuple[list[Connection], Columns]:
        """Ask for the topics, and for all of the messages but their data."""
        beside = self.path.with_name(self.path.name + "-wal")
        if beside.is_file() and beside.stat().st_size:
            raise InputError(self.path, f"was not closed: {beside.name} holds more", remedy="open it once with sqlite3")
        database = self._database()
        for table, columns in _TABLES.items():
            made = database.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)).fetchall()
            plain = [sql for kind, sql in made if kind == "table" and re.match(r"\s*CREATE\s+TABLE\b", str(sql), re.I)]
            there = {row[1] for row in database.execute(f"PRAGMA table_info({table})")}
            if not plain or not columns <= there:
                raise InputError(self.path, f"is no bag: it has no table {table} as rosbag2 has it")
        more = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
        wanted = [name if name in more else "''" for name in ("offered_qos_profiles", "type_description_hash")]
        asked = f"SELECT id, name, type, serialization_format, {', '.join(wanted)} FROM topics"  # noqa: S608 - ours
        definitions = self._definitions(database)
        connections = []
        for number, *texts in database.execute(asked).fetchmany(MOST_PARTS):
            if not _is_number(number) or not 0 <= number <= 2**20 or not all(isinstance(text, str) for text in texts):
                raise _CutError("a topic has no sound number, name or type")
            topic, kind, form, qos, digest = texts
            definition = definitions.get(kind, "")
            connections.append(Connection(number, topic, kind, form, definition, digest, qos=qos))
        rows = database.execute("SELECT topic_id, timestamp, id FROM messages ORDER BY id")
        blocks: list[NDArray[np.int64]] = []
        while some := rows.fetchmany(100_000):
            if not all(_is_number(value) for row in some for value in row):
                raise _CutError("a message has what is no number for its topic or its time")
            blocks.append(np.array(some, np.int64))
        found = np.concatenate(blocks) if blocks else np.zeros((0, 3), np.int64)
        return connections, (found[:, 0], found[:, 1], np.full(len(found), -1, np.int64), found[:, 2])

    def _definitions(self, database: sqlite3.Connection) -> dict[str, str]:
        names = {row[1] for row in database.execute("PRAGMA table_info(message_definitions)")}
        if not {"topic_type", "encoded_message_definition"} <= names:
            return {}
        rows = database.execute("SELECT topic_type, encoded_message_definition FROM message_definitions LIMIT 10000")
        return {str(kind): str(text) for kind, text in rows}

    def data(self, chunk: int, offset: int, most: int | None) -> bytes:
        """Return the data of a message."""
        del chunk
        with self._database().blobopen("messages", "data", offset, readonly=True) as blob:
            if len(blob) > LARGEST_CHUNK_BYTES:
                raise _CutError(f"a message has {len(blob)} bytes")
            return blob.read() if most is None else blob.read(most)

    def close(self) -> None:
        """Close this thread's connection."""
        if getattr(self._local, "process", None) == os.getpid():
            self._local.database.close()
        self._local = threading.local()


def _is_number(value: object) -> bool:
    return isinstance(value, int) and -(2**63) <= value < 2**63
