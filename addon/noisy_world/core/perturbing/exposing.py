# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation of exposure is given, and what it returns."""

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray


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


ExposureApply: TypeAlias = Callable[
    [Callable[[float], TakenImages], Any], tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]
]
"""A function that takes the clean images some seconds after the frame's time stamp; parameters -> its own colour and
depth, of the same shapes, as float32, None for an image that is not asked for.

What it takes is an instant or, where another exposure acts before it, that exposure around the moment.
"""
