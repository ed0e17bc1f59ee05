# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels that lead from a frame to the next one of its sequence."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from .channel import Channel


@dataclass(frozen=True, eq=False)
class View:
    """What the colour camera sees of a clean frame.

    depth_m: (H, W) float32, planar depth of the pixels' centres in metres, 0 = void. c2w: (4, 4) float64,
    camera-to-world, OpenCV axes, metres. to_other_px: (H, W, 2) float32, how far what each pixel sees is from it in the
    pair's other view, x and y; None where nothing moves but the camera, so that depth and poses tell it.
    """

    depth_m: NDArray[np.float32]
    c2w: NDArray[np.float64]
    camera: Intrinsics
    to_other_px: NDArray[np.float32] | None = None


class PairChannel(Channel):
    """A channel that is computed from what the colour camera sees at a frame and at the sequence's next one.

    Both are clean: what perturbs depth does not change it, and what moves the camera does. The last frame of a sequence
    has no next one: of it nothing is known.
    """

    pairs = True
    kinds = ("exr", "npy")

    @abstractmethod
    def of_views(self, here: View, there: View) -> NDArray[Any]:
        """Return its image, of `dtype` and `components`."""

    @abstractmethod
    def of_last(self, camera: Intrinsics) -> NDArray[Any]:
        """Return its image where nothing comes after."""
