# SPDX-License-Identifier: GPL-3.0-or-later
"""Tars that are the same to the byte whenever and wherever they are written, and written without going back."""

import tarfile
from typing import Protocol

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
