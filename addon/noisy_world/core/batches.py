# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of an iterable, which Python's itertools has from 3.12."""

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import TypeVar

T = TypeVar("T")


def batched(values: Iterable[T], size: int) -> Iterator[tuple[T, ...]]:
    """Yield the values, in their order, `size` at a time; the last time those that are left."""
    left = iter(values)
    while batch := tuple(islice(left, size)):
        yield batch
