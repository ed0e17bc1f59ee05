# SPDX-License-Identifier: GPL-3.0-or-later
"""The frames that a system was given, which the poses of an estimate belong to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Index: TypeAlias = Mapping[str, Any]
"""The frames as a system is given them: `frames`, a list in their order, each with `stamp_s` and `colour`, its file."""


@dataclass(frozen=True, eq=False)
class Frames:
    """stamps_s: (N,) float64, seconds, increasing. names: the files of their colour images; empty where not known."""

    stamps_s: NDArray[np.float64]
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps_s)

    @classmethod
    def of(cls, stamps_s: ArrayLike, names: Sequence[object] = ()) -> "Frames":
        """Return frames of stamps (N,)."""
        return cls(np.asarray(stamps_s, dtype=np.float64), tuple(map(str, names)))

    @classmethod
    def of_index(cls, index: Index) -> "Frames":
        """Return the frames of an index."""
        frames = index["frames"]
        names = [frame.get("colour") for frame in frames]
        return cls.of([frame["stamp_s"] for frame in frames], names if all(names) else ())
