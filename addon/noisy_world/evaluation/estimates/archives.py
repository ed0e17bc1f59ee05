# SPDX-License-Identifier: GPL-3.0-or-later
"""Zip archives that anybody may have made: their lists of content are read up to a size."""

import io
import zipfile
from typing import BinaryIO, cast

LARGEST_LIST_BYTES = 16 * 2**20  # chosen: of some hundred thousand files


class _Pieces(io.RawIOBase):
    """A file of which no piece is read that is larger than a list of content may be."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def read(self, size: int = -1, /) -> bytes:
        """Read a piece. Raises BadZipFile where it is too large."""
        if size > LARGEST_LIST_BYTES:
            raise zipfile.BadZipFile("the list of its content is too large")
        return self._stream.read(size)

    def seek(self, place: int, whence: int = 0, /) -> int:
        """Go to a place."""
        return self._stream.seek(place, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._stream.tell()

    def seekable(self) -> bool:
        """Tell that one may go to any place."""
        return True

    def readable(self) -> bool:
        """Tell that one may read."""
        return True


def open_archive(stream: BinaryIO) -> zipfile.ZipFile:
    """Open an archive. Raises BadZipFile, and what zipfile raises beside it."""
    file = cast("BinaryIO", _Pieces(stream))
    return zipfile.ZipFile(file)
