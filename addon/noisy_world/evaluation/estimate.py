# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera path as a SLAM system estimates it: frames may be missing, all of them too."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Estimate:
    """Estimated poses of the frames that a system tracked; the arrays are copied and read-only.

    stamps_s: (M,) float64, seconds, strictly increasing, M >= 0: those of the tracked colour frames.
    c2w: (M, 4, 4) float64, finite, camera-to-world with OpenCV's camera axes (x right, y down, z forward). World frame,
    and without depth the scale, are the system's own.
    Raises ValueError for other shapes, values that are not finite and stamps that do not increase.
    """

    stamps_s: NDArray[np.float64]
    c2w: NDArray[np.float64]

    def __post_init__(self) -> None:
        stamps_s = np.array(self.stamps_s, dtype=np.float64)
        c2w = np.array(self.c2w, dtype=np.float64, order="C")
        if stamps_s.ndim != 1 or c2w.shape != (len(stamps_s), 4, 4):
            raise ValueError(f"an estimate is (M,) stamps and (M, 4, 4) poses, not {stamps_s.shape} and {c2w.shape}")
        if not (np.isfinite(stamps_s).all() and np.isfinite(c2w).all()):
            raise ValueError("an estimate holds finite numbers only")
        if np.any(np.diff(stamps_s) <= 0.0):
            raise ValueError("time stamps must increase from pose to pose")
        for name, array in (("stamps_s", stamps_s), ("c2w", c2w)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.stamps_s)
