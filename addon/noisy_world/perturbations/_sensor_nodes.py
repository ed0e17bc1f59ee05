# SPDX-License-Identifier: GPL-3.0-or-later
"""A sensor's noise as nodes: the same sums as on arrays, of numbers that White Noise draws at each pixel."""

import math
from collections.abc import Mapping
from dataclasses import replace

from ..core.node_graphs.graph import Socket, Value
from ..core.node_graphs.groups import HALF, ROUNDING, Canvas
from ._grain import SIGMA, WIDTHS
from ._quantile_groups import normal_quantile, poisson_quantile

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
    within = kept.random(HOT, canvas.position_px) / _wide(graph.math("MAXIMUM", share, MOST_SHARE))
    most = given["hot_electrons_per_s"] * seconds
    parts = [
        graph.math("LOGARITHM", graph.math("MINIMUM", part, 1.0), math.e) for part in (within.x, within.y, within.z)
    ]
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
        spread = graph.math("POWER", mean + _wide(noise * noise), 0.5)
        shared = graph.math("MULTIPLY_ADD", spread, grain, mean)
    with graph.section("What is read"):
        return graph.choose(soft, shared, single, "vector") + _wide(_rows(canvas, given))


def _rows(canvas: Canvas, given: Mapping[str, Socket]) -> Socket:
    """Return what all pixels of a row share."""
    graph = canvas.graph
    row = canvas.random_value(ROWS, graph.vector(0.0, canvas.position_px.y))
    return normal_quantile(_wide(row)).x * given["row_noise_electrons"]


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
    white = normal_quantile(canvas.random(GRAIN, _beyond(canvas, image, border)))
    inputs = {"Image": white, "Size": _wide(sigma * float(WIDTHS)), "Type": "Gaussian", "Separable": True}
    blurred = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    size_px = {"X": border, "Y": border, "Width": canvas.width_px, "Height": canvas.height_px}
    cut = graph.node("CompositorNodeCrop", {"Image": blurred, **size_px, "Alpha Crop": False}).out("Image", "color")
    return graph.choose(soft, cut, 0.0) * _wide(_strength(sigma, border))


def _beyond(canvas: Canvas, image: Socket, border: Socket) -> Socket:
    """Return each pixel's place as `position_px` does, on an image that is wider on all sides."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
    each = graph.math("DIVIDE", 1.0, canvas.scale)
    first = graph.vector((0.5 - border) * each - HALF, (canvas.height_px + border - 0.5) * each - HALF)
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
