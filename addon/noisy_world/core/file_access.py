# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading regular files alone and JSON strictly, names that C libraries can take, home and scratch folders.

Reading regular files alone, names that libraries in C can take, home folders, and scratch folders.

The one door through which files are read: regular files alone, and no more of one than its reader can use.

A pipe would be waited for, and a device such as /dev/zero never ends. What cannot be read is an OSError, whose
`strerror` is a line for the user.
"""

import contextlib
import errno
import io
import json
import math
import os
import shutil
import stat
import sys
import tempfile
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, TypeAlias

from .errors import InputError, StorageError, one_line
from .schema import ConfigPath

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
    import numpy as np  # what asks whether numpy is here reads files too

    with open_regular(path) as file:
        return np.load(file, allow_pickle=False)


def check_regular(path: FileName) -> None:
    """Raise OSError where a name, for a library that opens files by name, is no regular file."""
    _check(os.stat(path), path, None)  # noqa: PTH116 - thousands are asked for, and a Path costs as much


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


# The border that names of files pass: to libraries in C, which end the process over other bytes, and into JSON.
#
# Linux lets a file's name be any bytes. Python holds those that are not UTF-8 as halves of surrogate pairs, over which
# OpenCV ends the process by a signal, and which neither JSON nor YAML can hold.


Name: TypeAlias = str | os.PathLike[str]

NOT_UTF8 = "has a name that is not UTF-8, or lies in a folder that has"
RENAME = "rename it"


def is_utf8(name: Name) -> bool:
    """Tell whether a name, or a path, is text that UTF-8 can hold."""
    try:
        os.fspath(name).encode()
    except UnicodeEncodeError:
        return False
    return True


def utf8_name(path: Name) -> str:
    """Return a path as a library in C, JSON and YAML take it. Raises InputError where its name is not UTF-8."""
    if not is_utf8(path):
        raise InputError(os.fspath(path), NOT_UTF8, remedy=RENAME)
    return os.fspath(path)


def check_utf8_values(value: Any, file: Name, where: str = "") -> None:
    """Look at the texts of a document before it is written as JSON or YAML, or read as if it had been.

    file, where: of the document, and of a value in it. Raises InputError, which names the key.
    """
    match value:
        case str() if not is_utf8(value):
            raise InputError(os.fspath(file), f"{value} {NOT_UTF8}", where=where, remedy=RENAME)
        case dict():
            for name, item in value.items():
                check_utf8_values(item, file, f"{where}.{name}" if where else str(name))
        case list() | tuple():
            for number, item in enumerate(value):
                check_utf8_values(item, file, f"{where}.{number}" if where else str(number))


# Paths that begin with ~, as shells write home folders; in a preset or after `--out=` no shell replaces it.


def with_home(text: str) -> Path:
    """Return a path with ~ or ~user at its beginning replaced by that home folder; any other path as it is.

    Raises LookupError, with what is wrong and how to mend it in one line, where there is no such user, and where the
    path is not UTF-8.
    """
    if not is_utf8(text):
        raise LookupError(f"{one_line(text)} {NOT_UTF8}; {RENAME}")
    base, rest = split_home(text)
    return Path(rest) if base is None else base / rest


def split_home(text: str) -> tuple[Path | None, str]:
    """Return the home folder that a path or a glob pattern begins with, and the rest of it; None without one.

    Raises LookupError as `with_home` does.
    """
    if not text.startswith("~"):
        return None, text
    user, *rest = (text.replace("\\", "/") if os.name == "nt" else text).split("/", 1)
    try:
        return Path(user).expanduser(), "".join(rest).lstrip("/")
    except RuntimeError as error:
        whose = f"no user {user[1:]!r}" if user != "~" else "no home folder"
        raise LookupError(
            f"there is {whose} here, which {user} stands for; write ./{text} for what has this name"
        ) from error


def located(folder: Path, text: str, place: ConfigPath) -> tuple[Path, str]:
    """Return the folder that a path or glob pattern of a preset is relative to, and the path in it.

    folder: the preset's, which counts unless the path begins with ~ or ~user. place: of the path. Raises InputError
    where there is no such user.
    """
    try:
        home, rest = split_home(text)
    except LookupError as error:
        raise place.error(str(error)) from error
    return (folder if home is None else home), rest


def path_in(folder: Path, text: str, place: ConfigPath) -> Path:
    """Return the file or folder that a path of a preset in `folder` means.

    Raises InputError as `located` does, and where its name is not UTF-8.
    """
    base, rest = located(folder, text, place)
    path = base / rest
    check_utf8(path, place)
    return path


def check_utf8(path: Path, place: ConfigPath) -> None:
    """Refuse a file or folder that a key of a preset leads to where its name is not UTF-8."""
    if not is_utf8(path):
        raise place.error(f"{path} {NOT_UTF8}", RENAME)


def private_cache_folder() -> Path | None:
    """Return the folder of this user's caches of ours, made where it was not.

    None where there is no home, where it cannot be made or written, and where others could write into it.
    """
    try:
        if sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = base / "noisy-world"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except (OSError, RuntimeError):
        return None
    theirs = sys.platform != "win32" and (found.st_uid != os.geteuid() or found.st_mode & 0o022)
    return folder if not theirs and os.access(folder, os.W_OK) else None


# Scratch folders in memory, each locked by the process that uses it; those of processes that ended are removed.
#
# The lock is the system's own, on the folder: it is released however a process ends, and holds for every process of the
# machine, whatever it takes for its number, as in a container. Where there are no such locks, on Windows, nothing is
# swept.


SCRATCH_PREFIX = "noisy-world-scratch-"
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it


class ScratchFolder:
    """A folder for files that need not outlive the process."""

    def __init__(self, bytes_needed: int) -> None:
        """Make the folder in memory or, if that is too small, on the disk; remove those that killed processes left.

        Raises StorageError where no folder can be made.
        """
        try:
            disk = _temporary_folder()
            in_memory = SHARED_MEMORY.is_dir() and os.access(SHARED_MEMORY, os.W_OK)
            for folder in {disk, SHARED_MEMORY} if in_memory else {disk}:
                sweep(folder)
            roomy = in_memory and shutil.disk_usage(SHARED_MEMORY).free > 2 * bytes_needed
            self.path, lock = _make(SHARED_MEMORY if roomy else disk)
        except OSError as error:
            problem = f"no folder for scratch files can be made: {error.strerror or error}"
            raise StorageError(f"{problem}; name one with room in the environment variable TMPDIR") from error
        self._remove = weakref.finalize(self, _remove, self.path, lock)

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        self._remove()


def _temporary_folder() -> Path:
    """Return the system's folder of temporary files. Raises OSError where Blender could not be given its name."""
    folder = Path(tempfile.gettempdir())
    if not is_utf8(folder):
        raise OSError(errno.EILSEQ, f"{folder} {NOT_UTF8}")
    return folder


def sweep(parent: Path) -> None:
    """Remove this user's scratch folders that no living process holds."""
    if sys.platform == "win32":
        return
    for left in parent.glob(f"{SCRATCH_PREFIX}*"):
        with contextlib.suppress(OSError):  # it is gone, held, no folder, or another user's
            descriptor = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                _lock(descriptor, wait=False)
                if os.fstat(descriptor).st_uid == os.geteuid():
                    shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(descriptor)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other process is alone in a folder, and then be it, where there are such locks."""
    descriptor = None if sys.platform == "win32" else os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if descriptor is not None:
            with contextlib.suppress(OSError):  # the file system has no locks
                _lock(descriptor, wait=True)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _make(parent: Path) -> tuple[Path, int | None]:
    """Make a folder; return it, and the descriptor that holds its lock, if the file system has such locks."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=SCRATCH_PREFIX, dir=parent))
        if sys.platform == "win32":
            return path, None
        with contextlib.suppress(FileNotFoundError):
            descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
            try:
                _lock(descriptor, wait=True)
            except OSError:  # then no other process can lock it either, and none removes it
                os.close(descriptor)
                return path, None
            # Another process may have swept it between our making it and our locking it; then try again.
            if path.exists() and path.stat().st_ino == os.fstat(descriptor).st_ino:
                return path, descriptor
            os.close(descriptor)


def _lock(descriptor: int, *, wait: bool) -> None:
    """Take the lock of a folder. Raises OSError where another process holds it, unless this one waits."""
    if sys.platform != "win32":
        import fcntl  # not on Windows

        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def _remove(path: Path, descriptor: int | None) -> None:
    shutil.rmtree(path, ignore_errors=True)
    if descriptor is not None:
        os.close(descriptor)


# Strict reading of JSON, from users and of our own files, which may have been changed since.


DEEPEST = 60  # levels of nesting; what is written here has about ten


def read_json(path: Path) -> Any:
    """Return the content of a file of JSON; links are followed.

    Raises FileNotFoundError, with no such file and no link of that name, and ValueError with the reason, in a few
    words, where the file cannot be read.
    """
    if path.is_dir():
        raise ValueError("is a folder")
    if not path.is_file() and os.path.lexists(path):
        raise ValueError("is a link that leads nowhere" if path.is_symlink() else "is not a file")
    try:
        value = parse_json(read_bytes(path).decode())
        json.dumps(value, ensure_ascii=False).encode()  # half a surrogate pair could not be written again
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    except UnicodeError as error:
        raise ValueError("is not UTF-8") from error
    return value


def parse_json(text: str) -> Any:
    """Return the value of a JSON text. Raises ValueError for what could not be written again: not a number, infinity.

    Neither is a value accepted that is nested more deeply than anything written here.
    """
    try:
        value = _DECODER.decode(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"cannot be read at line {error.lineno}, column {error.colno}") from error
    if text.count("{") + text.count("[") > DEEPEST:  # most have too few to be nested that deeply
        _check_depth(value)
    return value


def parse_json_file(text: str, path: Path, *, where: str = "", remedy: str = "") -> Any:
    """Return the value of a JSON text that a user gave. Raises InputError, which names the file and `where`."""
    try:
        return parse_json(text)
    except ValueError as error:
        raise InputError(path, f"is not valid JSON: it {error}", where=where, remedy=remedy) from error


def finite_number(value: object) -> float | None:
    """Return a JSON value as a float, or None where it is no finite number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def plain_values(value: Any) -> Any:
    """Return a value as JSON holds it: lists for tuples, texts as keys."""
    if isinstance(value, dict):
        return {str(name): plain_values(item) for name, item in value.items()}
    return [plain_values(item) for item in value] if isinstance(value, (list, tuple)) else value


def _refuse(name: str) -> float:
    raise ValueError(f"holds {name}")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"holds {text}")
    return number


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:  # Python converts no more than some thousand digits
        raise ValueError(f"holds a number of {len(text)} digits") from None


_DECODER = json.JSONDecoder(parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
"""Made once: a dataset of thousands of sequences has millions of lines."""


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST):
        inside = [item.values() if isinstance(item, dict) else item for item in level if isinstance(item, (dict, list))]
        level = [item for items in inside for item in items]
        if not level:
            return
    raise ValueError("is nested too deeply")


def canonical(value: Mapping[str, Any]) -> str:
    """Return JSON text that people can read; equal content gives equal text."""
    return json.dumps(value, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"
