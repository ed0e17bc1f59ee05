# SPDX-License-Identifier: GPL-3.0-or-later
"""Random numbers of pixels, as arrays and as nodes: uniform, normal and Poisson, white noise, shifted places.

Random numbers by table: uniform 16-bit codes, and tables of 65,536 quantiles that they index.

This is five times as fast as numpy's normal numbers. With 65,536 steps the distribution function is at most 1 / 131,072
off, which a Kolmogorov-Smirnov test detects from some 1e10 samples on. The outermost normal numbers are 4.4 sigma.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, reduce
from statistics import NormalDist
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.graph_arrays import Words, hash_of_four, hash_of_three, hash_of_two
from ...core.node_graph import Graph, GroupInput, Socket
from ...core.streams import stream
from ..groups import PURPOSES, seed_of
from ..kinds import FrameContext

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


# Random numbers that neighbours and frames share.
#
# A field is white numbers under a Gaussian of the image, whose weights have squares that sum to 1, so each number stays
# standard normal; those that the weights reach beyond the image are drawn too, so its edges are like its middle. In
# time it is the sum of several frames' numbers, each from its own stream, so any frame is made alone. White numbers
# have 256 values: their distribution function is at most 1 / 512 off, and sums of them far less.


Draws: TypeAlias = NDArray[np.uint16] | NDArray[np.float32]
"""Random numbers (H, W): uniform codes where each pixel has its own, or standard normal ones that neighbours share."""

_REACH = 2.5  # deviations of the Gaussian: what is left out holds 1 % of its weights; chosen
_FARTHEST = 16  # times the image's longer side: farther correlation looks the same, within 1 %; chosen
_COARSE_PX = 1.75  # of correlation that a grid resolves: farther correlation is drawn on a coarser grid; chosen


@dataclass(frozen=True)
class SharedNoise:
    """How far random numbers are shared.

    px: at this distance their correlation is 1 / e, as exp(-(distance / px)^2), from 2 px on within 0.03, below that
    it is less; 0: pixels have their own. frames: of so many, at a lag of k frames their correlation is 1 - k / frames;
    below 2: frames have their own. share: which part of the variance is so; the rest is each pixel's and frame's own.
    """

    px: float = 0.0
    frames: int = 1
    share: float = 1.0


def drawn(
    context: FrameContext, purpose: str, shape: tuple[int, int], shared: SharedNoise, count: int = 1
) -> tuple[Draws, ...]:
    """Draw fields (H, W) of random numbers, independent of one another, for `scaled` and `shifted_places`."""
    frames = max(shared.frames, 1) if context.temporal == "fresh" else 1
    if shared.share <= 0 or (shared.px <= 0 and frames == 1):
        generator = context.pattern_stream(purpose)
        return tuple(uniform_codes(generator, shape) for _ in range(count))
    longest = max(shape)
    px = min(shared.px, _FARTHEST * longest)
    grid = max(min(int(px / _COARSE_PX), longest // 8), 1)
    weights = _gaussian_weights(px / grid, interpolated=grid > 1)
    rim = len(weights) // 2
    coarse = shape if grid == 1 else (-(-shape[0] // grid) + 2, -(-shape[1] // grid) + 2)
    white = _white(context, purpose, (coarse[0] + 2 * rim, coarse[1] + 2 * rim), frames, count)
    fields = tuple(_finer(_filtered(each, weights), weights, grid, shape) for each in white)
    if shared.share >= 1:
        return fields
    generator = context.pattern_stream(purpose, "own")
    part, rest = np.float32(math.sqrt(shared.share)), scaled_normal(math.sqrt(1 - shared.share))
    made: list[NDArray[np.float32]] = []
    for field in fields:
        own = look_up(uniform_codes(generator, shape), rest)
        own += np.multiply(field, part, out=field)  # in place, as it is no one else's
        made.append(own)
    return tuple(made)


def scaled(draws: Draws, sigma: float) -> NDArray[np.float32]:
    """Return normal numbers (H, W) with this standard deviation."""
    if draws.dtype == np.uint16:
        return look_up(draws.view(np.uint16), scaled_normal(sigma))
    return np.multiply(draws, np.float32(sigma), dtype=np.float32)


def _white(
    context: FrameContext, purpose: str, shape: tuple[int, int], frames: int, count: int
) -> list[NDArray[np.float32]]:
    """Return fields (H, W) of standard normal numbers: sums of this frame's and the frames' before it."""
    import cv2

    table = _byte_quantiles() / np.float32(math.sqrt(frames))
    sums: list[NDArray[np.float32]] = []
    for back in range(frames):
        generator = _stream_before(context, purpose, back)
        for place in range(count):
            white = np.asarray(cv2.LUT(_uniform_bytes(generator, shape), table), np.float32)
            if back:
                sums[place] += white
            else:
                sums.append(white)
    return sums


def _uniform_bytes(generator: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.uint8]:
    count = math.prod(shape)
    words = generator.bit_generator.random_raw((count + 7) // 8)
    return words.astype("<u8", copy=False).view(np.uint8)[:count].reshape(shape)


@cache
def _byte_quantiles() -> NDArray[np.float32]:
    """Return (256,) ascending: the standard normal's mean within intervals of equal probability, of variance 1."""
    means = normal_quantiles().reshape(256, -1).mean(axis=1)
    return (means / np.sqrt(np.mean(means**2))).astype(np.float32)


def _stream_before(context: FrameContext, purpose: str, back: int) -> np.random.Generator:
    """Return the stream of a pattern so many frames earlier; those before the first frame have streams too."""
    if not back:
        return context.pattern_stream(purpose)
    if back <= context.index:  # only of fresh patterns there are frames before
        return stream(*context.identifiers, purpose, frame=context.index - back)
    return stream(*context.identifiers, purpose, "before", frame=back - context.index)


@lru_cache(maxsize=16)
def _gaussian_weights(px: float, *, interpolated: bool = False) -> NDArray[np.float32]:
    """Return the weights (odd,) of a Gaussian, whose squares sum to 1 and whose own correlation is 1 / e at px.

    interpolated: linearly afterwards, which widens it by a variance of 1 / 6.
    """
    sigma = math.sqrt(px**2 / 4 - 1 / 6) if interpolated else px / 2
    places = np.arange(-math.ceil(_REACH * sigma), math.ceil(_REACH * sigma) + 1)
    weights = np.exp(-(places**2) / (2 * sigma**2)) if sigma > 0 else np.ones(1)
    return (weights / np.sqrt(np.sum(weights**2))).astype(np.float32)


def _filtered(white: NDArray[np.float32], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what the weights, across and down, make of white numbers, as far as these reach."""
    import cv2

    rim = len(weights) // 2
    if not rim:
        return white
    return np.asarray(cv2.sepFilter2D(white, -1, weights, weights), np.float32)[rim:-rim, rim:-rim]


def _finer(
    field: NDArray[np.float32], weights: NDArray[np.float32], grid: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Return a field of a coarse grid at each pixel: interpolated, and scaled to what it had on the grid."""
    import cv2

    if grid == 1:
        return field
    size = field.shape[1] * grid, field.shape[0] * grid
    fine = cv2.resize(np.ascontiguousarray(field), size, interpolation=cv2.INTER_LINEAR)
    inner = np.asarray(fine, np.float32)[grid : grid + shape[0], grid : grid + shape[1]]
    near = float(np.sum(weights[1:].astype(np.float64) * weights[:-1]))  # correlation of neighbours on the grid
    return np.multiply(inner, _gains(near, grid, shape), out=inner)


@lru_cache(maxsize=4)
def _gains(near: float, grid: int, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return (H, W): by how much interpolation between numbers of this correlation lowers their deviation, inverted."""
    down, right = (((np.arange(count) + 0.5) / grid - 0.5) % 1 for count in shape)
    gains = (1 / np.sqrt((1 - part) ** 2 + part**2 + 2 * part * (1 - part) * near) for part in (down, right))
    of_row, of_column = (gain.astype(np.float32) for gain in gains)
    return of_row[:, None] * of_column


# Node groups that turn uniform random numbers into normal or Poisson ones; the groups of noise use them.


# The normal quantile of u is (u - 1/2) RISE(s) / FALL(s) with s = 256 u (1 - u). The coefficients are fitted: minimax
# in probability over the 24 bits of a uniform number. The error is 4e-5 in probability at most; in the quantile it is
# 0.004 sigma up to 3.5 sigma, and 0.008 sigma up to the outermost number, 5.6 sigma.
RISE = (11.178267632, 409952.79183, 431089282.72, 16590423823.0, 31374931130.0, 3848232857.0, 23366387.121)
FALL = (1.0, 42045.923683, 51749151.633, 2443034354.4, 6111273993.7, 1141341577.0, 17034050.319)

# The Poisson quantile is the whole part of mean F(t) + G(t) + H(t) / mean with t = normal quantile / sqrt(mean), as in
# Temme's uniform expansion (Giles 2016, ACM TOMS 42-1). Its first terms, 1, t, t^2 / 6 and 1 / 3, are kept; the other
# coefficients are fitted to the exact distributions of means from FEW photons up. The error is 3e-4 in probability at
# most.
F = (1.0, 1.0, 1 / 6, -0.0150540613, 0.00470244695, -0.00102170197, 6.80581343e-05)
G = (1 / 3, -0.0251174809, 0.00214705062, -0.000638400676, 0.000452340337)
H = (-0.0187086449, 0.0146071656, -0.00383880426)
FEW = 0.5  # photons: below this mean the probabilities are summed instead
MOST_OF_FEW = 6  # photons: of mean FEW, one number in a million is larger
LOWEST_T = -1.4  # of t: at and below it the quantile is 0 whatever the mean


def normal_quantile(uniform: Socket) -> Socket:
    """Return the standard normal quantiles of `uniform`, in [0, 1], for each channel."""
    return uniform.graph.group(_normal_group(), {"Uniform": uniform}).out("Normal", "vector")


def poisson_quantile(mean: Socket, uniform: Socket) -> Socket:
    """Return the quantiles of `uniform`, in [0, 1], of Poisson numbers of this mean, 0 to 256, for each channel."""
    return uniform.graph.group(_poisson_group(), {"Mean": mean, "Uniform": uniform}).out("Count", "vector")


@cache
def _normal_group() -> Graph:
    graph = Graph("Normal Numbers", "Turns uniform random numbers into standard normal ones, each channel by itself")
    uniform = graph.input(GroupInput("Uniform", "vector", (0.5, 0.5, 0.5), "Uniform random numbers in [0, 1]"))
    with graph.section("Rational function"):
        position = uniform * graph.math("MULTIPLY_ADD", uniform, -256.0, 256.0)
        ratio = _polynomial(position, RISE) / _polynomial(position, FALL)
    with graph.section("Both sides"):
        graph.output("Normal", (uniform - 0.5) * ratio, "vector", "Numbers of mean 0 and standard deviation 1")
    return graph


@cache
def _poisson_group() -> Graph:
    graph = Graph("Poisson Numbers", "Turns uniform random numbers into Poisson ones, each channel by itself")
    mean = graph.input(GroupInput("Mean", "vector", (1.0, 1.0, 1.0), "Expected numbers, from 0 to 256"))
    uniform = graph.input(GroupInput("Uniform", "vector", (0.5, 0.5, 0.5), "Uniform random numbers in [0, 1]"))
    with graph.section("Many: expansion about the normal"):
        normal = normal_quantile(uniform)
        many = _many(graph.math("MAXIMUM", mean, FEW), normal)
    with graph.section("Few: one probability after the other"):
        few = _few(graph.math("MINIMUM", mean, FEW), uniform)
    with graph.section("Choose"):
        graph.output("Count", graph.mix(many, few, mean < FEW), "vector", "Whole numbers")
    return graph


def _many(mean: Socket, normal: Socket) -> Socket:
    graph = mean.graph
    narrow = graph.math("POWER", mean, -0.5)
    t = graph.math("MAXIMUM", normal * narrow, LOWEST_T)
    rest = graph.math("MULTIPLY_ADD", _polynomial(t, H), narrow * narrow, _polynomial(t, G))
    number = graph.math("MULTIPLY_ADD", _polynomial(t, F), mean, rest)
    return graph.math("MAXIMUM", graph.math("FLOOR", number), 0.0)


def _few(mean: Socket, uniform: Socket) -> Socket:
    """Return how many of the probabilities of 0, 1, 2, ..., summed in this order, stay below `uniform`."""
    graph = mean.graph
    probability = graph.math("POWER", (1 / 2.718281828,) * 3, mean)
    count: Socket | None = None
    left = uniform
    for number in range(1, MOST_OF_FEW + 1):
        left = left - probability
        fits = graph.math("SIGN", graph.math("MAXIMUM", left, 0.0))
        count = fits if count is None else count + fits
        probability = probability * (mean * (1 / number))
    assert count is not None
    return count


def _polynomial(x: Socket, coefficients: Sequence[float]) -> Socket:
    """Evaluate a polynomial by Horner's rule; coefficients: from the constant upwards."""
    *rest, last = coefficients
    highest = x.graph.math("MULTIPLY_ADD", x, last, rest.pop())
    return reduce(lambda value, term: x.graph.math("MULTIPLY_ADD", value, x, term), reversed(rest), highest)


# The random numbers that a group's White Noise nodes give, on arrays: both executions of a perturbation draw the same.
#
# A number is Bob Jenkins' hash of four words (lookup3, 2006, in the public domain), which are the bits of four float32:
# x, y, the seed, and the frame's key with the purpose. In which order the node takes them was found from its output.


Float32: TypeAlias = NDArray[np.float32]

_ORDERS = ((0, 2, 3), (1, 0, 2), (2, 3, 1), (3, 1, 0))


@dataclass(frozen=True)
class WhiteNoise:
    """Uniform numbers by position, as `Canvas.random` gives them. key: the frame's, 0 for a pattern that is kept.

    quick: of a canvas that is so.
    """

    seed: int
    key: int
    quick: bool = False

    def random(self, purpose: int, x: Float32, y: Float32) -> tuple[Float32, Float32, Float32]:
        """Return three independent numbers in [0, 1] for each position of whole numbers, arrays of one shape."""
        if self.quick:
            return self._quick(purpose, x, y)
        words = [_bits(np.broadcast_to(np.float32(item), x.shape)) for item in (x, y, self.seed, self._key(purpose))]
        # The three numbers are those of three orders of the words; they are calculated at once.
        first, second, third = _uniform(*(np.stack([words[k] for k in order]) for order in _ORDERS))
        return first, second, third

    def _quick(self, purpose: int, x: Float32, y: Float32) -> tuple[Float32, Float32, Float32]:
        own = np.add(self.numbers(purpose), 1, dtype=np.float32)
        across, along = (
            _bits((place + np.float32(0.5)) * factor)
            for place, factor in zip(np.broadcast_arrays(x, y), own, strict=False)
        )
        second, third = (hash_of_three(across, along, _bits(np.full_like(x, number))) for number in (1, 2))
        return _share(hash_of_two(across, along)), _share(second), _share(third)

    def _key(self, purpose: int) -> int:
        return self.key * PURPOSES + purpose

    def numbers(self, purpose: int) -> tuple[float, float, float]:
        """Return three independent numbers in [0, 1] of the whole frame."""
        zero = np.zeros(1, np.float32)
        first, second, third = replace(self, quick=False).random(purpose, zero, zero)
        return float(first[0]), float(second[0]), float(third[0])


def white_noise(context: FrameContext, *, quick: bool = False) -> WhiteNoise:
    """Return the numbers of a frame, which are those of its node group."""
    return WhiteNoise(seed_of(context.identifiers), context.index if context.temporal == "fresh" else 0, quick)


def _bits(value: Float32) -> Words:
    return np.ascontiguousarray(value, np.float32).view(np.uint32)


def _uniform(x: Words, y: Words, z: Words, w: Words) -> Float32:
    return _share(hash_of_four(x, y, z, w))


def _share(hashed: Words) -> Float32:
    return (hashed.astype(np.float64) / 0xFFFFFFFF).astype(np.float32)


# Depth that each pixel takes from a place near its own.


LARGEST = 32767  # of 16 bits with a sign


def shifted_places(
    down: Draws, right: Draws, sigma_px: float
) -> tuple[NDArray[np.signedinteger], NDArray[np.signedinteger]]:
    """Return rows and columns (H, W): each pixel's own, moved by rounded normal numbers, inside the image.

    down, right: (H, W) of random numbers. The places have 16 bits where these suffice, else 32.
    """
    height, width = down.shape
    short = max(height, width) + math.ceil(9 * sigma_px) <= LARGEST  # no sum of normal numbers goes as far as 9 sigma
    rows = _moved(down, sigma_px, short=short)
    rows += np.arange(height, dtype=rows.dtype)[:, None]
    columns = _moved(right, sigma_px, short=short)
    columns += np.arange(width, dtype=columns.dtype)
    return _kept(rows, height), _kept(columns, width)


def taken(
    image: NDArray[np.float32], rows: NDArray[np.signedinteger], columns: NDArray[np.signedinteger]
) -> NDArray[np.float32]:
    """Return image[rows, columns], in a fifth of the time for places of 16 bits, in a third for others."""
    import cv2

    if rows.dtype == np.int16:
        places = cv2.merge([columns, rows])
        return np.asarray(cv2.remap(image, places, np.empty(0), cv2.INTER_NEAREST), np.float32).reshape(rows.shape)
    flat = rows * np.int32(image.shape[1])
    flat += columns
    return image.reshape(-1).take(flat)


def _moved(draws: Draws, sigma_px: float, *, short: bool) -> NDArray[np.signedinteger]:
    if draws.dtype == np.uint16:
        steps = look_up(draws.view(np.uint16), _steps(sigma_px))
        return steps if short else steps.astype(np.int32)
    steps = scaled(draws, sigma_px)
    return np.rint(steps, out=steps).astype(np.int16 if short else np.int32)


@lru_cache(maxsize=8)
def _steps(sigma_px: float) -> NDArray[np.int16]:
    return np.floor(normal_quantiles() * sigma_px + 0.5).astype(np.int16)


def _kept(places: NDArray[np.signedinteger], count: int) -> NDArray[np.signedinteger]:
    np.clip(places, 0, count - 1, out=places)
    return places
