# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading manifest.parquet: the rows of a sequence and the columns that are asked for, by ranges of the file."""

import io
import threading
from typing import Any

from ..core.errors import InputError
from .packed_names import TABLE
from .refusals import missing
from .store import Store

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
