# SPDX-License-Identifier: GPL-3.0-or-later
"""Counter-based random streams: a frame draws the same numbers in any order and on any worker.

The generator is numpy's Philox4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011). Its key
is the first 128 bits of SHA-256 over the identifiers as canonical JSON. Its counter starts at [0, 0, 0, frame], lowest
word first. The frame is the highest word; as the lowest, frame k + 1 would repeat frame k, shifted by a few values.
"""

import hashlib
import json

import numpy as np


def stream(*identifiers: str | int, frame: int = 0) -> np.random.Generator:
    """Return the generator of these identifiers and this frame, at its start.

    identifiers: what the numbers are for, such as the preset's seed, scene, setting, perturbation and its occurrence.
    Order and type count: ("ab", "c"), ("a", "bc"), 1 and "1" are all different.
    frame: 0 to 2^64 - 1. Raises ValueError without identifiers or for another frame, TypeError for other types.
    """
    # numpy counts up with carry from word to word: a frame can draw 2^192 blocks before it meets the next frame's.
    counter = np.array([0, 0, 0, _checked_frame(frame)], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=_key(identifiers), counter=counter))


def _checked_frame(frame: int) -> int:
    if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)):
        raise TypeError(f"a frame is a whole number, not {frame!r}")
    if not 0 <= frame < 2**64:
        raise ValueError(f"a frame is a number from 0 to 2^64 - 1, not {frame}")
    return int(frame)


def _key(identifiers: tuple[str | int, ...]) -> np.ndarray:
    if not identifiers:
        raise ValueError("a random stream needs at least one identifier")
    for identifier in identifiers:
        if type(identifier) not in (str, int):
            raise TypeError(f"a stream is identified by text and whole numbers, not {identifier!r}")
    # A JSON array in ASCII without blanks: one spelling for each sequence of identifiers.
    canonical = json.dumps(identifiers, ensure_ascii=True, separators=(",", ":")).encode("ascii")
    return np.frombuffer(hashlib.sha256(canonical).digest()[:16], dtype="<u8").astype(np.uint64)
