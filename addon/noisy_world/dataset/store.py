# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores: places for files by their names, a folder or an address that fsspec reaches, such as s3://bucket/name.

What is written there is whole or absent. Files that a killed process did not finish leave nothing under their names in
a folder and in an object store; elsewhere they may, so nothing counts there before a small file beside it says that it
is finished.
"""

import contextlib
import hashlib
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import IO, Any, TypeAlias

from ..core.atomic_files import FULL, FolderLock, unfinished_name
from ..core.errors import MissingDependencyError, StorageError
from ..core.file_access import open_regular, with_home
from ..core.packages import install_command, pip_command
from .folder_state import WORK_FOLDER

# Turns a store's exceptions into one line with the address and the remedy.


IN_EXTRA = ("fsspec", "s3fs", "pyarrow")
GOES_ON = "the same command goes on from here"

# The errors of the libraries that fsspec's file systems are made of, by the module that has them. They are looked up
# where the module is loaded: a library that nobody loaded raises nothing.
_LIBRARIES = {
    "botocore.exceptions": ("BotoCoreError", "ClientError"),
    "aiohttp": ("ClientError",),
    "google.auth.exceptions": ("GoogleAuthError",),
    "gcsfs.retry": ("HttpError",),
    "azure.core.exceptions": ("AzureError",),
}


def store_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions by which a store says no, of the libraries that are loaded."""
    found: list[type[Exception]] = [OSError, NotImplementedError]  # the second: fsspec's stores that are only read
    for module, names in _LIBRARIES.items():
        if module in sys.modules:
            found += [getattr(sys.modules[module], name) for name in names]
    return tuple(found)


@contextlib.contextmanager
def refusals_as_errors(address: str, doing: str) -> Iterator[None]:
    """Turn a store's refusal into one line. doing: "read" or "written"."""
    try:
        yield
    except store_errors() as error:  # an expression: it is evaluated once something is raised, with what is loaded then
        raise refusal(address, doing, error) from error


def refusal(address: str, doing: str, error: BaseException) -> StorageError:
    """Return the error that says what a store refused, and what to do."""
    problem, remedy = _meaning(error)
    return StorageError(f"cannot be {doing}: {problem}", file=address, remedy=remedy)


def _meaning(error: BaseException) -> tuple[str, str]:
    """Return what a store's exception means, and what to do."""
    kinds = {kind.__name__ for kind in type(error).__mro__}
    text = " ".join(str(error).split())
    code = getattr(error, "response", {}).get("Error", {}).get("Code", "") if hasattr(error, "response") else ""
    if kinds & {"NoCredentialsError", "PartialCredentialsError", "ProfileNotFound", "GoogleAuthError"}:
        return f"there are no credentials ({text})", (
            "set them in the environment or the store's own configuration, such as AWS_ACCESS_KEY_ID and "
            "AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
        )
    if isinstance(error, PermissionError) or code in ("AccessDenied", "403"):
        return (
            f"access is refused ({text})",
            "the credentials have to allow listing, reading, writing and deleting there",
        )
    if isinstance(error, FileNotFoundError):
        return f"it is not there ({text})", "make the bucket or folder first, or mend the name"
    if kinds & {
        "EndpointConnectionError",
        "HTTPClientError",
        "ClientConnectionError",
        "ConnectionError",
        "TimeoutError",
    }:
        return f"the store does not answer ({text})", f"see to the network and the endpoint; {GOES_ON}"
    if isinstance(error, NotImplementedError):
        return "its kind of store takes no files", "choose another address with --out"
    if isinstance(error, OSError) and error.errno in FULL:
        return "no space is left there", f"make room; {GOES_ON}"
    return text or type(error).__name__, f"mend that; {GOES_ON}"


def missing(address: str, package: str) -> MissingDependencyError:
    """Return the error that says which package reads and writes an address, and the command that installs it."""
    command = install_command("cloud") if package in IN_EXTRA else pip_command([package])
    packed = "a packed dataset, in a folder too, " if address.startswith("file://") or "://" not in address else ""
    problem = f"{packed}needs {package}, which is not installed; run: {command}"
    return MissingDependencyError(problem, file=address.removeprefix("file://"))


LOCK = f"{WORK_FOLDER}/lock"
READ_BYTES = 8 * 2**20  # fetched at once where a whole file is read; chosen: some frames

Entries: TypeAlias = dict[str, tuple[int, float | None]]
"""The size in bytes of files, and when each was written, since the epoch, where the store tells it, by name."""


class Store(ABC):
    """A place for a dataset; files in it have names with forward slashes. text: the place as it was given."""

    def __init__(self, text: str) -> None:
        self.text = text

    @property
    def name(self) -> str:
        """The last part of the place."""
        return self.text.rsplit("/", 1)[-1]

    def of(self, name: str) -> str:
        """Return the place of a file, for messages."""
        return f"{self.text}/{name}"

    # --- what a kind of store does; each raises what it raises ---

    @abstractmethod
    def _content(self, name: str, start: int | None, stop: int | None) -> bytes: ...

    @abstractmethod
    def _entries(self, folder: str) -> Entries: ...

    @abstractmethod
    def _size(self, name: str) -> int: ...

    @abstractmethod
    def _holds_anything(self) -> bool: ...

    @abstractmethod
    def _remove(self, name: str) -> None: ...

    @abstractmethod
    def _opened(self, name: str) -> contextlib.AbstractContextManager[IO[bytes]]: ...

    # --- what all do; StorageError says where one refuses ---

    def check(self) -> None:
        """Raise StorageError where the store cannot be asked what it holds: no bucket, no credentials, no answer."""
        self.sizes(WORK_FOLDER)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None where there is none."""
        with refusals_as_errors(self.of(name), "read"):
            try:
                return self._content(name, None, None)
            except FileNotFoundError:
                return None

    def read_range(self, name: str, start: int, stop: int) -> bytes:
        """Return the bytes from `start` to `stop` of a file."""
        with refusals_as_errors(self.of(name), "read"):
            return self._content(name, start, stop)

    def pieces(self, name: str, size: int) -> Iterator[bytes]:
        """Yield the content of a file of this size in pieces; fewer bytes where it is shorter."""
        for start in range(0, size, READ_BYTES):
            piece = self.read_range(name, start, min(size, start + READ_BYTES))
            if not piece:
                return
            yield piece

    def sha256(self, name: str, size: int) -> str:
        """Return the SHA-256 of a file of this size, in hexadecimal."""
        digest = hashlib.sha256()
        for piece in self.pieces(name, size):
            digest.update(piece)
        return digest.hexdigest()

    def times_s(self, folder: str) -> dict[str, float]:
        """Return when the files in a folder and below were written, since the epoch, by name from the store on.

        Only those of which the store tells it.
        """
        with refusals_as_errors(self.of(folder), "read"):
            found = self._entries(folder)
        return {name: time_s for name, (_, time_s) in sorted(found.items()) if time_s is not None}

    def sizes(self, folder: str) -> dict[str, int]:
        """Return the sizes in bytes of all files in a folder and below, by name from the store on."""
        with refusals_as_errors(self.of(folder), "read"):
            return {name: size for name, (size, _) in sorted(self._entries(folder).items())}

    def holds_anything(self) -> bool:
        """Tell whether there is a file."""
        with refusals_as_errors(self.text, "read"):
            try:
                return self._holds_anything()
            except FileNotFoundError:
                return False

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes; None where there is none."""
        with refusals_as_errors(self.of(name), "read"):
            try:
                return self._size(name)
            except FileNotFoundError:
                return None

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        with refusals_as_errors(self.of(name), "removed"), contextlib.suppress(FileNotFoundError):
            self._remove(name)

    def write(self, name: str, data: bytes) -> None:
        """Write a small file."""
        with self.writing(name) as file:
            file.write(data)

    @contextlib.contextmanager
    def writing(self, name: str) -> Iterator["Upload"]:
        """Open a file for writing in parts; it is there once the block ends without an error."""
        opened = self._opened(name)
        with refusals_as_errors(self.of(name), "written"):
            file = opened.__enter__()
        try:
            yield Upload(file, self.of(name))
        except BaseException as error:
            with contextlib.suppress(*store_errors()):  # a full disk takes the end no more than what was refused before
                opened.__exit__(type(error), error, error.__traceback__)
            raise
        with refusals_as_errors(self.of(name), "written"):
            opened.__exit__(None, None, None)

    def locked(self) -> contextlib.AbstractContextManager[None]:
        """Keep others from writing here, if that can be: an object store has no locks, and no folders that go.

        Raises BusyError where another does.
        """
        return contextlib.nullcontext()


class Upload:
    """A file of a store while it is written, with its size in bytes and its SHA-256 so far."""

    def __init__(self, file: IO[bytes], place: str) -> None:
        self._file = file
        self._place = place
        self._digest = hashlib.sha256()
        self.size = 0

    @property
    def sha256(self) -> str:
        """The SHA-256 of what was written, in hexadecimal."""
        return self._digest.hexdigest()

    def write(self, data: bytes) -> int:
        """Write the next bytes."""
        with refusals_as_errors(self._place, "written"):
            self._file.write(data)
        self._digest.update(data)
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self.size


class FolderStore(Store):
    """A folder on a disk. Files are written in its working folder, and renamed when they are whole."""

    def __init__(self, folder: Path, text: str = "") -> None:
        """Take a folder, which need not be there. text: the address by which it was given, if it was."""
        super().__init__(text or str(folder))
        self.folder = folder.absolute()

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name

    def _content(self, name: str, start: int | None, stop: int | None) -> bytes:
        with open_regular(self.folder / name) as file:
            file.seek(start or 0)
            return file.read(-1 if stop is None else max(0, stop - (start or 0)))

    def _entries(self, folder: str) -> Entries:
        found: Entries = {}
        for base, _, names in os.walk(self.folder / folder):
            for path in map(Path(base).joinpath, names):
                if path == self.folder / LOCK:
                    continue  # of a process, and no part of what is stored
                with contextlib.suppress(FileNotFoundError):  # a run that goes on has just removed it
                    entry = path.stat()
                    found[path.relative_to(self.folder).as_posix()] = entry.st_size, entry.st_mtime
        return found

    def _size(self, name: str) -> int:
        return (self.folder / name).stat().st_size

    def _holds_anything(self) -> bool:
        lock = self.folder / LOCK
        return any(Path(base) / name != lock for base, _, names in os.walk(self.folder) for name in names)

    def _remove(self, name: str) -> None:
        path = self.folder / name
        path.unlink()
        for parent in path.relative_to(self.folder).parents:
            with contextlib.suppress(OSError):  # one that is not empty stays
                (self.folder / parent).rmdir() if parent.name else None

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep others from writing here. Raises BusyError where another does, StorageError where nobody can write."""
        lock = FolderLock(self.folder / LOCK)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                (self.folder / LOCK).unlink()
            lock.release()
            for empty in (self.folder / WORK_FOLDER, self.folder):
                with contextlib.suppress(OSError):  # it holds something
                    empty.rmdir()

    @contextlib.contextmanager
    def _opened(self, name: str) -> Iterator[IO[bytes]]:
        path, scratch = self.folder / name, self.folder / WORK_FOLDER
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch.mkdir(parents=True, exist_ok=True)
        unfinished = unfinished_name(scratch, path)
        try:
            with unfinished.open("wb") as file:
                yield file
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # where it is not empty, a dataset is begun
                scratch.rmdir()


# An address: a store that fsspec reaches.


BLOCK_BYTES = 16 * 2**20  # of an upload's parts, 10,000 of which an object may have; chosen: 160 GB


class Address(Store):
    """A place in a store. fs: fsspec's file system."""

    def __init__(self, text: str, fs: Any, root: str) -> None:
        super().__init__(text)
        self.fs = fs
        self._root = root

    @classmethod
    def of_text(cls, text: str) -> "Address":
        """Return an address by its text; see `open_store`."""
        try:
            import fsspec
            from fsspec.registry import known_implementations
        except ImportError as error:
            raise missing(text, "fsspec") from error
        try:
            with refusals_as_errors(text, "opened"):
                fs, root = fsspec.url_to_fs(text, use_listings_cache=False, skip_instance_cache=True)
        except ImportError as error:
            known = known_implementations[text.partition("://")[0].rsplit(":", 1)[-1]]
            raise missing(text, known["class"].split(".")[0]) from error
        except ValueError as error:
            raise StorageError(
                str(error), file=text, remedy="s3://, gs:// and file:// are known, and what fsspec lists"
            ) from error
        return cls(text, fs, str(root).rstrip("/"))

    def path(self, name: str) -> str:
        """Return the path of a file in its file system."""
        return f"{self._root}/{name}"

    def _content(self, name: str, start: int | None, stop: int | None) -> bytes:
        return self.fs.cat_file(self.path(name), start=start, end=stop)

    def _entries(self, folder: str) -> Entries:
        found = self.fs.find(self.path(folder), detail=True)
        begin = len(self._root) + 1
        return {path[begin:]: (int(entry["size"]), _time_s(entry)) for path, entry in found.items()}

    def _size(self, name: str) -> int:
        return int(self.fs.info(self.path(name))["size"])

    def _holds_anything(self) -> bool:
        return bool(self.fs.ls(self._root, detail=False))

    def _remove(self, name: str) -> None:
        self.fs.rm_file(self.path(name))

    def write(self, name: str, data: bytes) -> None:
        """Write a small file."""
        with refusals_as_errors(self.of(name), "written"):
            self.fs.pipe_file(self.path(name), data)

    @contextlib.contextmanager
    def _opened(self, name: str) -> Iterator[IO[bytes]]:
        file = self.fs.open(self.path(name), "wb", block_size=BLOCK_BYTES, autocommit=False)
        try:
            yield file
            file.close()
            file.commit()
        except BaseException:
            with contextlib.suppress(*store_errors()):  # the error that is on its way says more
                _give_up(file)
            raise


def _time_s(entry: dict[str, Any]) -> float | None:
    """Return when a file was written by what a store tells of it, each under a key of its own; None where none does."""
    for key in ("LastModified", "mtime", "updated", "last_modified", "created"):
        value = entry.get(key)
        if isinstance(value, datetime):
            return value.timestamp()
        if isinstance(value, int | float):
            return float(value)
    return None


def _give_up(file: Any) -> None:
    """Leave nothing of a file that is being written."""
    from fsspec.spec import AbstractBufferedFile

    if isinstance(file, AbstractBufferedFile):
        file.closed = True  # or its end would be uploaded first, and again when it is collected
    else:
        file.close()
    file.discard()


# The store at a place that a user gave, whichever kind it is.


def is_address(text: str) -> bool:
    """Tell whether a place that a user gave is an address, rather than a folder."""
    return "://" in text


def open_store(place: Path | str) -> Store:
    """Return the store at a folder or an address, which need not hold anything yet.

    Raises MissingDependencyError where a package for an address's protocol is missing, StorageError where the address
    has no meaning.
    """
    if isinstance(place, Path):
        return FolderStore(place)
    protocol, _, rest = place.partition("://")
    if not rest.strip("/"):
        raise StorageError("names no place", file=place, remedy=f"write it as {protocol or 's3'}://BUCKET/NAME")
    text = place.rstrip("/")
    if protocol in ("file", "local"):
        try:
            return FolderStore(with_home(rest.lstrip("/") if sys.platform == "win32" else rest), text)
        except LookupError as error:
            raise StorageError(str(error), file=text) from error
    return Address.of_text(text)
