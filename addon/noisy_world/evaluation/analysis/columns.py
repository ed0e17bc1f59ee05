# SPDX-License-Identifier: GPL-3.0-or-later
"""A table in plain arrays: analyses ask for small groups of rows ten thousand times, which pandas is slow at."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pandas import DataFrame

Key: TypeAlias = tuple[Any, ...]


class Columns:
    """Columns of one length by name: texts as objects, whole numbers, or float64 with NaN where there is no value."""

    def __init__(self, arrays: Mapping[str, NDArray[Any]], rows: int) -> None:
        self._arrays = dict(arrays)
        self._rows = rows

    @classmethod
    def of(cls, table: "DataFrame") -> "Columns":
        """Take a pandas table whose columns are texts without gaps, or numbers."""
        from pandas.api.types import is_numeric_dtype

        arrays = {
            str(name): column.to_numpy() if is_numeric_dtype(column.dtype) else column.to_numpy(dtype=object)
            for name, column in table.items()
        }
        return cls(arrays, len(table))

    def __len__(self) -> int:
        return self._rows

    def __contains__(self, name: object) -> bool:
        return name in self._arrays

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    @property
    def names(self) -> list[str]:
        """The columns' names, in order."""
        return list(self._arrays)

    def rows(self, names: Sequence[str]) -> Iterator[Key]:
        """Yield the values of some columns, row by row, as Python's own types."""
        return zip(*(self._arrays[name].tolist() for name in names), strict=True)

    def where(self, chosen: NDArray[Any]) -> "Columns":
        """Return some rows: by a mask, or by their places."""
        arrays = {name: array[chosen] for name, array in self._arrays.items()}
        return Columns(arrays, int(chosen.sum()) if chosen.dtype == bool else len(chosen))

    def with_column(self, name: str, values: NDArray[Any]) -> "Columns":
        """Return the same with another column."""
        return Columns({**self._arrays, name: values}, self._rows)

    def groups(self, names: Sequence[str]) -> Iterator[tuple[Key, "Columns"]]:
        """Yield the values of some columns in order, those without a value first, with the rows that have them.

        Without names, all rows are one group, if there are any.
        """
        places: dict[Key, list[int]] = {}
        for place, key in enumerate(self.rows(names) if names else ((),) * self._rows):
            places.setdefault(hashable(key), []).append(place)
        for key in sorted(places, key=lambda key: tuple((value is not None, value) for value in key)):
            yield tuple(np.nan if value is None else value for value in key), self.where(np.array(places[key]))


def hashable(key: Iterable[Any]) -> Key:
    """Return a key with None for NaN, which is not equal to itself."""
    return tuple(None if isinstance(value, float) and isnan(value) else value for value in key)


def table_of(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> "DataFrame":
    """Return rows as a pandas table with these columns, which are there even where it is empty."""
    from pandas import DataFrame

    return DataFrame(list(rows), columns=list(columns))
