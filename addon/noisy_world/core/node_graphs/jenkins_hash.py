# SPDX-License-Identifier: GPL-3.0-or-later
"""Bob Jenkins' hash of a few words (lookup3, 2006, in the public domain), which Blender's White Noise takes."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Words: TypeAlias = NDArray[np.uint32]

_THREE_WORDS, _FOUR_WORDS = (np.uint32(0xDEADBEEF + (count << 2) + 13) for count in (3, 4))


def hash_of_three(x: Words, y: Words, z: Words) -> Words:
    """Return the hash of three words, arrays of one shape."""
    return _final(x + _THREE_WORDS, y + _THREE_WORDS, z + _THREE_WORDS)


def hash_of_four(x: Words, y: Words, z: Words, w: Words) -> Words:
    """Return the hash of four words, arrays of one shape."""
    a, b, c = x + _FOUR_WORDS, y + _FOUR_WORDS, z + _FOUR_WORDS
    a, c = (a - c) ^ _turned(c, 4), c + b
    b, a = (b - a) ^ _turned(a, 6), a + c
    c, b = (c - b) ^ _turned(b, 8), b + a
    a, c = (a - c) ^ _turned(c, 16), c + b
    b, a = (b - a) ^ _turned(a, 19), a + c
    c, b = (c - b) ^ _turned(b, 4), b + a
    return _final(a + w, b, c)


def _final(a: Words, b: Words, c: Words) -> Words:
    c = (c ^ b) - _turned(b, 14)
    a = (a ^ c) - _turned(c, 11)
    b = (b ^ a) - _turned(a, 25)
    c = (c ^ b) - _turned(b, 16)
    a = (a ^ c) - _turned(c, 4)
    b = (b ^ a) - _turned(a, 14)
    return (c ^ b) - _turned(b, 24)


def _turned(word: Words, bits: int) -> Words:
    """Turn 32 bits to the left."""
    return (word << np.uint32(bits)) | (word >> np.uint32(32 - bits))
