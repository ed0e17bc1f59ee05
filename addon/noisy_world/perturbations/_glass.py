# SPDX-License-Identifier: GPL-3.0-or-later
"""A pane of glass before the lens, out of focus, on arrays: what is on it is drawn smaller, blurred, and laid over.

The lens sees each pixel's point of the scene, which is in focus, through a disc of the glass. What is on the glass
therefore blurs, its outlines and what they show alike, and what is beside it stays sharp:
image * (1 - blurred cover) + blurred light.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import encoded
from ._bands import bands
from ._kernels import gaussian
from ._patterns import three_channels

Float32: TypeAlias = NDArray[np.float32]

COARSEST = 3.0  # pixels of the frame to one of the glass's image, at most; chosen
PER_BLUR = 0.6  # pixels of the frame to one of the glass's image, for each pixel of the blur's radius
LEAST_BLUR_PX = 1.0  # the radius that smooths outlines on a sharp glass
LEAST_COVER = 1e-4  # of a pixel: less is not seen
SIGMA = 0.5  # of a disc's radius: its standard deviation along a line


@dataclass(frozen=True)
class Pane:
    """The glass's image. x_px (w,), y_px (h,): where its pixels are in the frame, from the upper left corner.

    size_px: width and height of the frame. coarse: pixels of the frame to one of its own.
    """

    size_px: tuple[int, int]
    x_px: Float32
    y_px: Float32
    coarse: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.y_px), len(self.x_px)

    def rows(self, first: int, end: int) -> "Pane":
        """Return some of its rows."""
        return replace(self, y_px=self.y_px[first:end])


def pane(shape: tuple[int, int], focus_px: float) -> Pane:
    """Return the glass's image before a frame of (H, W), for the radius of its blur."""
    coarse = coarseness(focus_px)
    width, height = (max(1, int(side / coarse + 0.5)) for side in (shape[1], shape[0]))
    x = (np.arange(width, dtype=np.float32) + np.float32(0.5)) * np.float32(shape[1] / width)
    y = (np.arange(height, dtype=np.float32) + np.float32(0.5)) * np.float32(shape[0] / height)
    return Pane((shape[1], shape[0]), x, y, coarse)


def coarseness(focus_px: float) -> float:
    """Return how many pixels of the frame one of the glass's image stands for: what is blurred needs few."""
    return min(max(focus_px * PER_BLUR, 1.0), COARSEST)


def reduced(linear: Float32, times: int) -> Float32:
    """Return (H, W, 3) halved so many times, each pixel the mean of four."""
    import cv2

    for _ in range(times):
        size = tuple(max(1, int(side / 2 + 0.5)) for side in linear.shape[1::-1])
        linear = np.asarray(cv2.resize(linear, size, interpolation=cv2.INTER_LINEAR), np.float32)
    return linear


def shown_at(small: Float32, x_px: Float32, y_px: Float32, size_px: tuple[int, int]) -> Float32:
    """Return (N, 3): the light of a small image of the frame at N places of the frame, mirrored at its borders."""
    import cv2

    count = len(x_px)
    rows = -(-count // 256)
    maps = []
    for places, frame_px, side in zip((x_px, y_px), size_px, small.shape[1::-1], strict=True):
        table = np.zeros(rows * 256, np.float32)
        table[:count] = mirrored(places, frame_px) * np.float32(side / frame_px) - np.float32(0.5)
        maps.append(table.reshape(rows, 256))
    found = cv2.remap(small, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(-1, 3)[:count]


def mirrored(place: Float32, length: float) -> Float32:
    """Fold positions back at both ends of [0, length]."""
    return np.float32(length) - np.abs(place % np.float32(2 * length) - np.float32(length))


def blurred(layer: Float32, glass: Pane, focus_px: float) -> Float32:
    """Blur what is on the glass, (h, w, 4): light times cover, and cover."""
    return gaussian(layer, max(focus_px, LEAST_BLUR_PX) * SIGMA / glass.coarse)


def laid_over(rgb: Float32, linear: Float32, layer: Float32) -> Float32:
    """Lay the glass's image, (h, w, 4), over a frame (H, W, 3), given encoded and as linear light; return it encoded.

    Where nothing is on the glass the frame stays as it is.
    """
    import cv2

    large = np.asarray(cv2.resize(layer, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    result = rgb.copy()
    for band, band_linear, band_layer in zip(bands(result), bands(linear), bands(large), strict=True):
        cover = np.ascontiguousarray(band_layer[..., 3])
        there = (cover > LEAST_COVER).astype(np.uint8)
        if there.any():
            light = np.asarray(cv2.cvtColor(band_layer, cv2.COLOR_BGRA2BGR), np.float32).reshape(band.shape)
            light += band_linear
            seen = three_channels(cover).reshape(band.shape)
            seen *= band_linear
            light -= seen
            cv2.copyTo(encoded(light), there, band)
    return result
