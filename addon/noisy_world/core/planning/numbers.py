# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences of whole numbers, kept as a range where they are one.

A plan has a thousand sequences of up to a million frames, and in most of them each frame shows its own source frame. A
range says that in a few bytes; only what a perturbation chooses or pairs otherwise is kept number by number.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

BLOCK = 65536  # numbers that are made Python's own at once


class ListedNumbers(Sequence[int]):
    """Numbers that no range gives, in 32 bits each."""

    def __init__(self, values: NDArray[np.integer]) -> None:
        """Take (N,) numbers, each of at most 31 bits."""
        self.values = values.astype(np.int32)
        self.values.flags.writeable = False

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[int]:
        for start in range(0, len(self.values), BLOCK):
            yield from self.values[start : start + BLOCK].tolist()

    def __contains__(self, number: object) -> bool:
        return bool((self.values == number).any())

    @overload
    def __getitem__(self, at: int) -> int: ...

    @overload
    def __getitem__(self, at: slice) -> "Numbers": ...

    def __getitem__(self, at: int | slice) -> "int | Numbers":
        return numbers_of(self.values[at]) if isinstance(at, slice) else int(self.values[at])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ListedNumbers) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(self.values.tobytes())

    def __repr__(self) -> str:
        return f"ListedNumbers({np.array2string(self.values, threshold=8, separator=', ')})"


Numbers: TypeAlias = range | ListedNumbers


def numbers_of(values: NDArray[np.integer]) -> Numbers:
    """Return (N,) numbers: as a range where they rise evenly."""
    if len(values) < 2:
        return range(int(values[0]), int(values[0]) + 1) if len(values) else range(0)
    first, step = int(values[0]), int(values[1]) - int(values[0])
    if step > 0 and bool((np.diff(values) == step).all()):
        return range(first, int(values[-1]) + 1, step)
    return ListedNumbers(values)


def array_of(numbers: Sequence[int]) -> NDArray[np.int64]:
    """Return numbers as an array (N,)."""
    if isinstance(numbers, range):
        return np.arange(numbers.start, numbers.stop, numbers.step, dtype=np.int64)
    return np.asarray(numbers.values if isinstance(numbers, ListedNumbers) else numbers, dtype=np.int64)


def taken(numbers: Numbers, places: Numbers) -> Numbers:
    """Return the numbers at some places, which are counted from 0; the same object where all stay."""
    if places == range(len(numbers)):
        return numbers
    if isinstance(numbers, range) and numbers[:1] == range(1) and numbers.step == 1:
        return places
    if isinstance(places, range):
        return numbers[places.start : places.stop : places.step]
    return numbers_of(array_of(numbers)[places.values])


def union(several: Sequence[Numbers]) -> Numbers:
    """Return the numbers that are in any of several, increasing; none of them is negative."""
    distinct = list(dict.fromkeys(several))
    if len(distinct) == 1 and isinstance(distinct[0], range):
        return distinct[0]
    there = np.zeros(max((_largest(numbers) for numbers in distinct), default=-1) + 1, dtype=bool)
    for numbers in distinct:
        if isinstance(numbers, range):
            there[numbers.start : numbers.stop : numbers.step] = True
        else:
            there[numbers.values] = True
    return numbers_of(np.flatnonzero(there))


def _largest(numbers: Numbers) -> int:
    if not numbers:
        return -1
    return numbers[-1] if isinstance(numbers, range) else int(numbers.values.max())
