# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of a sequence's frames, however many: ranges in place of lists."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import accumulate
from typing import overload


class FrameNumbers(Sequence[int]):
    """The numbers of frames, increasing; what is not there was left out, or was not chosen."""

    def __init__(self, ranges: Iterable[range]) -> None:
        """Take ranges of neighbours, in order, with gaps between them."""
        self.ranges = tuple(ranges)

    @classmethod
    def of(cls, numbers: Iterable[int]) -> "FrameNumbers":
        """Return the numbers as ranges. numbers: increasing."""
        found: list[range] = []
        for number in numbers:
            if found and found[-1].stop == number:
                found[-1] = range(found[-1].start, number + 1)
            else:
                found.append(range(number, number + 1))
        return cls(found)

    def within(self, chosen: slice) -> "FrameNumbers":
        """Return those from `chosen.start` to `chosen.stop` - 1, by the frames' own numbers."""
        low = chosen.start or 0
        cut = (range(max(part.start, low), _least(part.stop, chosen.stop)) for part in self.ranges)
        return FrameNumbers(part for part in cut if part)

    def least_blocks(self, size: int) -> int:
        """Return how many blocks of `size` numbers hold some of these, at least: each neighbour may share one."""
        held = sum((part.stop - 1) // size - part.start // size + 1 for part in self.ranges)
        return held - max(0, len(self.ranges) - 1)

    @cached_property
    def _ends(self) -> list[int]:
        """How many numbers there are up to each range's end."""
        return list(accumulate(len(part) for part in self.ranges))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __iter__(self) -> Iterator[int]:
        for part in self.ranges:
            yield from part

    def __contains__(self, number: object) -> bool:
        return any(number in part for part in self.ranges)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FrameNumbers) and self.ranges == other.ranges

    def __hash__(self) -> int:
        return hash(self.ranges)

    @overload
    def __getitem__(self, place: int) -> int: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[int]: ...

    def __getitem__(self, place: int | slice) -> int | Sequence[int]:
        if isinstance(place, slice):
            return [self[index] for index in range(len(self))[place]]
        index = range(len(self))[place]
        part = bisect_right(self._ends, index)
        before = self._ends[part - 1] if part else 0
        return self.ranges[part][index - before]

    def __str__(self) -> str:
        """Tell the numbers, as in "0 to 3, 7"; of many ranges the first ones."""
        lines = [str(part.start) if len(part) == 1 else f"{part.start} to {part.stop - 1}" for part in self.ranges[:4]]
        more = len(self.ranges) - len(lines)
        return ", ".join(lines) + (f" and {more} more ranges" if more else "")


def _least(stop: int, asked: int | None) -> int:
    return stop if asked is None else min(stop, asked)
