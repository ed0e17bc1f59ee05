# SPDX-License-Identifier: GPL-3.0-or-later
"""The noise of an image sensor, from light to numbers: photons, dark current, reading, gain, black level and bits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket, Value
from ...core.schema import key
from ...core.srgb import decoded, encoded
from ...core.streams import stream
from ..groups import HALF, ROUNDING, SEEDS, Canvas
from ..kinds import About, ByFrame, ColourPerturbation, Example, FrameContext, Nodes
from ._arrays import QUICK_NOISE, QUICKLY, by_bands, quick_key
from ._noise import CODES, look_up, normal_quantile, poisson_quantile, scaled_normal, uniform_codes

# Grain larger than a pixel: normal numbers of variance 1 that neighbours share in part.


SIGMA = 0.5  # of the Gaussian that makes it, over its size; chosen
WIDTHS = 3  # at how many sigmas that is cut off


def grain(context: FrameContext, shape: tuple[int, int], size_px: float) -> NDArray[np.float32]:
    """Return (H, W, 3) normal numbers: white ones through a Gaussian kernel, by the root of its squares' sum.

    They are drawn beyond the border, so the border is as all else.
    """
    import cv2

    sigma = SIGMA * size_px
    reach = int(np.ceil(WIDTHS * sigma))
    weights = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / sigma))
    weights /= np.sqrt(np.square(weights).sum())
    wide = (shape[0] + 2 * reach, shape[1] + 2 * reach, 3)
    white = look_up(uniform_codes(context.pattern_stream("grain"), wide), scaled_normal(1.0))
    soft = np.asarray(cv2.sepFilter2D(white, -1, weights, weights), np.float32)
    return np.ascontiguousarray(soft[reach : reach + shape[0], reach : reach + shape[1]])


# A sensor's noise as nodes: the same sums as on arrays, of numbers that White Noise draws at each pixel.


PHOTONS, READING, ROWS, HOT, GRAIN = range(5)  # purposes of random numbers
NO_GRAIN = 1.0 + 1e-6  # of its size: up to here each pixel is by itself
MOST_SHARE = 1e-9  # least share of hot pixels that is divided by


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Count electrons, read them, and make numbers of them."""
    graph = canvas.graph
    with graph.section("Electrons of white"):
        gain = graph.math("POWER", 10.0, given["gain_db"] * (1 / 20))
        white = given["full_well_electrons"] / gain
        full_at = graph.math("POWER", 2.0, graph.math("MULTIPLY", given["headroom_stops"], canvas.lit))
    with graph.section("Dark current and hot pixels"):
        seconds = given["exposure_ms"] * (1 / 1000)
        dark = given["dark_electrons_per_s"] * seconds
        hot = _hot(canvas, given, seconds)
    with graph.section("Light in electrons"):
        light = graph.math("MAXIMUM", canvas.image, 0.0)
        mean = graph.math("MULTIPLY_ADD", light, _wide(white / full_at), hot + _wide(dark))
    electrons = _read(canvas, given, mean)
    with graph.section("Numbers"):
        return _numbers(electrons, given, white) * _wide(full_at)


def _wide(value: Socket) -> Socket:
    return value.graph.vector(value, value, value)


def _hot(canvas: Canvas, given: Mapping[str, Socket], seconds: Socket) -> Socket:
    """Return the mean number of electrons that hot pixels have beside others: exponentially distributed."""
    graph = canvas.graph
    assert canvas.key is not None, "its group is seeded"
    share = given["hot_percent"] * (1 / 100)
    kept = replace(canvas, seed=given["sensor"], key=canvas.key * 0.0)
    drawn = kept.random(HOT, canvas.position_px) / _wide(graph.math("MAXIMUM", share, MOST_SHARE))
    within = graph.math("MINIMUM", drawn, (1.0, 1.0, 1.0))
    most = given["hot_electrons_per_s"] * seconds
    parts = [graph.math("LOGARITHM", part, math.e) for part in (within.x, within.y, within.z)]
    return graph.vector(*parts) * _wide(most * -1.0)


def _read(canvas: Canvas, given: Mapping[str, Socket], mean: Socket) -> Socket:
    """Return the electrons that are read, rows' own too: each pixel by itself, or softly where the grain is larger."""
    graph = canvas.graph
    noise = given["read_noise_electrons"]
    soft = given["grain_px"] / canvas.scale > NO_GRAIN
    with graph.section("Photons and reading"):
        # One of the two is asked for a single value, which takes no time.
        position = graph.choose(soft, (0.0, 0.0, 0.0), canvas.position_px, "vector")
        counted = poisson_quantile(graph.choose(soft, 0.0, mean, "vector"), canvas.random(PHOTONS, position))
        single = graph.math("MULTIPLY_ADD", normal_quantile(canvas.random(READING, position)), _wide(noise), counted)
    with graph.section("Grain"):
        grain = _grain(canvas, given["grain_px"], soft)
        asked = graph.choose(soft, mean, 0.0, "vector")
        spread = graph.math("POWER", asked + _wide(noise * noise), 0.5)
        shared = graph.math("MULTIPLY_ADD", spread, grain, asked)
    with graph.section("What is read"):
        return graph.choose(soft, shared, single, "vector") + _wide(_rows(canvas, given))


def _rows(canvas: Canvas, given: Mapping[str, Socket]) -> Socket:
    """Return what all pixels of a row share: of one column, which is then looked up at each pixel."""
    graph = canvas.graph
    column = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(1.0, canvas.height_px)}).out("Image", "color")
    place = graph.vector(0.0, _place(canvas, column, 0.0).y)
    drawn = normal_quantile(_wide(canvas.random_value(ROWS, place))).x * given["row_noise_electrons"]
    share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
    where = graph.math("MULTIPLY_ADD", share, (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    inputs = {"Image": drawn, "UV": where, "Interpolation": "Nearest", "Extension X": "Extend", "Extension Y": "Extend"}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "color").r


def _numbers(electrons: Socket, given: Mapping[str, Socket], white: Socket) -> Socket:
    """Return what a converter makes of electrons: 1 is its last number."""
    graph = electrons.graph
    last = graph.math("ROUND", graph.math("POWER", 2.0, given["bits"])) - 1.0
    black = graph.math("MINIMUM", (given["black_level"] * last + ROUNDING) - ROUNDING, last - 1.0)
    exact = graph.math("MULTIPLY_ADD", electrons, _wide((last - black) / white), _wide(black))
    rounded = (graph.clamp(exact, 0.0, _wide(last)) + ROUNDING) - ROUNDING
    taken = graph.choose(given["subtract_black"], black, 0.0, "float")
    return graph.math("MAXIMUM", (rounded - _wide(taken)) / _wide(last - taken), 0.0)


# --- grain larger than a pixel ---


def _grain(canvas: Canvas, size: Socket, soft: Socket) -> Socket:
    """Return normal numbers of variance 1 that neighbours share in part, drawn beyond the border; 0 without grain."""
    graph = canvas.graph
    sigma = size * SIGMA
    border = graph.math("CEIL", sigma * float(WIDTHS))
    twice = border * 2.0
    wide = graph.vector(canvas.width_px + twice, canvas.height_px + twice)
    blank = graph.choose(soft, wide, (1.0, 1.0, 0.0), "vector")
    image = graph.node("CompositorNodeBlankImage", {"Size": blank}).out("Image", "color")
    white = normal_quantile(canvas.random(GRAIN, _place(canvas, image, border)))
    inputs = {"Image": white, "Size": _wide(sigma * float(WIDTHS)), "Type": "Gaussian", "Separable": True}
    blurred = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    size_px = {"X": border, "Y": border, "Width": canvas.width_px, "Height": canvas.height_px}
    cut = graph.node("CompositorNodeCrop", {"Image": blurred, **size_px, "Alpha Crop": False}).out("Image", "color")
    return graph.choose(soft, cut, 0.0) * _wide(_strength(sigma, border))


def _place(canvas: Canvas, image: Socket, border: Value) -> Socket:
    """Return each pixel's place as `position_px` does, on an image that is wider on all sides."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
    each = graph.math("DIVIDE", 1.0, canvas.scale)
    left, top = graph.math("SUBTRACT", 0.5, border), canvas.height_px + border - 0.5
    first = graph.vector(left * each - HALF, top * each - HALF)
    place = graph.math("MULTIPLY_ADD", pixel, graph.vector(each, each * -1.0), first)
    return (place + ROUNDING) - ROUNDING


def _strength(sigma: Socket, border: Socket) -> Socket:
    """Return by how much white noise of variance 1 is weakened by a Gaussian that is cut off at the border, inversely.

    Along one axis the variance is the sum of squared weights over the square of their sum; of two axes the square of
    that, so its root is what one axis has. Sums over whole numbers are those integrals with their next harmonics
    (Poisson's summation), less the tail (Laplace's series).
    """
    graph = sigma.graph

    def harmonics(rate: float, count: int) -> Value:
        square = sigma * sigma
        total: Value = 1.0
        for number in range(1, count + 1):
            total = graph.math("MULTIPLY_ADD", graph.math("EXPONENT", square * (-rate * number**2)), 2.0, total)
        return total

    far = (border + 0.5) / sigma
    back = graph.math("DIVIDE", 1.0, far * far)
    series = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", back, 3.0, -1.0), back, 1.0)
    tail = graph.math("EXPONENT", far * far * -0.5) / far * series * (2 / math.sqrt(2 * math.pi))
    total = sigma * math.sqrt(2 * math.pi) * (graph.math("SUBTRACT", harmonics(2 * math.pi**2, 1), tail))
    squares = sigma * math.sqrt(math.pi) * harmonics(math.pi**2, 2)
    return total * total / squares


MS_PER_S = 1000.0
FEW = 8.0  # mean number of electrons below which Poisson's law itself is drawn; chosen
MOST = 40  # electrons of what has fewer than that on average: more come once in 1e14 times


@dataclass(frozen=True)
class SensorNoise:
    """Electrons, as EMVA Standard 1288 counts them, in linear light: Poisson's law, read noise, gain and steps.

    A white pixel gives as many electrons as the full well over the gain: what more gain means is less light. Its number
    is black level + K x electrons, rounded, within the bits that there are; K is what brings white to the last one.
    Variance over mean is a line of slope K, and read noise and steps of numbers where it begins. Red, green and blue
    have a sensor each.
    """

    gain_db: float = key(
        "how much less light the sensor gets, made up for by gain; auto_exposure adds its own",
        default=20.8,
        unit="dB",
        minimum=0,
        maximum=72,
    )
    full_well_electrons: float = key(
        "electrons of a pixel that is full, white at no gain",
        default=10_000.0,
        minimum=10,
        maximum=1e6,
        label="Full Well",
    )
    read_noise_electrons: float = key(
        "standard deviation of reading a pixel, at its input", default=0.99, minimum=0, maximum=1000, label="Read Noise"
    )
    dark_electrons_per_s: float = key("dark current of a pixel", default=10.0, unit="1/s", minimum=0, maximum=1e6)
    exposure_ms: float = key(
        "how long the dark current gathers; auto_exposure says its own", default=10.0, unit="ms", minimum=0, maximum=1e4
    )
    hot_percent: float = key(
        "share of pixels that are hot, in a channel", default=0.002, unit="%", minimum=0, maximum=100
    )
    hot_electrons_per_s: float = key(
        "mean dark current of hot pixels, exponentially distributed", default=2e4, unit="1/s", minimum=0, maximum=1e9
    )
    row_noise_electrons: float = key(
        "standard deviation of what all pixels of a row share, drawn for each frame",
        default=0.2,
        minimum=0,
        maximum=1000,
        label="Row Noise",
    )
    black_level: float = key("black's number over the largest one", default=0.0625, minimum=0, maximum=0.5)
    subtract_black: bool = key(
        "the black level is taken off again, as a finished image has it", default=True, label="Without Black"
    )
    bits: int = key("bits of the numbers", default=10, minimum=1, maximum=16)
    grain_px: float = key(
        "size of the grain: 1 is a sensor's, each pixel by itself; larger is soft, as film",
        default=1.0,
        unit="px",
        minimum=1,
        maximum=64,
    )
    headroom_stops: float = key(
        "on lit scenes, how far above white the sensor is full; elsewhere it is full at white",
        default=4.0,
        minimum=0,
        maximum=16,
    )
    even_steps: bool = key(
        "severities make noise grow by equal steps, to gain of 30 dB, instead of equal ratios, to 41.6 dB",
        default=False,
        later=True,
    )
    coarse: bool = quick_key()
    sensor: int = key("which one of its kind: it decides where hot pixels are", default=0, minimum=0, maximum=2**31 - 1)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "gain_db": "Higher: a darker scene, so stronger noise",
        "full_well_electrons": "Higher: less noise in what is light, as of larger pixels",
        "read_noise_electrons": "Higher: more noise in what is dark",
        "dark_electrons_per_s": "Higher: a warmer sensor, with more noise in what is dark",
        "exposure_ms": "Higher: hot pixels get brighter",
        "hot_percent": "Higher: more pixels are brighter than they should be, always the same ones",
        "hot_electrons_per_s": "Higher: hot pixels get brighter",
        "row_noise_electrons": "Higher: rows are lighter and darker by chance",
        "black_level": "Higher: less of the noise in black is cut off",
        "subtract_black": "Off: black is gray, as of a raw image",
        "bits": "Lower: colors in visible steps",
        "grain_px": "Higher: soft and large grain",
        "headroom_stops": "Lower: what shines is cut off earlier",
        "even_steps": "On: from one severity to the next noise grows by as much; off: it nearly doubles",
        "coarse": QUICK_NOISE,
        "sensor": "Another number: hot pixels are elsewhere",
    }


def apply(rgb: NDArray[np.float32], parameters: SensorNoise, context: FrameContext) -> NDArray[np.float32]:
    """Take (H, W, 3) with a sensor."""
    seconds = exposure_ms(parameters, context) / MS_PER_S
    gain = 10.0 ** (gain_db(parameters, context) / 20.0)
    full_at = 2.0**parameters.headroom_stops if context.lit else 1.0
    white_electrons = parameters.full_well_electrons / gain
    drawn = _Drawn(parameters, context, rgb.shape[:2])
    hot = _hot_electrons(parameters, context, rgb.shape[:2], seconds)
    dark = np.float32(parameters.dark_electrons_per_s * seconds)

    def taken(
        band: NDArray[np.float32], hot_band: NDArray[np.float32], *others: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        electrons = decoded(np.maximum(band, np.float32(0)))
        electrons *= np.float32(white_electrons / full_at)
        electrons += hot_band
        electrons += dark
        electrons = drawn.counted(electrons, *others)
        light = numbers_of(electrons, parameters, white_electrons)
        light *= np.float32(full_at)
        return encoded(np.maximum(light, np.float32(0)))

    return by_bands(rgb, rgb.dtype, taken, hot, *drawn.fields)


def exposure_ms(parameters: SensorNoise, context: FrameContext) -> float:
    """Return for how long the dark current gathers in a frame."""
    return context.decided.get("exposure_ms", parameters.exposure_ms)


def gain_db(parameters: SensorNoise, context: FrameContext) -> float:
    """Return all gain of a frame."""
    return parameters.gain_db + context.decided.get("gain_db", 0.0)


def told(parameters: SensorNoise, context: FrameContext) -> Mapping[str, float]:
    """Return the parameters that its node group is told for a frame. Where hot pixels are has a seed of its own."""
    hot = stream(int(context.identifiers[0]), "sensor_noise", "hot pixels", parameters.sensor, "compositor")
    return {
        "gain_db": gain_db(parameters, context),
        "exposure_ms": exposure_ms(parameters, context),
        "headroom_stops": parameters.headroom_stops if context.lit else 0.0,
        "sensor": int(hot.integers(SEEDS)),
    }


def numbers_of(electrons: NDArray[np.float32], parameters: SensorNoise, white_electrons: float) -> NDArray[np.float32]:
    """Return what a converter makes of electrons, from 0 (black) to 1 (its last number); below 0 under black."""
    last = 2**parameters.bits - 1
    black = min(round(parameters.black_level * last), last - 1)
    numbers = electrons * np.float32((last - black) / white_electrons)
    numbers += np.float32(black)
    np.clip(np.rint(numbers, out=numbers), 0, last, out=numbers)
    if not parameters.subtract_black:
        return numbers * np.float32(1 / last)
    numbers -= np.float32(black)
    return numbers * np.float32(1 / (last - black))


class _Drawn:
    """What is drawn for a frame: bands are counted from the top down. fields: images that a band is counted with."""

    def __init__(self, parameters: SensorNoise, context: FrameContext, shape: tuple[int, int]) -> None:
        self._read = parameters.read_noise_electrons
        self._photons, self._reading = (context.pattern_stream(name) for name in ("photons", "reading"))
        rows = look_up(uniform_codes(context.pattern_stream("rows"), (shape[0], 1)), scaled_normal(1.0))
        rows = (rows * np.float32(parameters.row_noise_electrons)).reshape(-1, 1, 1)
        self.fields: tuple[NDArray[np.float32], ...] = (rows,)
        if parameters.grain_px > 1:
            self.fields += (grain(context, shape, parameters.grain_px),)

    def counted(
        self, mean: NDArray[np.float32], rows: NDArray[np.float32], soft: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Return as many electrons of a band as are read, of their mean number."""
        if soft is not None:
            found = np.sqrt(mean + np.float32(self._read**2))
            found *= soft
            found += mean
        else:
            found = poisson(mean, uniform_codes(self._photons, mean.shape))
            noise = look_up(uniform_codes(self._reading, mean.shape), scaled_normal(1.0))
            noise *= np.float32(self._read)
            found += noise
        return np.add(found, rows, out=found)


def poisson(mean: NDArray[np.float32], codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return numbers with Poisson's law about a mean, one for each code: by inversion where they are few.

    Elsewhere by Cornish's and Fisher's expansion (1938), which has his mean, variance, skewness and kurtosis and is not
    rounded to whole numbers. Each number depends on its own mean and code alone.
    """
    normal = look_up(codes, scaled_normal(1.0))
    root = np.sqrt(np.maximum(mean, np.float32(FEW)))
    square = normal * normal
    found = normal * root
    found += (square - np.float32(1)) * np.float32(1 / 6)
    found += normal * (np.float32(1) - square) / (root * np.float32(72))
    found += mean
    few = mean < np.float32(FEW)
    if few.any():
        found[few] = _inverted(mean[few], codes[few])
    return found


def _inverted(mean: NDArray[np.float32], codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return (N,) the numbers below which Poisson's law of a mean (N,) has the probability of a code (N,)."""
    uniform = (codes.astype(np.float32) + np.float32(0.5)) * np.float32(1 / CODES)
    found = np.zeros_like(mean)
    places = np.arange(len(mean))
    chance = np.exp(-mean)
    total = chance.copy()
    for number in range(1, MOST):
        more = uniform >= total
        if not more.any():
            break
        places = places[more]
        mean, uniform, chance, total = (part[more] for part in (mean, uniform, chance, total))
        found[places] = number
        chance = chance * mean / np.float32(number)
        total = total + chance
    return found


def _hot_electrons(
    parameters: SensorNoise, context: FrameContext, shape: tuple[int, int], seconds: float
) -> NDArray[np.float32]:
    """Return (H, W, 3): the mean number of electrons that hot pixels have beside others."""
    found = np.zeros((*shape, 3), np.float32)
    places, rates = hot_pixels(int(context.identifiers[0]), parameters.sensor, shape, parameters.hot_percent)
    found.reshape(-1)[places] = rates * (parameters.hot_electrons_per_s * seconds)
    return found


@lru_cache(maxsize=8)
def hot_pixels(
    seed: int, sensor: int, shape: tuple[int, int], percent: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return where in (H, W, 3), flat, a sensor's hot pixels are, (N,), and their dark current over its mean, (N,).

    seed: the preset's; scenes and settings have the same sensor.
    """
    generator = stream(seed, "sensor_noise", "hot pixels", sensor)
    values = shape[0] * shape[1] * 3
    places = generator.permutation(values)[: round(values * percent / 100)]
    return places, generator.exponential(size=len(places))


# By equal steps: the deviation of photons goes as the root of gain, 10^(dB / 40). Severities 1 and 3 are as they were,
# so it is 1, 2.16, 3.31, 4.47 and 5.62 times that of severity 1. The read noise is on the same line as before.
EVEN_GAIN_DB = (0.0, 13.34, 20.8, 26.0, 29.99)
EVEN_READ = (0.8, 0.916, 0.99, 1.041, 1.085)

PERTURBATION = ColourPerturbation(
    name="sensor_noise",
    label="Sensor noise",
    stage="sensor",
    order=6,
    parameters=SensorNoise,
    severities={
        "gain_db": (0.0, 10.4, 20.8, 31.2, 41.6),
        "read_noise_electrons": (0.8, 0.89, 0.99, 1.1, 1.22),
    },
    other_severities={"even_steps": {"gain_db": EVEN_GAIN_DB, "read_noise_electrons": EVEN_READ}},
    newly={"even_steps": True, **QUICKLY},
    source=(
        "our own: the range of shot noise of Brooks and others (Unprocessing images for learned raw denoising, 2019) "
        "in equal ratios, with the read noise of their line, for a full well of 10,000 electrons; model: EMVA 1288"
    ),
    about=About(
        "Counts light in electrons, and reads them with noise, gain and a few bits",
        "electrons, dark current, read noise, gain, black level and bits, by EMVA 1288",
        example=Example(render="{backend: reference}"),
    ),
    apply=apply,
    temporals=("fresh", "fixed"),
    grain=True,
    on_light=True,
    nodes=Nodes(build, linear=True, by_frame=ByFrame({}, told)),
)
