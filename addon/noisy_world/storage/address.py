# SPDX-License-Identifier: GPL-3.0-or-later
"""An address: a place for a dataset that fsspec reaches, such as s3://bucket/name.

What is written there is whole or absent. Files that a killed process did not finish leave nothing under their names in
an object store; elsewhere they may, so nothing counts here before a small file beside it says that it is finished.
"""

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from ..core.errors import StorageError
from .refusals import missing, store_errors, told

BLOCK_BYTES = 16 * 2**20  # of an upload's parts, 10,000 of which an object may have; chosen: 160 GB


def is_address(text: str) -> bool:
    """Tell whether a place that a user gave is an address, rather than a folder."""
    return "://" in text


def address_of(folder: Path) -> str:
    """Return a folder as an address."""
    return f"file://{folder.resolve()}"


@dataclass(frozen=True)
class Address:
    """A place in a store. text: as given, without a slash at its end. fs: fsspec's file system. root: its path."""

    text: str
    fs: Any
    root: str

    @property
    def name(self) -> str:
        """The last part of the address."""
        return self.text.rsplit("/", 1)[-1]

    def of(self, name: str) -> str:
        """Return the address of a file, for messages."""
        return f"{self.text}/{name}"

    def path(self, name: str) -> str:
        """Return the path of a file in its file system."""
        return f"{self.root}/{name}"

    def check(self) -> None:
        """Raise StorageError where the store cannot be asked what it holds: no bucket, no credentials, no answer."""
        self.sizes(".noisy_world")

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None where there is none."""
        with told(self.of(name), "read"):
            try:
                return self.fs.cat_file(self.path(name))
            except FileNotFoundError:
                return None

    def read_range(self, name: str, start: int, stop: int) -> bytes:
        """Return the bytes from `start` to `stop` of a file."""
        with told(self.of(name), "read"):
            return self.fs.cat_file(self.path(name), start=start, end=stop)

    def write(self, name: str, data: bytes) -> None:
        """Write a small file."""
        with told(self.of(name), "written"):
            self.fs.pipe_file(self.path(name), data)

    def times_s(self, folder: str) -> dict[str, float]:
        """Return when the files in a folder and below were written, since the epoch, by name from the address on.

        Only those of which the store tells it.
        """
        with told(self.of(folder), "read"):
            found = self.fs.find(self.path(folder), detail=True)
        times = {path[len(self.root) + 1 :]: _time_s(entry) for path, entry in sorted(found.items())}
        return {name: time_s for name, time_s in times.items() if time_s is not None}

    def sizes(self, folder: str) -> dict[str, int]:
        """Return the sizes in bytes of all files in a folder and below, by name from the address on."""
        with told(self.of(folder), "read"):
            found = self.fs.find(self.path(folder), detail=True)
        start = len(self.root) + 1
        return {path[start:]: int(entry["size"]) for path, entry in sorted(found.items())}

    def holds_anything(self) -> bool:
        """Tell whether there is a file or folder."""
        with told(self.text, "read"):
            try:
                return bool(self.fs.ls(self.root, detail=False))
            except FileNotFoundError:
                return False

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes; None where there is none."""
        with told(self.of(name), "read"):
            try:
                return int(self.fs.info(self.path(name))["size"])
            except FileNotFoundError:
                return None

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        with told(self.of(name), "removed"), contextlib.suppress(FileNotFoundError):
            self.fs.rm_file(self.path(name))

    @contextlib.contextmanager
    def writing(self, name: str) -> Iterator["Upload"]:
        """Open a file for writing in parts; it is there once the block ends without an error."""
        with told(self.of(name), "written"):
            file = self.fs.open(self.path(name), "wb", block_size=BLOCK_BYTES, autocommit=False)
        try:
            yield Upload(file, self.of(name))
            with told(self.of(name), "written"):
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


class Upload:
    """A file of an address while it is written, with its size in bytes and its SHA-256 so far."""

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
        with told(self._place, "written"):
            self._file.write(data)
        self._digest.update(data)
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self.size


def open_address(text: str) -> Address:
    """Return an address by its text.

    Raises MissingDependencyError where a package for its protocol is missing, StorageError where it has no meaning.
    """
    try:
        import fsspec
        from fsspec.registry import known_implementations
    except ImportError as error:
        raise missing(text, "fsspec") from error
    protocol, _, place = text.partition("://")
    if not place.strip("/"):
        raise StorageError(f"{text}: names no place; write it as {protocol or 's3'}://BUCKET/NAME")
    text = text.rstrip("/")
    try:
        options = {"auto_mkdir": True} if protocol in ("file", "local") else {}
        with told(text, "opened"):
            fs, root = fsspec.url_to_fs(text, use_listings_cache=False, skip_instance_cache=True, **options)
    except ImportError as error:
        known = known_implementations[protocol.rsplit(":", 1)[-1]]
        raise missing(text, known["class"].split(".")[0]) from error
    except ValueError as error:
        raise StorageError(f"{text}: {error}; s3://, gs:// and file:// are known, and what fsspec lists") from error
    return Address(text, fs, str(root).rstrip("/"))
