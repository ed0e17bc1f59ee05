# SPDX-License-Identifier: GPL-3.0-or-later
"""Random numbers by table: uniform 16-bit codes, and tables of 65,536 quantiles that they index.

This is five times as fast as numpy's normal numbers. With 65,536 steps the distribution function is at most 1 / 131,072
off, which a Kolmogorov-Smirnov test detects from some 1e10 samples on. The outermost normal numbers are 4.4 sigma.
"""

import math
from functools import cache, lru_cache
from statistics import NormalDist
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.integer | np.floating)

CODES = 65536  # 2^16: four codes in a 64-bit word, and OpenCV's LUT takes 16-bit indices


def uniform_codes(generator: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.uint16]:
    """Draw independent codes, uniform in 0 to 65535: four from each 64-bit word, the lowest first."""
    count = math.prod(shape)
    words = generator.bit_generator.random_raw((count + 3) // 4)
    return words.astype("<u8", copy=False).view(np.uint16)[:count].reshape(shape)


def uniform_words(generator: np.random.Generator, count: int) -> NDArray[np.uint32]:
    """Draw independent numbers (count,), uniform in 0 to 2^32 - 1: two from each 64-bit word, the lower half first.

    Their upper 24 bits are those of numpy's uniform numbers in float32, which take twice as long.
    """
    words = generator.bit_generator.random_raw((count + 1) // 2)
    return words.astype("<u8", copy=False).view(np.uint32)[:count]


def look_up(codes: NDArray[np.uint16], table: NDArray[T]) -> NDArray[T]:
    """Return table[codes] in a third of numpy's time; table: (CODES,)."""
    import cv2

    return np.asarray(cv2.LUT(codes, table.reshape(1, CODES)), table.dtype).reshape(codes.shape)


@cache
def normal_quantiles() -> NDArray[np.float64]:
    """Return (CODES,) ascending: the standard normal's mean within each of 65,536 intervals of equal probability."""
    normal = NormalDist()
    ends = [normal.inv_cdf(code / CODES) for code in range(1, CODES // 2)]
    exponents = -0.5 * np.square([*ends, 0.0])
    density = np.array([0.0, *map(math.exp, exponents.tolist())]) / math.sqrt(math.tau)
    lower = np.diff(density) * -CODES  # the mean between a and b is (pdf(a) - pdf(b)) / P(a < z < b)
    return np.concatenate([lower, -lower[::-1]])


@lru_cache(maxsize=16)
def scaled_normal(sigma: float) -> NDArray[np.float32]:
    """Return (CODES,): the quantiles of a normal number with this standard deviation."""
    return (normal_quantiles() * sigma).astype(np.float32)
