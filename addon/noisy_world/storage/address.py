# SPDX-License-Identifier: GPL-3.0-or-later
"""An address: a store that fsspec reaches."""

import contextlib
from collections.abc import Iterator
from datetime import datetime
from typing import IO, Any

from ..core.errors import StorageError
from .refusals import missing, refusals_as_errors, store_errors
from .store import Entries, Store

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
