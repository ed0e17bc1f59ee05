# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation of exposure is given, and what it returns."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Channels: TypeAlias = frozenset[str] | None
"""The channels of which images are looked at; None for all that there are."""


class TakenImages(Protocol):
    """The clean images of a frame; one that was not asked for is None."""

    @property
    def rgb(self) -> NDArray[Any] | None:
        """Colour (H, W, 3), float32 in [0, 1] or uint8; RGB, sRGB-encoded."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres; 0 = void."""
        ...


def _still(_times_s: NDArray[np.float64]) -> float:
    return 0.0


@dataclass(frozen=True)
class SceneAround:
    """The scene around a frame's time stamp; calling it takes the clean images some seconds after that.

    take: does so; channels says which images are looked at, others may be None. travel_px: times (N,), seconds after
    the stamp, increasing -> how far what any pixel sees goes on the image, from one to the next, at most; pixels.
    """

    take: Callable[[float, Channels], TakenImages]
    travel_px: Callable[[NDArray[np.float64]], float] = field(default=_still)

    def __call__(self, seconds: float, channels: Channels = None) -> TakenImages:
        """Return the images: of an instant or, where another exposure acts before, of that around the moment."""
        return self.take(seconds, channels)


ExposureApply: TypeAlias = Callable[[SceneAround, Any], tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]]
"""A function that takes the clean images some seconds after the frame's time stamp; parameters -> its own colour and
depth, of the same shapes, as float32, None for an image that is not asked for.

What it takes is an instant or, where another exposure acts before it, that exposure around the moment.
"""
