# SPDX-License-Identifier: GPL-3.0-or-later
"""The one door through which files are read: regular files alone, and no more of one than its reader can use.

A pipe would be waited for, and a device such as /dev/zero never ends. What cannot be read is an OSError, whose
`strerror` is a line for the user.
"""

import errno
import io
import math
import os
import stat
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, TypeAlias

if TYPE_CHECKING:
    from numpy.typing import NDArray

FileName: TypeAlias = str | os.PathLike[str]

LARGEST_TEXT_BYTES = 2**30  # chosen: three million poses as text, or the records of as many frames

# To open a pipe waits for who writes to it, unless with O_NONBLOCK, which regular files ignore. Windows has O_BINARY.
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"))
_KINDS = {
    stat.S_IFIFO: ("a pipe", "save what comes out of it as a file, and name that"),
    stat.S_IFCHR: ("a device", "name a file"),
    stat.S_IFBLK: ("a device", "name a file"),
    stat.S_IFSOCK: ("a socket", "name a file"),
}


class UnfitFileError(OSError):
    """What should be read is no file that is: its text is the line for the user alone, without number and name."""

    def __str__(self) -> str:
        return str(self.strerror)


class NotRegularError(UnfitFileError):
    """What should be a file is a pipe, a device or a socket."""


class TooLargeError(UnfitFileError):
    """A file has more bytes than its reader takes."""


def open_regular(path: FileName, *, largest_bytes: int | None = None, buffering: int = -1) -> BinaryIO:
    """Open a regular file, or the one that a link leads to, to read its bytes.

    largest_bytes: None for a file of any size. Raises OSError: NotRegularError for a pipe, a device or a socket,
    TooLargeError, and what the system says.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except OSError as error:
        if error.errno == errno.ENXIO:  # what Linux says of a socket
            raise _not_regular(stat.S_IFSOCK, path) from None
        raise
    try:
        _check(os.fstat(descriptor), path, largest_bytes)
        return os.fdopen(descriptor, "rb", buffering)
    except BaseException:
        os.close(descriptor)
        raise


def open_text(path: FileName, *, errors: str = "strict") -> TextIO:
    """Open a regular file to read its lines, in UTF-8. errors: as of `bytes.decode`. Raises OSError."""
    return io.TextIOWrapper(open_regular(path), encoding="utf-8", errors=errors)


def read_bytes(path: FileName, *, largest_bytes: int | None = LARGEST_TEXT_BYTES) -> bytes:
    """Return the content of a regular file. largest_bytes: None for a file of any size. Raises OSError."""
    most = math.inf if largest_bytes is None else largest_bytes
    with open_regular(path, largest_bytes=largest_bytes) as file:
        data = file.read(os.fstat(file.fileno()).st_size + 1)
        while len(data) <= most and (more := file.read(len(data))):  # a file of /proc has no size, but content
            data += more
    if largest_bytes is not None and len(data) > largest_bytes:
        raise _too_large(len(data), largest_bytes, path)
    return data


def read_text(path: FileName, *, encoding: str = "utf-8", errors: str = "strict") -> str:
    """Return the text of a regular file, its lines ended by line feeds. Raises OSError, and UnicodeDecodeError."""
    return read_bytes(path).decode(encoding, errors).replace("\r\n", "\n").replace("\r", "\n")


def read_array(path: FileName) -> "NDArray[Any]":
    """Return the array in a file of numpy's. Raises OSError, and ValueError or EOFError for what is none."""
    import numpy as np  # noqa: PLC0415 - what asks whether numpy is here reads files too

    with open_regular(path) as file:
        return np.load(file, allow_pickle=False)


def check_regular(path: FileName, *, largest_bytes: int | None = None) -> None:
    """Raise OSError where a name, for a library that opens files by name, is no regular file."""
    _check(os.stat(path), path, largest_bytes)  # noqa: PTH116 - thousands are asked for, and a Path costs as much


def _check(found: os.stat_result, path: FileName, largest_bytes: int | None) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder, not a file", os.fspath(path))
    if not stat.S_ISREG(found.st_mode):
        raise _not_regular(stat.S_IFMT(found.st_mode), path)
    if largest_bytes is not None and found.st_size > largest_bytes:
        raise _too_large(found.st_size, largest_bytes, path)


def _not_regular(kind: int, path: FileName) -> NotRegularError:
    name, remedy = _KINDS.get(kind, ("no file", "name a file"))
    return NotRegularError(errno.EINVAL, f"it is {name}, not a file; {remedy}", os.fspath(path))


def _too_large(found_bytes: int, largest_bytes: int, path: FileName) -> TooLargeError:
    message = f"it has {found_bytes} bytes or more; at most {largest_bytes} are read"
    return TooLargeError(errno.EFBIG, message, os.fspath(path))
