# SPDX-License-Identifier: GPL-3.0-or-later
"""How colour was compressed, by the tables in its JPEG files: quality, subsampling, and below what noise is taken."""

import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..images.image_header import JPEG_SIGNATURE, START_OF_SCAN, UnfitImageError, jpeg_header, next_segment
from .figure import Figure
from .footage import Float64, RecordingView

QUALITY, APART, STEP = "jpeg_quality", "jpeg_tables_apart_share", "jpeg_step"
SHARES = {(1, 1): "jpeg_444_share", (2, 1): "jpeg_422_share", (2, 2): "jpeg_420_share"}

TAKEN = 0.9  # of the variance of noise: a JPEG that takes so much of it has hidden it
SEEN = 0.5  # of 255: rounding of the pixels themselves hides as much

_TABLES = 0xDB  # marker of tables of quantisation (ITU-T T.81, B.1.1.3)
# ITU-T T.81, K.1 and K.2, by rows; what encoders scale by quality, as libjpeg does.
LUMINANCE = (
    *(16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56),
    *(14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92),
    *(49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMA = (
    *(17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99),
    *(47, 66, 99, 99, 99, 99, 99, 99, *[99] * 32),
)


@runtime_checkable
class EncodedSource(Protocol):
    """An open source whose colour lies in files, or in messages, that were encoded one by one."""

    def encoded_colour(self, frame: int) -> bytes:
        """Return what a frame's colour is decoded from; b"" where it was not encoded."""
        ...


@dataclass(frozen=True)
class Coding:
    """The compression of colour, by its files. remarks: what has to be said of it. jpeg: whether it was a JPEG."""

    figures: tuple[Figure, ...]
    remarks: tuple[str, ...] = ()
    jpeg: bool = False


@dataclass(frozen=True)
class _Tables:
    """Of a JPEG: steps of luminance and chroma (64,), by rows (None in a grey one); pixels a sample of chroma."""

    luminance: NDArray[np.int64]
    chroma: NDArray[np.int64] | None
    each: tuple[int, int]


def coding(footage: RecordingView, frames: Sequence[int]) -> Coding:
    """Return how colour of some frames was compressed. Raises InputError where a file cannot be read."""
    opened = footage.opened
    if not isinstance(opened, EncodedSource):
        return _untold("colour is no files of its own, but a video's")
    found = [tables for frame in frames if (tables := _tables(opened.encoded_colour(frame))) is not None]
    if not found:
        return _untold("no file of colour is a JPEG (what was one before it was written again is not known)")
    told = [_quality(tables) for tables in found]
    quality, apart = (np.array(column) for column in zip(*told, strict=True))
    steps = np.array([float(np.median(tables.luminance[1:])) for tables in found])
    figures = [
        _spread(QUALITY, quality),
        _spread(APART, apart),
        _spread(STEP, steps / 255),
    ]
    counted = Counter(tables.each for tables in found if tables.chroma is not None)
    colour = sum(counted.values())
    if colour:
        figures += [Figure.exact(name, counted[each] / colour, colour, "files") for each, name in SHARES.items()]
    remarks: list[str] = []
    if (worst := float(apart.max())) > 0:
        remarks.append(
            f"tables of the JPEGs are not those of libjpeg: the nearest quality is {np.median(quality):.0f}, and "
            f"their steps differ from its own by {worst:.0%} on average"
        )
    elif quality.min() != quality.max():
        remarks.append(f"quality of the JPEGs differs from file to file: {quality.min():.0f} to {quality.max():.0f}")
    if (hidden := float(np.median([hidden_std(tables.luminance) for tables in found]))) > SEEN:
        remarks.append(f"the JPEGs hide noise of less than {hidden:.2g} of 255: they take nine tenths of its variance")
    return Coding(tuple(figures), tuple(remarks), jpeg=True)


def hidden_std(steps: NDArray[np.int64]) -> float:
    """Return the deviation of white noise of luminance, of 255, of whose variance rounding to steps (64,) takes TAKEN.

    JPEG's transform is orthonormal: coefficients of white noise have the deviation of its pixels.
    """
    ratios, kept = _kept()
    tried = np.geomspace(0.05, 120, 300)
    left = np.interp(steps / tried[:, None], ratios, kept).mean(axis=1)
    return float(np.interp(1 - TAKEN, left, tried))


@cache
def _kept() -> tuple[Float64, Float64]:
    """Return steps over the deviation of normal numbers, and which share of their variance rounding to these leaves."""
    ratios, many = np.geomspace(0.05, 20, 200), range(1, 200)
    beyond = np.array([[math.erfc((k - 0.5) * ratio / math.sqrt(2)) for k in many] for ratio in ratios.tolist()])
    return ratios, ratios**2 * (beyond * (2 * np.array(many) - 1)).sum(axis=1)  # the sum of k^2 P(k), by parts


def _untold(why: str) -> Coding:
    return Coding(tuple(Figure.none(name, why) for name in (QUALITY, APART, STEP)))


def _spread(name: str, values: Float64) -> Figure:
    """Return the median of files, with the range that 95 % of them have."""
    low, middle, high = (float(value) for value in np.quantile(values, (0.025, 0.5, 0.975)))
    return Figure(name, middle, low, high, len(values), "files")


def _tables(data: bytes) -> _Tables | None:
    """Return the tables of a JPEG; None for a file that is none. 16-bit tables and CMYK are read as others are."""
    if data[:2] != JPEG_SIGNATURE:
        return None
    try:
        sampling = jpeg_header(io.BytesIO(data)).sampling
        found = _steps_of(data)
    except UnfitImageError:
        return None
    tables = [found[number] for number in sorted(found)]
    if not tables or not sampling:
        return None
    if len(sampling) < 3:
        return _Tables(tables[0], None, (1, 1))
    (across, down), (less_across, less_down) = sampling[0], sampling[1]
    return _Tables(tables[0], tables[min(1, len(tables) - 1)], (across // less_across, down // less_down))


def _steps_of(data: bytes) -> dict[int, NDArray[np.int64]]:
    """Return the tables of quantisation (64,) that stand before the first scan, by number, by rows."""
    stream = io.BytesIO(data)
    stream.seek(len(JPEG_SIGNATURE))
    found: dict[int, NDArray[np.int64]] = {}
    while (segment := next_segment(stream))[0] != START_OF_SCAN:
        marker, length = segment
        content = stream.read(length)
        while marker == _TABLES and content:
            wide, number = content[0] >> 4, content[0] & 15
            size = 64 * (1 + bool(wide))
            steps = np.zeros(64, np.int64)
            steps[zigzag()] = np.frombuffer(content[1 : 1 + size], ">u2" if wide else "u1")
            found[number] = steps
            content = content[1 + size :]
    return found


@cache
def zigzag() -> NDArray[np.int64]:
    """Return (64,): where by rows each coefficient of a file's order is (ITU-T T.81, figure A.6)."""
    places = [(row, column) for row in range(8) for column in range(8)]
    places.sort(key=lambda at: (sum(at), at[0] if sum(at) % 2 else at[1]))
    return np.array([8 * row + column for row, column in places])


@cache
def _standard() -> Float64:
    """Return (100, 128): steps of luminance and chroma at qualities 1 to 100, as libjpeg has them."""
    made: list[Float64] = []
    for quality in range(1, 101):
        percent = 5000 // quality if quality < 50 else 200 - 2 * quality
        made.append(np.clip((np.array([*LUMINANCE, *CHROMA]) * percent + 50) // 100, 1, 255).astype(np.float64))
    return np.array(made)


def _quality(tables: _Tables) -> tuple[float, float]:
    """Return the nearest quality, and by which share steps differ from its own on average: 0 where it is exact."""
    steps = tables.luminance if tables.chroma is None else np.concatenate([tables.luminance, tables.chroma])
    standard = _standard()[:, : len(steps)]
    apart = np.abs(np.log(np.maximum(steps, 1) / standard)).mean(axis=1)
    # Of equal ones the highest, as tables of ones are what quality 100 is asked for.
    nearest = len(apart) - 1 - int(np.argmin(apart[::-1]))
    return float(nearest + 1), float(np.abs(steps / standard[nearest] - 1).mean())
