# SPDX-License-Identifier: GPL-3.0-or-later
"""Sparse blocks of voxels, and where each block lies in memory."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

BLOCK = 8  # voxels along a block's edge; chosen
VOXELS = BLOCK**3

_BITS = 21  # of a coordinate in a key: a million blocks in each direction from the origin
_HALF = 1 << (_BITS - 1)
_MASK = (1 << _BITS) - 1

Keys: TypeAlias = NDArray[np.int64]
"""Three whole coordinates as one number, in their order."""


def keys_of(places: NDArray[np.integer]) -> Keys:
    """(N, 3) whole coordinates -> (N,) keys. Raises ValueError beyond a million in any direction."""
    places = np.asarray(places, dtype=np.int64)
    if places.size and (places.min() < -_HALF or places.max() >= _HALF):
        raise ValueError("places are within a million of the origin")
    x, y, z = (places + _HALF).T
    return (x << (2 * _BITS)) | (y << _BITS) | z


def places_of(keys: Keys) -> NDArray[np.int64]:
    """(N,) keys -> (N, 3) whole coordinates."""
    return np.stack([keys >> (2 * _BITS), (keys >> _BITS) & _MASK, keys & _MASK], axis=1) - _HALF


def unique_keys(places: NDArray[np.integer]) -> Keys:
    """Return the keys of places (N, 3), sorted, each once."""
    return np.unique(keys_of(places))


def find(keys: Keys, wanted: Keys) -> NDArray[np.intp]:
    """Return where in sorted keys each wanted one stands; -1 where it is not there."""
    if not len(keys):
        return np.full(wanted.shape, -1, dtype=np.intp)
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)


class Blocks:
    """Blocks of voxels by their keys, with values in planes: voxels (planes, slots, VOXELS) float32, first all zero."""

    def __init__(self, planes: int) -> None:
        """Begin without a block."""
        self._keys: Keys = np.empty(0, dtype=np.int64)
        self._slots = np.empty(0, dtype=np.intp)
        self.voxels = np.zeros((planes, 0, VOXELS), dtype=np.float32)

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def keys(self) -> Keys:
        """All keys, sorted."""
        return self._keys

    def slots(self, keys: Keys) -> NDArray[np.intp]:
        """Return the slots of blocks; -1 where there is none."""
        at = find(self._keys, keys)
        return np.where(at >= 0, self._slots[at], -1) if len(self) else at

    def missing(self, keys: Keys) -> Keys:
        """Return those of sorted keys that have no block."""
        return keys[find(self._keys, keys) < 0]

    def add(self, new: Keys) -> None:
        """Add blocks, sorted and none of them there."""
        count = len(self)
        planes, slots = self.voxels.shape[:2]
        if count + len(new) > slots:  # by a half more: few copies, and little that stays empty
            room = np.zeros((planes, max(count + len(new), count * 3 // 2), VOXELS), dtype=np.float32)
            room[:, :count] = self.voxels[:, :count]
            self.voxels = room
        at = np.searchsorted(self._keys, new)
        self._slots = np.insert(self._slots, at, np.arange(count, count + len(new)))
        self._keys = np.insert(self._keys, at, new)
