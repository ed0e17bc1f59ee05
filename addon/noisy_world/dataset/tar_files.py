# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a packed dataset: its tars, written and read, and the table that says where each frame lies in them."""

import contextlib
import hashlib
import io
import tarfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, Protocol

from ..core.errors import InputError, InterruptedRunError
from ..core.file_access import parse_json
from ..core.frame_table import FRAMES, FrameRecord, joined_records, records_in
from ..core.machine import done_ahead
from ..layouts import Modality
from .store import Store, missing

TABLE = "manifest.parquet"
CROISSANT = "croissant.json"
CARD = "README.md"
FRAMES_FOLDER = "frames"  # in a tar
TAR_SUFFIX = ".tar"


@dataclass(frozen=True)
class PackedFile:
    """A file of a packed dataset. name: from its place on. size: bytes."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Span:
    """Where the content of a file lies in its tar. offset, size: in bytes."""

    offset: int
    size: int


@dataclass(frozen=True)
class FrameSpans:
    """Where a frame lies in its sequence's tar: its JSON and its images."""

    json: Span
    images: dict[Modality, Span]


def tar_name(sequence: str) -> str:
    """Return the name of a sequence's tar, from the dataset's place on."""
    return f"{sequence}{TAR_SUFFIX}"


READERS = 4  # tars that are read at once: stores answer late; chosen: 30 MB of memory each
PIECE_BYTES = 2**20


@dataclass(frozen=True)
class TarContent:
    """A tar's files. digests: the SHA-256 of each by its name in the dataset, links too. records: of its frames.jsonl.

    sha256: of the tar. Of one that is damaged, what lies behind the damage may be missing here.
    """

    digests: dict[str, str]
    records: dict[int, FrameRecord]
    sha256: str

    def of_layout(self, sequence: str) -> dict[str, str]:
        """Return the files that unpacking gives, samples aside: SHA-256 by name in the sequence's folder."""
        start = f"{sequence}/"
        names = (name for name in self.digests if name.startswith(start))
        return {
            name.removeprefix(start): self.digests[name]
            for name in names
            if not name.startswith(f"{start}{FRAMES_FOLDER}/")
        }

    def beside(self, sequence: str) -> dict[str, str]:
        """Return the files beside the sequence's folder: SHA-256 by name in the dataset."""
        return {name: digest for name, digest in self.digests.items() if not name.startswith(f"{sequence}/")}


def tar_contents(
    store: Store, sequences: Sequence[str], sizes: dict[str, int], stop: threading.Event
) -> Iterator[tuple[str, TarContent]]:
    """Yield the sequences with what their tars hold, in order; several are read at a time.

    sizes: of the files in the store. Raises StorageError where the store refuses, InterruptedRunError where `stop` is
    set.
    """
    ending = threading.Event()  # so that nobody waits for tars that are not asked for any more

    def read(sequence: str) -> TarContent:
        return read_tar(store, sequence, sizes[tar_name(sequence)], lambda: stop.is_set() or ending.is_set())

    with closing(done_ahead(read, sequences, threads=READERS, ahead=READERS, name="tar-reader")) as contents:
        try:
            yield from contents
        finally:
            ending.set()


def read_tar(store: Store, sequence: str, size: int, stopped: Callable[[], bool]) -> TarContent:
    """Return what the tar of a sequence holds. Raises InterruptedRunError where `stopped` says so."""
    stream = _Hashed(store.pieces(tar_name(sequence), size), stopped)
    found = _TarMembers()
    # ValueError: of numbers in a damaged header
    with (
        contextlib.suppress(tarfile.TarError, EOFError, ValueError),
        tarfile.open(fileobj=stream, mode="r|", bufsize=PIECE_BYTES) as tar,
    ):
        for member in tar:
            found.add(tar, member)
    while stream.read(PIECE_BYTES):
        pass
    records = joined_records(records_in(found.lines(sequence)))
    return TarContent(found.digests, records, stream.sha256)


def texts_of(data: bytes, sequence: str) -> dict[str, bytes]:
    """Return the text files of a sequence by name, of a tar's end that begins with a header.

    Of an end that is damaged, what lies behind the damage may be missing.
    """
    found = _TarMembers()
    with contextlib.suppress(tarfile.TarError, EOFError, ValueError), tarfile.open(fileobj=io.BytesIO(data)) as tar:
        for member in tar:
            found.add(tar, member)
    start = f"{sequence}/"
    named = {name.removeprefix(start): stored for name, stored in found.stored.items() if name.startswith(start)}
    return {name: found.texts[stored] for name, stored in named.items() if stored in found.texts}


@dataclass
class _TarMembers:
    """The members of a tar so far. stored: what links lead to. texts: the content of text files, as they are stored."""

    digests: dict[str, str] = field(default_factory=dict)
    stored: dict[str, str] = field(default_factory=dict)
    texts: dict[str, bytes] = field(default_factory=dict)

    def add(self, tar: tarfile.TarFile, member: tarfile.TarInfo) -> None:
        """Hash a member; a link is what it leads to."""
        if member.islnk() and member.linkname in self.digests:
            self.digests[member.name] = self.digests[member.linkname]
            self.stored[member.name] = member.linkname
        elif member.isreg() and (file := tar.extractfile(member)) is not None:
            digest = hashlib.sha256()
            kept: list[bytes] | None = [] if f"/{FRAMES_FOLDER}/texts/" in member.name else None
            while piece := file.read(PIECE_BYTES):
                digest.update(piece)
                if kept is not None:
                    kept.append(piece)
            self.digests[member.name] = digest.hexdigest()
            if kept is not None:
                self.texts[member.name] = b"".join(kept)

    def lines(self, sequence: str) -> list[str]:
        """Return the lines of the sequence's frames.jsonl."""
        data = self.texts.get(self.stored.get(f"{sequence}/{FRAMES}", ""), b"")
        return data.decode(errors="replace").splitlines(keepends=True)


class _Hashed(io.RawIOBase):
    """Pieces of a file, read as one stream and hashed on the way."""

    def __init__(self, pieces: Iterator[bytes], stopped: Callable[[], bool]) -> None:
        super().__init__()
        self._pieces = pieces
        self._stopped = stopped
        self._left = b""
        self._at = 0
        self._digest = hashlib.sha256()

    @property
    def sha256(self) -> str:
        """The SHA-256 of what was read, in hexadecimal."""
        return self._digest.hexdigest()

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes, as many as are at hand; none at the end."""
        if self._at == len(self._left):
            if self._stopped():
                raise InterruptedRunError("stopped; nothing was written")
            self._left, self._at = next(self._pieces, b""), 0
            self._digest.update(self._left)
        stop = len(self._left) if size < 0 else self._at + size
        data = self._left[self._at : stop]
        self._at += len(data)
        return data


# Tars that are the same to the byte whenever and wherever they are written, and written without going back.


BLOCK = tarfile.BLOCKSIZE


class Sink(Protocol):
    """What a tar is written to."""

    def write(self, data: bytes, /) -> int:
        """Write the next bytes."""
        ...

    def tell(self) -> int:
        """Return how many bytes were written."""
        ...


class TarStream:
    """A tar of plain files and of links to these, in the order in which they are added.

    Owner, mode and time are the same for all: 0, rw-r--r--, 1 January 1970. POSIX's pax format says in a block of its
    own what the older format cannot hold: names of more than 100 bytes.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink

    def add(self, name: str, data: bytes) -> int:
        """Add a file; return where its content begins in the tar."""
        info = _entry(name)
        info.size = len(data)
        self._head(info)
        offset = self._sink.tell()
        self._sink.write(data)
        self._fill(BLOCK)
        return offset

    def link(self, name: str, target: str) -> None:
        """Add another name of a file that was added; unpacked, it is a hard link."""
        info = _entry(name)
        info.type = tarfile.LNKTYPE
        info.linkname = target
        self._head(info)

    def close(self) -> None:
        """Write the tar's end."""
        self._sink.write(bytes(2 * BLOCK))
        self._fill(tarfile.RECORDSIZE)

    def _head(self, info: tarfile.TarInfo) -> None:
        self._sink.write(info.tobuf(tarfile.PAX_FORMAT, "utf-8", "strict"))

    def _fill(self, block: int) -> None:
        """Write zeros up to the next block."""
        self._sink.write(bytes(-self._sink.tell() % block))


def _entry(name: str) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.mode = 0o644
    return info


# Reading manifest.parquet: the rows of a sequence and the columns that are asked for, by ranges of the file.


AGAIN = "'noisy-world verify' tells what else is damaged; publish the dataset again, to another address"


class PackedTable:
    """The table of a packed dataset. Memory holds its index, and what is asked for; threads may share it."""

    def __init__(self, store: Store) -> None:
        """Read the table's index. Raises InputError where there is no table or it is damaged."""
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError as error:
            raise missing(store.text, "pyarrow") from error
        self._place = store.of(TABLE)
        # What pyarrow raises where a file is no Parquet, or its bytes are not what its index says.
        self._damage = (pyarrow.ArrowInvalid, pyarrow.ArrowNotImplementedError, pyarrow.ArrowKeyError)
        size = store.size(TABLE)
        if size is None:
            raise InputError(self._place, "is not there", remedy=AGAIN)
        self._lock = threading.Lock()
        try:
            file = pyarrow.PythonFile(_Ranges(store, TABLE, size), mode="r")
            self._file: Any = pyarrow.parquet.ParquetFile(file, pre_buffer=True)
            self._groups = self._groups_of_sequences()
        except (*self._damage, OSError) as error:
            raise self._damaged(error) from error

    def rows(self, sequence: str, columns: list[str]) -> Any:
        """Return some columns of a sequence's rows, in the order of its frames, as a table of pyarrow.

        Raises InputError where the table is damaged or has no such rows.
        """
        groups = self._groups.get(sequence)
        if groups is None:
            raise InputError(self._place, f"has no rows of {sequence}", remedy=AGAIN)
        try:
            with self._lock:
                return self._file.read_row_groups(groups, columns=columns, use_threads=False)
        except (*self._damage, OSError) as error:
            raise self._damaged(error) from error

    def _groups_of_sequences(self) -> dict[str, list[int]]:
        """Return the row groups of each sequence, which begin and end with it, by the statistics of their columns."""
        leaves = {self._file.schema.column(place).path: place for place in range(len(self._file.schema))}
        if not leaves.keys() >= {"setting", "scene"}:
            raise InputError(self._place, "says neither setting nor scene of its rows", remedy=AGAIN)
        about = self._file.metadata
        found: dict[str, list[int]] = {}
        for group in range(about.num_row_groups):
            lines = [about.row_group(group).column(leaves[name]).statistics for name in ("setting", "scene")]
            if not all(item is not None and item.has_min_max and item.min == item.max for item in lines):
                raise InputError(self._place, "its rows are not grouped by sequence", remedy=AGAIN)
            found.setdefault("/".join(str(item.min) for item in lines), []).append(group)
        return found

    def _damaged(self, error: Exception) -> InputError:
        problem = " ".join(str(error).split())
        return InputError(self._place, f"is damaged: {problem}", remedy=AGAIN)


class _Ranges(io.RawIOBase):
    """A file in a store that is read by ranges, and only where it is asked for."""

    def __init__(self, store: Store, name: str, size: int) -> None:
        super().__init__()
        self._store = store
        self._name = name
        self._size = size
        self._at = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def size(self) -> int:
        """The file's size, as pyarrow asks for it."""
        return self._size

    def read(self, size: int = -1) -> bytes:
        stop = self._size if size is None or size < 0 else min(self._size, self._at + size)
        data = b"" if stop <= self._at else self._store.read_range(self._name, self._at, stop)
        self._at += len(data)
        return data


# croissant.json says the size and the hash of each of these; `packing` writes it.


def described_files(data: bytes | None) -> dict[str, PackedFile]:
    """Return the files that croissant.json's content describes, by name; {} where it is of no use."""
    try:
        items = () if data is None else parse_json(data.decode())["distribution"]
        return {file.name: file for item in items if (file := _file_of(item)) is not None}
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def _file_of(item: Any) -> PackedFile | None:
    """Return a file of croissant.json's distribution; None for what is no file."""
    if item["@type"] != "cr:FileObject":
        return None
    return PackedFile(str(item["@id"]), int(item["contentSize"].removesuffix(" B")), str(item["sha256"]))
