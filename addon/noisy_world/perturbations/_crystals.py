# SPDX-License-Identifier: GPL-3.0-or-later
"""Ice grown from a pane's edge by `headless/pictures/draw_frost.py`: its thickness, and when it grew.

The strip is grown once, beside one edge, with its ends joined. Each side of a frame shows another part of it.
"""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import BroughtImage
from ..core.regular_files import read_bytes
from ..core.shipped import shipped
from ..core.streams import stream

T = TypeVar("T", bound=np.generic)

Float32: TypeAlias = NDArray[np.float32]

WIDTH_PX, HEIGHT_PX = 3072, 320  # along the edge, and from it inwards
TIME_SHRUNK = 4  # the map of times is so many times smaller
# The shorter side of a frame that shows the strip pixel for pixel. Larger and smaller frames show as much of it, and
# strips of opposite sides never meet.
SHORT_SIDE_PX = 680.0
LEVELS = 3  # the strip in its own size, half and a quarter of it
START_PX = 1 << (LEVELS - 1)  # a side's part starts at a multiple of this, which is a whole pixel of every level

# Chosen by eye, after photographs. Times are shares of the whole growth.
RISE, AGING = 0.12, 0.9  # from when a ridge comes until it is whole, and until the ice about it is
RIDGE_OPACITY, RIDGE_RELIEF, BODY_RELIEF = 1.0, 1.0, 0.35  # of ridges and of the ice about them; that of the body is 1
SHADE, DARKEST, LIGHTEST = 0.5, -0.2, 0.3  # how much lighter ice is that leans to the light, and its limits
GLINT_SLOPE, GLINT_FROM = 4.0, 0.8  # a glint begins at the slope 0.8 / 4
LIGHT_SHARE = 0.035  # standard deviation of what lights a piece of ice, in shorter sides of the frame
MEAN_SHARE = 0.25  # of the whole frame's mean in that light
HALVINGS = 3  # of the image, before it is blurred for that

# What lies between the ridges, chosen by eye: ice about each ridge, haze over a fern, and rime along the edge, grainy.
_NEAR, _WIDE, _RIME = (1.04, 2.6), (0.65, 9.0), (0.72, 55.0)  # share of the ridges' thickness, and pixels
_GRAIN = (0.25, 0.9)  # standard deviation, and pixels
# Along the edge ice comes here sooner, there later, so that the first ice is in patches: share of the whole growth, and
# the waves along the strip, which close at its ends.
_LATER, _PATCHES = 0.45, (5, 8, 13)
_FADE_PX = 40.0  # it gets thinner so far before the strip's end


def map_file(name: str) -> Path:
    """Return the path of a map: thickness or time."""
    return shipped("perturbations/ice") / f"fern_{name}.png"


@dataclass(frozen=True)
class Level:
    """Where the strip lies in the atlas, `shrunk` times smaller: rows [top, top + rows), repeated along them."""

    shrunk: int
    top: int
    rows: int


@lru_cache(maxsize=1)
def levels() -> tuple[Level, ...]:
    """Return the levels; above each there is one more row, equal to its first."""
    found, top = [], 1
    for power in range(LEVELS):
        rows = HEIGHT_PX >> power
        found.append(Level(1 << power, top, rows))
        top += rows + 1
    return tuple(found)


def level_of(zoom: float) -> Level:
    """Return the level whose pixels are nearest to a frame's in size; zoom: pixels of the strip in one of the frame."""
    return levels()[sum(zoom > 2 ** (power - 0.5) for power in range(1, LEVELS))]


@lru_cache(maxsize=1)
def atlas() -> NDArray[np.uint8]:
    """Return (3, rows, WIDTH_PX), read-only: ridge, time and body, 0 to 255, of all levels below each other.

    Ridge: thickness of the crystals' ridges when they are old. Time: when ice comes. Body: of what lies between them.
    """
    import cv2

    ridge = _read("thickness")
    time = cv2.resize(_wrapped(_read("time"), 2), None, fx=TIME_SHRUNK, fy=TIME_SHRUNK, interpolation=cv2.INTER_LINEAR)
    strip = np.dstack(
        [ridge, _in_patches(np.asarray(time[:, 2 * TIME_SHRUNK : -2 * TIME_SHRUNK], np.uint8)), _body(ridge)]
    )
    parts = []
    for level in levels():
        small = cv2.resize(strip, (WIDTH_PX // level.shrunk, level.rows), interpolation=cv2.INTER_AREA)
        repeated = np.tile(small, (1, level.shrunk, 1))
        parts += [repeated[:1], repeated]
    made = np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
    made.flags.writeable = False
    return made


def atlas_picture() -> BroughtImage:
    """Return the atlas as node groups take it."""
    digest = hashlib.sha256(b"".join(read_bytes(map_file(name)) for name in ("thickness", "time"))).hexdigest()
    return BroughtImage("NW Frost on a lens", f"2 {digest[:16]}", lambda: atlas().transpose(1, 2, 0))


def _in_patches(time: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return times of which those of some stretches of the edge are later; the last is as late as before."""
    along = np.linspace(0, 2 * np.pi, WIDTH_PX, endpoint=False)
    phases = stream("patches of frost").random(len(_PATCHES)) * 2 * np.pi
    waves = sum(np.cos(count * along + phase) for count, phase in zip(_PATCHES, phases, strict=True))
    rank = np.argsort(np.argsort(waves)) / (WIDTH_PX - 1)  # as many columns of each lateness
    return np.rint(time * (1 - _LATER) + 255 * _LATER * rank).astype(np.uint8)


def _read(name: str) -> NDArray[np.uint8]:
    import cv2

    encoded = np.frombuffer(read_bytes(map_file(name)), dtype=np.uint8)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), np.uint8)


def _body(ridge: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ice between ridges."""
    thickness = ridge.astype(np.float32)
    body = sum(np.float32(share) * _blurred(thickness, width_px) for share, width_px in (_NEAR, _WIDE))
    depth_px = np.arange(HEIGHT_PX, dtype=np.float32)[:, None] + np.float32(0.5)
    body = body + np.float32(255 * _RIME[0]) * np.exp(depth_px / np.float32(-_RIME[1]))
    grain = _blurred(stream("grains of frost").standard_normal(ridge.shape, dtype=np.float32), _GRAIN[1])
    body *= np.clip(1 + np.float32(_GRAIN[0]) * grain / grain.std(), 0.35, 2)
    # Beyond the last row there is no ice.
    body *= np.clip((np.float32(HEIGHT_PX - 8) - depth_px) / np.float32(_FADE_PX), 0, 1)
    return np.rint(np.clip(body, 0, 255)).astype(np.uint8)


def _blurred(strip: Float32, sigma_px: float) -> Float32:
    import cv2

    reach = int(4 * sigma_px) + 1
    blurred = np.asarray(cv2.GaussianBlur(_wrapped(strip, reach), (0, 0), sigma_px), np.float32)
    return blurred[:, reach:-reach]


def _wrapped(strip: NDArray[T], columns: int) -> NDArray[T]:
    return np.pad(strip, ((0, 0), (columns, columns)), mode="wrap")
