# SPDX-License-Identifier: GPL-3.0-or-later
"""Counter-based random streams: a frame draws the same numbers in any order and on any worker.

The generator is numpy's Philox4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011). Its key
is the first 128 bits of SHA-256 over the identifiers as canonical JSON. Its counter starts at [0, 0, 0, frame], lowest
word first. The frame is the highest word; as the lowest, frame k + 1 would repeat frame k, shifted by a few values.
"""

import hashlib
import json
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

# Of Philox4x64-10: what the counter's first and third word are multiplied by in each round, and what is added to the
# key's two words between rounds (Salmon et al. 2011, table 2 and section 4.3).
MULTIPLIERS = np.array([[0xD2E7470EE14C6C93], [0xCA5A826395121157]], dtype=np.uint64)
WEYL = np.array([[0x9E3779B97F4A7C15], [0xBB67AE8584CAA73B]], dtype=np.uint64)
ROUNDS = 10
LOW_BITS = np.uint64(0xFFFFFFFF)

Identifiers: TypeAlias = tuple[str | int, ...]
"""Identifiers of random streams: the preset's seed, scene, setting; then the perturbation and its occurrence."""


def stream(*identifiers: str | int, frame: int = 0) -> np.random.Generator:
    """Return the generator of these identifiers and this frame, at its start.

    identifiers: what the numbers are for, such as the preset's seed, scene, setting, perturbation and its occurrence.
    Order and type count: ("ab", "c"), ("a", "bc"), 1 and "1" are all different.
    frame: 0 to 2^64 - 1. Raises ValueError without identifiers or for another frame, TypeError for other types.
    """
    # numpy counts up with carry from word to word: a frame can draw 2^192 blocks before it meets the next frame's.
    counter = np.array([0, 0, 0, _checked_frame(frame)], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=_key(identifiers), counter=counter))


def integers_of_frames(*identifiers: str | int, count: int, low: int, high: int) -> NDArray[np.int64]:
    """Return (count,): the first `stream(*identifiers, frame=k).integers(low, high)` of each frame k, all at once.

    high: not among them, and less than 2^32 above low. A hundred times as fast as a generator for each frame.
    """
    # numpy takes the first word's lower half x and returns x * n >> 32 for n choices, but draws again where the lower
    # half of x * n is so small that some choices would come more often (Lemire 2019); these few are left to numpy.
    choices = np.uint64(high - low)
    products = (_first_words(_key(identifiers), count) & LOW_BITS) * choices
    drawn = low + (products >> np.uint64(32)).astype(np.int64)
    for frame in np.flatnonzero((products & LOW_BITS) < choices):
        drawn[frame] = stream(*identifiers, frame=int(frame)).integers(low, high)
    return drawn


def _first_words(key: NDArray[np.uint64], count: int) -> NDArray[np.uint64]:
    """Return (count,): the first word that each frame's generator gives. numpy counts before it draws: block 1."""
    even = np.zeros((2, count), dtype=np.uint64)  # the counter's words 0 and 2
    odd = np.zeros((2, count), dtype=np.uint64)  # 1 and 3
    even[0], odd[1] = 1, np.arange(count, dtype=np.uint64)
    keys = key[:, None].copy()
    for _ in range(ROUNDS):
        high, low = _products(even)
        even, odd = high[::-1] ^ odd ^ keys, low[::-1]
        keys += WEYL
    return even[0]


def _products(words: NDArray[np.uint64]) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return the upper and the lower 64 bits of the words (2, N) times MULTIPLIERS."""
    half = np.uint64(32)
    lower, upper = words & LOW_BITS, words >> half
    by_lower, by_upper = MULTIPLIERS & LOW_BITS, MULTIPLIERS >> half
    first, second = by_lower * upper, by_upper * lower
    carried = (by_lower * lower >> half) + (first & LOW_BITS) + (second & LOW_BITS)
    high = by_upper * upper + (first >> half) + (second >> half) + (carried >> half)
    return high, words * MULTIPLIERS


def _checked_frame(frame: int) -> int:
    if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)):
        raise TypeError(f"a frame is a whole number, not {frame!r}")
    if not 0 <= frame < 2**64:
        raise ValueError(f"a frame is a number from 0 to 2^64 - 1, not {frame}")
    return int(frame)


def _key(identifiers: Identifiers) -> np.ndarray:
    if not identifiers:
        raise ValueError("a random stream needs at least one identifier")
    for identifier in identifiers:
        if type(identifier) not in (str, int):
            raise TypeError(f"a stream is identified by text and whole numbers, not {identifier!r}")
    # A JSON array in ASCII without blanks: one spelling for each sequence of identifiers.
    canonical = json.dumps(identifiers, ensure_ascii=True, separators=(",", ":")).encode("ascii")
    return np.frombuffer(hashlib.sha256(canonical).digest()[:16], dtype="<u8").astype(np.uint64)
