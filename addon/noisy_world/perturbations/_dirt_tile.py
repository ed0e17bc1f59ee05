# SPDX-License-Identifier: GPL-3.0-or-later
"""A pane's dirt, drawn once: a picture that repeats, with specks of dust, smears of grease and scratches.

All are as a lens shows them that does not focus on its glass: specks are discs, as in Willson, Maimone, Johnson and
Scherr, "An optical model for image artifacts produced by dust particles on lenses", 2005.
"""

import math
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import BroughtImage
from ..core.streams import stream

Float32: TypeAlias = NDArray[np.float32]

SIZE = (768, 512)  # width and height in texels
TEXEL_PX = 2.0  # pixels of the reference width that a texel spans
DUST_BLUR_PX = 9.0  # standard deviation, as wide as a speck's median radius; chosen
SPECKS = 420
SPECK_RADIUS = (4.6, 0.28)  # median in texels, deviation of the logarithm
WIPES = 9
PRINTS = 3
SCRATCHES = 84


@lru_cache(maxsize=1)
def tile() -> NDArray[np.uint8]:
    """Return (512, 768, 3) uint8: of 255, how much dust, grease and scratches there is; edges meet."""
    layers = [_dust(), _grease(), _scratches()]
    drawn = np.stack([np.clip(layer, 0, 1) * 255 + 0.5 for layer in layers], axis=2).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


@lru_cache(maxsize=1)
def soft_tile() -> NDArray[np.uint8]:
    """Return the tile with its dust as the lens sees what lies on it: without edges, which only a sensor's dust has."""
    drawn = tile().copy()
    drawn[..., 0] = (_softened(np.clip(_dust(), 0, 1), DUST_BLUR_PX / TEXEL_PX) * 255 + 0.5).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


TILE = BroughtImage("Dirt on a lens", "1", tile)
SOFT_TILE = BroughtImage("Dirt on a lens, out of focus", "1", soft_tile)


def _around(position: tuple[float, float], reach: float) -> tuple[NDArray[np.intp], NDArray[np.intp], Float32, Float32]:
    """Return rows and columns about a position, across the edges, and how far they are from it: right, down."""
    x, y = position
    columns = np.arange(math.floor(x - reach), math.ceil(x + reach) + 1)
    rows = np.arange(math.floor(y - reach), math.ceil(y + reach) + 1)[:, None]
    right, down = np.broadcast_arrays((columns - x).astype(np.float32), (rows - y).astype(np.float32))
    return rows % SIZE[1], columns % SIZE[0], right, down


def _dust() -> Float32:
    """Return discs with a soft edge and a slightly darker rim, most of them faint."""
    drawn = stream("dirt", "dust")
    layer = np.zeros(SIZE[::-1], np.float32)
    for _ in range(SPECKS):
        place = drawn.random(2) * SIZE
        radius = SPECK_RADIUS[0] * math.exp(SPECK_RADIUS[1] * drawn.standard_normal())
        opaque = min(1.0, 0.16 * math.exp(0.8 * drawn.standard_normal()))
        narrow, turn = drawn.uniform(0.85, 1.0), drawn.uniform(0, math.pi)
        rows, columns, right, down = _around((place[0], place[1]), 1.5 * radius)
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = (down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn))) / np.float32(narrow)
        rho = np.hypot(along, across) / np.float32(radius)
        disc = np.clip((1 - rho) * np.float32(radius / 1.6) + np.float32(0.5), 0, 1)
        layer[rows, columns] += disc * (1 + np.float32(0.5) * rho**6) * np.float32(opaque / 1.5)
    return layer


def _noise(name: str, length: tuple[float, float]) -> Float32:
    """Return smooth noise of mean 0 and deviation 1 whose edges meet. length: its scale in x and y, texels."""
    white = stream("dirt", name).standard_normal(SIZE[::-1])
    x = np.fft.fftfreq(SIZE[0]) * length[0]
    y = np.fft.fftfreq(SIZE[1])[:, None] * length[1]
    smooth = np.fft.ifft2(np.fft.fft2(white) * np.exp(-2 * (math.pi * np.hypot(x, y)) ** 2)).real
    return (smooth / smooth.std()).astype(np.float32)


def _grease() -> Float32:
    """Return a thin uneven film, bands that a cloth or a finger has wiped, and prints of fingers."""
    drawn = stream("dirt", "grease")
    uneven, fine = _noise("uneven", (60, 45)), _noise("fine", (7, 6))
    layer = np.clip(np.float32(0.16) + np.float32(0.13) * uneven + np.float32(0.03) * fine, 0, None)
    hairs = _noise("hairs", (26, 1.2))
    for _ in range(WIPES):
        place, turn = drawn.random(2) * SIZE, drawn.uniform(-0.5, 0.9)
        half, wide, strong = drawn.uniform(70, 170), drawn.uniform(14, 40), drawn.uniform(0.2, 0.55)
        bend = drawn.uniform(-1.5e-3, 1.5e-3)
        rows, columns, right, down = _around((place[0], place[1]), min(half + 10, 0.49 * SIZE[1]))
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn)) + along**2 * np.float32(bend)
        # Hairs of the cloth leave lines along the way.
        lines = hairs[np.floor(across + place[1]).astype(int) % SIZE[1], np.floor(along).astype(int) % SIZE[0]]
        shape = np.exp(-((along / np.float32(half)) ** 4) * 2 - (across / np.float32(wide)) ** 4)
        layer[rows, columns] += np.float32(strong) * shape * np.clip(np.float32(0.55) + np.float32(0.3) * lines, 0, 1.5)
    for _ in range(PRINTS):
        place, turn = drawn.random(2) * SIZE, drawn.uniform(0, math.pi)
        rows, columns, right, down = _around((place[0], place[1]), 48)
        along = right * np.float32(math.cos(turn)) + down * np.float32(math.sin(turn))
        across = down * np.float32(math.cos(turn)) - right * np.float32(math.sin(turn))
        swirl = np.float32(0.7) * uneven[rows, columns] + np.float32(0.25) * fine[rows, columns]
        ridges = np.sin(np.hypot(along * np.float32(0.6), across + 17) * np.float32(2 * math.pi / 4.2) + swirl * 3)
        shape = np.exp(-((along / 34) ** 4) - (across / 24) ** 4)
        layer[rows, columns] += shape * (np.float32(0.32) + np.float32(0.16) * ridges)
    return _softened(np.asarray(layer, np.float32), 1.0)


def _scratches() -> Float32:
    """Return thin arcs, some in bundles as grit under a cloth leaves them."""
    import cv2

    drawn = stream("dirt", "scratches")
    layer = np.zeros(SIZE[::-1], np.float32)
    middle, radius, start = np.zeros(2), 1.0, 0.0
    for number in range(SCRATCHES):
        if number % 4 == 0:
            radius, start = math.exp(drawn.uniform(4.0, 6.5)), drawn.uniform(0, 2 * math.pi)
            middle = drawn.random(2) * SIZE - radius * np.array([math.cos(start), math.sin(start)])
        length = min(math.exp(drawn.uniform(2.0, 4.8)) / radius, 2.0)
        begin = start + drawn.normal(0, 30 / radius)
        angle = begin + np.linspace(0, length, 24)
        own = radius + drawn.normal(0, 7)
        points = middle + own * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        one = np.zeros(SIZE[::-1], np.uint8)
        for shift in ((x, y) for x in (-SIZE[0], 0, SIZE[0]) for y in (-SIZE[1], 0, SIZE[1])):
            cv2.polylines(one, [np.rint((points + shift) * 16).astype(np.int32)], False, 255, 1, cv2.LINE_AA, 4)
        layer += one * np.float32(drawn.uniform(0.15, 1.0) / 255)
    return _softened(layer, 0.7)


def _softened(layer: Float32, sigma: float) -> Float32:
    """Blur a layer whose edges meet. sigma: in texels."""
    import cv2

    margin = max(8, math.ceil(4 * sigma))
    wide = cv2.copyMakeBorder(layer, margin, margin, margin, margin, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), sigma), np.float32)[margin:-margin, margin:-margin]
