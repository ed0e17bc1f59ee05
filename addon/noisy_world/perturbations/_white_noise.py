# SPDX-License-Identifier: GPL-3.0-or-later
"""The random numbers that a group's White Noise nodes give, on arrays: both executions of a perturbation draw the same.

A number is Bob Jenkins' hash of four words (lookup3, 2006, in the public domain), which are the bits of four float32:
x, y, the seed, and the frame's key with the purpose. In which order the node takes them was found from its output.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.group_inputs import seed_of
from ..core.node_graphs.groups import PURPOSES
from ..core.node_graphs.jenkins_hash import Words, hash_of_four
from ..core.perturbing.kinds import FrameContext

Float32: TypeAlias = NDArray[np.float32]

_ORDERS = ((0, 2, 3), (1, 0, 2), (2, 3, 1), (3, 1, 0))


@dataclass(frozen=True)
class WhiteNoise:
    """Uniform numbers by position, as `Canvas.random` gives them. key: the frame's, 0 for a pattern that is kept."""

    seed: int
    key: int

    def random(self, purpose: int, x: Float32, y: Float32) -> tuple[Float32, Float32, Float32]:
        """Return three independent numbers in [0, 1] for each position of whole numbers, arrays of one shape."""
        words = [_bits(np.broadcast_to(np.float32(item), x.shape)) for item in (x, y, self.seed, self._key(purpose))]
        # The three numbers are those of three orders of the words; they are calculated at once.
        first, second, third = _uniform(*(np.stack([words[k] for k in order]) for order in _ORDERS))
        return first, second, third

    def _key(self, purpose: int) -> int:
        return self.key * PURPOSES + purpose

    def numbers(self, purpose: int) -> tuple[float, float, float]:
        """Return three independent numbers in [0, 1] of the whole frame."""
        zero = np.zeros(1, np.float32)
        first, second, third = self.random(purpose, zero, zero)
        return float(first[0]), float(second[0]), float(third[0])


def white_noise(context: FrameContext) -> WhiteNoise:
    """Return the numbers of a frame, which are those of its node group."""
    return WhiteNoise(seed_of(context.identifiers), context.index if context.temporal == "fresh" else 0)


def _bits(value: Float32) -> Words:
    return np.ascontiguousarray(value, np.float32).view(np.uint32)


def _uniform(x: Words, y: Words, z: Words, w: Words) -> Float32:
    return (hash_of_four(x, y, z, w).astype(np.float64) / 0xFFFFFFFF).astype(np.float32)
