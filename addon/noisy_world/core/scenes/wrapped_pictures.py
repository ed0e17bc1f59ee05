# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a texture's wrapping and colour factor into its image, as our renderers only repeat images.

A picture gets a margin of what lies beyond its edges, as far as the faces reach, and texture coordinates follow.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .imported import Wrap
from .srgb import decoded, encoded

LARGEST_PX = 32768  # a side, as of the files of textures
_MODES: dict[Wrap, Literal["edge", "symmetric", "constant"]] = {
    "clamp": "edge",
    "mirror": "symmetric",
    "black": "constant",
}  # numpy's words


@dataclass(frozen=True)
class Reach:
    """How far coordinates go along a picture's side, which is 1 long."""

    low: float
    high: float


def wrapped(
    picture: NDArray[np.uint8], wraps: tuple[Wrap, Wrap], across: Reach, up: Reach
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Return a picture that shows, repeated, what another shows with other wraps, as far as coordinates reach.

    picture: (H, W, 3), the top row first. Returns the picture, and (2,) scale and (2,) offset of its coordinates.
    Raises ValueError where it becomes too large.
    """
    sizes = (picture.shape[1], picture.shape[0])
    margins = [_margin(*side) for side in zip(sizes, wraps, (across, up), strict=True)]
    grown = [size + sum(margin) for size, margin in zip(sizes, margins, strict=True)]
    if max(grown) > LARGEST_PX:
        raise ValueError(f"reaches {max(grown)} texels with what lies beyond its edges, more than {LARGEST_PX}")
    (left, right), (below, above) = margins
    if left or right:
        picture = np.pad(picture, ((0, 0), (left, right), (0, 0)), mode=_MODES[wraps[0]])
    if below or above:  # rows are stored from the top
        picture = np.pad(picture, ((above, below), (0, 0), (0, 0)), mode=_MODES[wraps[1]])
    scale = np.array(sizes) / np.array(grown)
    offset = np.array([left, below]) / np.array(grown)
    return picture, scale, offset


def _margin(size: int, wrap: Wrap, reach: Reach) -> tuple[int, int]:
    """Return how many texels are needed before and after a side's own. Between texels' centres two are looked up."""
    if wrap == "repeat":
        return 0, 0
    if wrap == "mirror":
        return (0, size) if reach.low < 0.5 / size or reach.high > 1 - 0.5 / size else (0, 0)
    before, after = 0.5 - reach.low * size, reach.high * size + 0.5 - size
    return max(0, int(np.ceil(before))), max(0, int(np.ceil(after)))


def tinted(picture: NDArray[np.uint8], factor: tuple[float, float, float], *, linear: bool) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) multiplied by a factor, which acts on light.

    linear: whether the picture's own values are linear light; the one returned is display-encoded.
    """
    if factor == (1.0, 1.0, 1.0) and not linear:
        return picture
    values = np.arange(256) / 255
    light = values if linear else decoded(values)
    tables = [np.rint(255 * encoded(np.clip(light * each, 0, 1))).astype(np.uint8) for each in factor]
    return np.stack([table[picture[..., channel]] for channel, table in enumerate(tables)], axis=-1)
