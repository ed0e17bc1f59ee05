# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tars of a packed dataset hold, hashed: each is read once, from its beginning to its end."""

import contextlib
import hashlib
import io
import tarfile
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field

from ..core.datasets.records import FRAMES, FrameRecord, joined_records, read_record
from ..core.errors import InterruptedRunError
from ..core.working_ahead import done_ahead
from .packed_names import FRAMES_FOLDER, tar_name
from .store import Store

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
    store: Store, sequences: list[str], sizes: dict[str, int], stop: threading.Event
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
    records = joined_records(filter(None, map(read_record, found.lines(sequence))))
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
