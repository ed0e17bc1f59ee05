# SPDX-License-Identifier: GPL-3.0-or-later
"""Shot noise: light arrives as photons."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ...images.pixels import rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICK_NOISE, QUICKLY, bands, by_bands, quick_key
from ._noise import CODES, look_up, poisson_quantile, uniform_codes, uniform_words

MOST_PHOTONS = 256  # the largest mean whose 256 likeliest numbers leave out less than 1e-12 of the probability
OUTCOMES = 256  # columns of the alias table of a level, and codes of a column: one for each value of 8 random bits
FEWEST_PHOTONS = 1e-6  # mean at full scale below which a frame is black: a megapixel expects a few photons at most
BYTE_NOISE = np.float32(2**-10)  # of a byte: more than float32's error of a byte that was divided by 255 and multiplied


@dataclass(frozen=True)
class ShotNoise:
    """Each channel of each pixel is a Poisson number of photons over their mean number at full scale, as ImageNet-C."""

    photons: float = key(
        "mean number of photons at full scale; 0 is darkness", default=12.0, minimum=0, maximum=MOST_PHOTONS
    )
    coarse: bool = quick_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "photons": "Lower: more grain, most of it in bright places; 0 is darkness",
        "coarse": QUICK_NOISE,
    }


def apply(rgb: NDArray[np.float32], parameters: ShotNoise, context: FrameContext) -> NDArray[np.float32]:
    """Count photons in (H, W, 3).

    A value is split into the byte below it, drawn by tables, and the rest, drawn by itself: the sum of two Poisson
    numbers is a Poisson number of the sum's mean.
    """
    photons = parameters.photons
    if photons < FEWEST_PHOTONS:
        return np.zeros_like(rgb)
    flat = rgb.reshape(len(rgb), -1)
    (threshold, first, second), generator = _alias_tables(photons), context.pattern_stream()
    rests = context.pattern_stream("rest") if any(_split(band)[1].any() for band in bands(flat)) else None

    def count(band: NDArray[np.float32]) -> NDArray[np.float32]:
        levels, rest = _split(band)
        low, columns = _columns(levels, generator)
        is_second = low >= look_up(columns, threshold)
        counts = np.where(is_second, look_up(columns, second), look_up(columns, first)).astype(np.float32)
        if rests is not None:
            rest *= np.float32(photons / 255)
            _add_few_photons(counts, rest, rests)
        counts *= np.float32(1 / photons)
        return np.minimum(counts, 1, out=counts)

    return by_bands(flat, flat.dtype, count).reshape(rgb.shape)


def _split(rgb: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the byte below each value, and what is left of the value in units of a byte, at least 0 and less than 1.

    Values lie in [0, 1].
    """
    scaled = rgb * np.float32(255)
    levels = (scaled + BYTE_NOISE).astype(np.uint8)
    scaled -= levels
    scaled -= BYTE_NOISE
    return levels, np.maximum(scaled, 0, out=scaled)


def apply_bytes(rgb: NDArray[np.uint8], parameters: ShotNoise, context: FrameContext) -> NDArray[np.uint8]:
    """Count photons in (H, W, 3) bytes."""
    if parameters.photons < FEWEST_PHOTONS:
        return np.zeros_like(rgb)
    flat, table, generator = rgb.reshape(len(rgb), -1), _byte_table(parameters.photons), context.pattern_stream()
    return by_bands(flat, flat.dtype, lambda band: _draw(band, generator, table)).reshape(rgb.shape)


def _draw(levels: NDArray[np.uint8], generator: np.random.Generator, table: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Draw bytes from the distribution of each level of a band, (rows, values)."""
    import cv2

    low, columns = _columns(levels, generator)
    found = look_up(columns, table).view(np.uint8).reshape(*levels.shape, 4)  # one look-up fetches all three
    first, second, threshold, _ = cv2.split(found)
    return np.asarray(cv2.copyTo(second, cv2.compare(low, threshold, cv2.CMP_GE), first), np.uint8)


def _columns(levels: NDArray[np.uint8], generator: np.random.Generator) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Draw for each level of a band, (rows, values), 8 bits, and with 8 more a column of its distribution."""
    import cv2

    codes = uniform_codes(generator, levels.shape).astype("<u2", copy=False)
    low, high = cv2.split(codes.view(np.uint8).reshape(*levels.shape, 2))
    columns = cv2.merge([high, levels]).view("<u2").reshape(levels.shape)  # level x 256 + column
    return np.asarray(low, np.uint8), columns


@lru_cache(maxsize=16)
def _byte_table(photons: float) -> NDArray[np.int32]:
    """Return for each column of `_alias_tables` four bytes: both outcomes, the threshold, and one that says nothing."""
    threshold, first, second = _alias_tables(photons)
    share = np.float32(1 / photons)
    outcomes = [rgb_bytes((counts.astype(np.float32) * share)[:, None])[:, 0] for counts in (first, second)]
    return np.stack([*outcomes, threshold, threshold], axis=-1).view(np.int32)[:, 0]


@lru_cache(maxsize=16)
def _alias_tables(photons: float) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.uint16]]:
    """Tabulate the Poisson numbers of the 256 bytes for the alias method (Walker 1977), three arrays of 65,536.

    The numbers of a byte share its 65,536 codes, so that its distribution function is at most 1 / 131,072 off. Column
    c of level l, at l x 256 + c, has 256 codes and two outcomes: the first for codes below threshold, else the second.
    """
    offset, share = _poisson(np.arange(256, dtype=np.float64) * (photons / 255))
    before = np.rint(np.cumsum(share, axis=1) * (CODES / share.sum(axis=1, keepdims=True))).astype(np.int64)
    codes = np.diff(before, axis=1, prepend=0)
    rows = np.arange(256)
    threshold = np.full((256, OUTCOMES), OUTCOMES)
    partner = np.tile(np.arange(OUTCOMES), (256, 1))
    poor, rich = codes.copy(), codes.copy()
    for _ in range(OUTCOMES - 1):
        # The column with the fewest codes keeps them; the one with the most fills it up.
        taker, giver = poor.argmin(axis=1), rich.argmax(axis=1)
        has = poor[rows, taker]
        threshold[rows, taker] = has
        partner[rows, taker] = giver
        poor[rows, giver] += has - OUTCOMES
        rich[rows, giver] = poor[rows, giver]
        poor[rows, taker], rich[rows, taker] = CODES, -1
    # A column that is full has itself as both outcomes: no byte holds its threshold.
    partner = np.where(threshold == OUTCOMES, np.arange(OUTCOMES), partner)
    first = offset[:, None] + np.arange(OUTCOMES)
    return np.minimum(threshold, 255).astype(np.uint8).reshape(-1), _flat(first), _flat(offset[:, None] + partner)


def _flat(table: NDArray[Any]) -> NDArray[np.uint16]:
    return np.ascontiguousarray(table, np.uint16).reshape(-1)


def _poisson(means: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return for each of n means the smallest of its 256 outcomes (n,), and their probabilities times 256 (n, 256)."""
    offset = np.maximum(means.astype(np.int64) - OUTCOMES // 2, 0)
    outcomes = offset[:, None] + np.arange(OUTCOMES)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, outcomes.max() + 1)))])
    log_mean = np.log(np.maximum(means, 1e-300))
    likelihood = np.exp(outcomes * log_mean[:, None] - means[:, None] - log_factorial[outcomes])
    return offset, likelihood * (OUTCOMES / likelihood.sum(axis=1, keepdims=True))


def _add_few_photons(counts: NDArray[np.float32], means: NDArray[np.float32], generator: np.random.Generator) -> None:
    """Add to the counts Poisson numbers of means up to about 1, each by inverting one uniform number.

    Of a uniform number below e to the minus the largest mean there is no photon, which are nearly all.
    """
    codes = uniform_words(generator, means.size)
    least = math.exp(-float(means.max())) - 1e-6  # 1e-6: above the error of float32's exponential
    some = np.flatnonzero(codes >= np.uint32(max(least, 0) * 2**32))
    # As numpy's own uniform numbers in float32: 24 bits.
    uniform = (codes[some] >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)
    means = means.reshape(-1)[some]
    probability = np.exp(-means)
    cumulative = probability.copy()
    found = np.zeros_like(means)
    for count in range(1, 12):
        more = uniform >= cumulative
        if not more.any():
            break
        found += more
        probability *= means * np.float32(1 / count)
        cumulative += probability
    counts.reshape(-1)[some] += found


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Count photons: the mean number at a pixel is its value times the mean number at full scale."""
    photons = given["photons"]
    with canvas.graph.section("Uniform noise"):
        uniform = canvas.random(0, canvas.position_px)
    with canvas.graph.section("Photons"):
        light = canvas.graph.math("MAXIMUM", canvas.image, 0.0)
        return poisson_quantile(light * photons, uniform) * (1.0 / photons)


PERTURBATION = ColourPerturbation(
    name="shot_noise",
    label="Shot noise",
    stage="sensor",
    order=30,
    parameters=ShotNoise,
    severities={"photons": (60, 25, 12, 5, 3)},
    newly=QUICKLY,
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Adds the grain of few photons, most of it in bright places",
        "Poisson numbers of photons",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # a number takes 16 random bits, not 24, and float colour is rounded before it
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
    temporals=("fresh", "fixed"),
    grain=True,
)
