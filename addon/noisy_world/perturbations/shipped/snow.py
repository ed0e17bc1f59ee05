# SPDX-License-Identifier: GPL-3.0-or-later
"""Snow: falling flakes before a whitened scene."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import (
    QUICKLY,
    Level,
    colour_by_bands,
    correlate,
    kept_for_sequence,
    line_kernel,
    quick_key,
    three_channels,
    torus_window,
)
from ._sizes import FullSize, coarser, full_size, with_full_sizes


@dataclass(frozen=True)
class Snow:
    """Two layers of streaked flakes, one the other turned by 180 degrees, over the whitened image, as ImageNet-C.

    The flakes are what is bright in an enlarged field of normal noise, over the whole frame.
    """

    mean: float = key("mean of the noise", default=0.55, minimum=-1, maximum=2)
    std: float = key("standard deviation of the noise", default=0.3, minimum=0, maximum=2)
    scale: float = key("how much the noise is enlarged", default=4.0, minimum=1, maximum=50)
    threshold: float = key("what is darker than this is no flake", default=0.9, minimum=-1, maximum=2)
    blur_radius_px: int = key("a streak has 2 radius + 1 pixels", default=12, unit="px", minimum=0, maximum=100)
    blur_sigma_px: float = key("standard deviation of its weights", default=8.0, unit="px", above=0, maximum=200)
    blending_ratio: float = key("share of the image, the rest being whitened", default=0.7, minimum=0, maximum=1)
    fall_px: float = key(
        "drift: how far the flakes fall a frame", default=12.0, unit="px", minimum=0, maximum=1000, slider=(0, 100)
    )
    coarse: bool = quick_key("draw flakes at half the frame's size: softer ones, in a third of the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "mean": "Higher: more flakes",
        "std": "Higher: flakes differ more in brightness",
        "scale": "Higher: larger flakes, and fewer",
        "threshold": "Lower: more flakes",
        "blur_radius_px": "Higher: longer streaks behind the flakes",
        "blur_sigma_px": "Higher: the streaks fade less toward their ends",
        "blending_ratio": "Lower: the picture itself gets whiter, as in thick snowfall",
        "fall_px": "Higher: with the pattern Drift, the flakes fall faster",
        "coarse": "On: softer flakes, in a third of the time",
    }


def apply(rgb: NDArray[Level], parameters: Snow, context: FrameContext) -> NDArray[Level]:
    """Let it snow on (H, W, 3)."""

    def snowed_on(band: NDArray[np.float32], flakes: NDArray[np.float32]) -> NDArray[np.float32]:
        image = _whitened(band, parameters.blending_ratio)
        return np.add(image, three_channels(flakes), out=image)

    return colour_by_bands(rgb, snowed_on, _flakes(rgb.shape[:2], parameters, context))


def _whitened(rgb: NDArray[np.float32], ratio: float) -> NDArray[np.float32]:
    import cv2

    grey = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.float32)
    grey *= np.float32(1.5)
    grey += np.float32(0.5)
    white = three_channels(grey)
    np.maximum(white, rgb, out=white)
    return np.asarray(cv2.addWeighted(rgb, ratio, white, 1 - ratio, 0.0, dst=white), np.float32)


def _flakes(size: tuple[int, int], parameters: Snow, context: FrameContext) -> NDArray[np.float32]:
    """Return the sum of both layers of flakes, (H, W)."""
    import cv2

    noise, angle_deg = _noise(context, _cells(size, parameters.scale))
    fallen_px = context.drift_frames * parameters.fall_px
    layer = _layer(size, noise, angle_deg, parameters, fallen_px)
    # The second layer is turned by 180 degrees at the end, so it has to rise here to fall there.
    other = _layer(size, noise, angle_deg, parameters, -fallen_px) if fallen_px else layer
    both = layer + other[::-1, ::-1]
    return np.asarray(cv2.resize(both, size[::-1]), np.float32) if parameters.coarse else both


def _layer(
    size: tuple[int, int], noise: NDArray[np.float32], angle_deg: float, parameters: Snow, fallen_px: float
) -> NDArray[np.float32]:
    """Return (H, W): the flakes of this noise, streaked along the angle, moved along it by `fallen_px`.

    size: H and W; what it returns has half of them where the parameters say so.
    """
    # The noise's first and last points lie at the frame's outermost pixels.
    step_y, step_x = ((cells - 1) / max(pixels - 1, 1) for cells, pixels in zip(noise.shape, size, strict=True))
    start = (-fallen_px * step_y, -fallen_px * step_x / math.tan(math.radians(angle_deg)))
    radius_px, sigma_px = parameters.blur_radius_px, parameters.blur_sigma_px
    if parameters.coarse:
        half = (size[0] + 1) // 2, (size[1] + 1) // 2
        wide = size[0] / half[0], size[1] / half[1]
        start = start[0] + (wide[0] - 1) / 2 * step_y, start[1] + (wide[1] - 1) / 2 * step_x
        size, step_y, step_x = half, step_y * wide[0], step_x * wide[1]
        radius_px, sigma_px = math.floor(radius_px / wide[1] + 0.5), sigma_px / wide[1]
    layer = torus_window(noise, size, (step_y, step_x), start)
    layer *= np.float32(parameters.std)
    layer += np.float32(parameters.mean)
    layer *= layer >= np.float32(parameters.threshold)
    np.clip(layer, 0.0, 1.0, out=layer)
    return correlate(layer, line_kernel(radius_px, sigma_px, angle_deg))


def _cells(size: tuple[int, int], scale: float) -> tuple[int, int]:
    return math.ceil(size[0] / scale), math.ceil(size[1] / scale)


@kept_for_sequence
def _noise(context: FrameContext, cells: tuple[int, int]) -> tuple[NDArray[np.float32], float]:
    """Return standard normal noise of this many rows and columns, and the fall's angle in degrees (as ImageNet-C)."""
    generator = context.pattern_stream()
    angle_deg = generator.uniform(-135.0, -45.0)
    noise = generator.standard_normal(cells, dtype=np.float32)
    noise.flags.writeable = False
    return noise, angle_deg


# --- as a node group ---
#
# The columns are sheared so that every streak is vertical and its steps are whole rows. The channels of an image a
# third as high hold three rows at a time, so that one gather fetches three steps.

_ROWS = 3  # one for each channel
_GREY = (0.299, 0.587, 0.114)  # luma of ITU-R BT.601, as OpenCV's grey
_LEAN_DEG = 45.0  # greatest lean of the streaks from vertical, as ImageNet-C (-135 to -45 degrees)
# Between two columns, 0 takes the nearest (jagged streaks) and 1 interpolates (soft ones). Fitted: 0.2 gives the
# spectrum of the reference.
_SOFTNESS = 0.2


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Add two layers of streaked flakes, one of them turned, to the whitened image; a preview's are of full size."""
    graph, image = canvas.graph, canvas.image
    full = full_size(canvas)
    sized = with_full_sizes(full, given, "blur_radius_px", "blur_sigma_px", "fall_px")
    flakes = full.back(_sized_layers(full, sized, served))
    with graph.section("Whiten"):
        grey = graph.math("MULTIPLY_ADD", graph.math("DOT_PRODUCT", image, _GREY), 1.5, 0.5)
        white = graph.math("MAXIMUM", image, grey)
        whitened = graph.mix(white, image, given["blending_ratio"])
    with graph.section("Snow on it"):
        return whitened + flakes


def _sized_layers(full: FullSize, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Return the sum of both layers at the frame's size; quickly, made at half of it."""
    graph, quick = full.canvas.graph, given["coarse"]
    drawn = coarser(full.canvas, quick)
    with graph.section("Size of the flakes"):
        own = graph.node("CompositorNodeImageCoordinates", {"Image": drawn.blank}).out("Pixel", "vector")
        pixel = graph.choose(quick, own, full.pixel, "vector")
        times = drawn.scale / full.canvas.scale
        sized = {name: given[name] * times for name in ("blur_radius_px", "blur_sigma_px", "fall_px")}
        sized["blur_radius_px"] = graph.choose(
            quick, graph.math("FLOOR", sized["blur_radius_px"] + 0.5), given["blur_radius_px"], "float"
        )
    canvas = replace(full.canvas, width_px=drawn.width_px, height_px=drawn.height_px, scale=drawn.scale)
    layers = _both_layers(canvas, pixel, {**given, **sized}, served)
    with graph.section("Flakes at the frame's size"):
        return drawn.back(layers)


def _both_layers(canvas: Canvas, pixel: Socket, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Return the sum of both layers; pixel: each pixel's column and row, from below."""
    graph = canvas.graph
    with graph.section("Noise"):
        size_px = graph.vector(canvas.width_px, canvas.height_px)
        full_px = graph.math("ROUND", size_px / graph.vector(canvas.scale, canvas.scale))
        enlarged = graph.vector(given["scale"], given["scale"])
        cells = graph.math("CEIL", graph.math("SUBTRACT", full_px / enlarged, (1e-4, 1e-4, 0.0)), label="Cells")
        noise = _normal_noise(canvas, cells)
        # From pixels of the input image to fractions of the noise's sides; its outermost points lie at the borders.
        reach_px = graph.math("MAXIMUM", full_px - (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))
        step = (cells - (1.0, 1.0, 0.0)) / reach_px / cells
        zoom = step / graph.vector(canvas.scale, canvas.scale)
        half = graph.math("SUBTRACT", 0.5, graph.math("DIVIDE", 0.5, canvas.scale))
        first = graph.math("SUBTRACT", (0.5, 0.5, 0.0) / cells, step * graph.vector(half, half))
        corner = graph.math("ADD", first, (0.0, 0.0, 1.0), label="Where the first pixel lies")
    with graph.section("Fall"):
        lean = (canvas.random_value(1) - 0.5) * math.radians(2 * _LEAN_DEG)
        slope = graph.math("TANGENT", lean, label="Columns a row")
        stretch = graph.math("DIVIDE", 1.0, graph.math("COSINE", lean), label="Pixels a row")
        fallen_px = canvas.drift_frames * given["fall_px"]
        drifts = graph.math("ABSOLUTE", fallen_px) > 0.0
    with graph.section("Flakes"):
        inputs = {
            "Noise": noise,
            "Zoom": zoom,
            "Corner": corner,
            "Whole": graph.math("COMPARE", cells.x, full_px.x, 0.5),
            "Slope": slope,
            "Stretch": stretch,
            "Mean": given["mean"],
            "Standard deviation": given["std"],
            "Threshold": given["threshold"],
            "Radius": given["blur_radius_px"],
            "Sigma": given["blur_sigma_px"],
        }
        part = _layer_graph(math.ceil(served["blur_radius_px"]))
        here = {"Pixel": pixel, "Size": size_px, "Fallen": fallen_px}
        layer = graph.group(part, inputs | here, name="Layer").out("Flakes", "float")
        # The second layer is turned by 180 degrees below, so it rises here. Without drift both are the same layer, so
        # the rising one is made tiny and not used.
        where = graph.choose(drifts, pixel, (0.0, 0.0, 0.0), "vector")
        there = {"Pixel": where, "Size": size_px * graph.vector(drifts, drifts), "Fallen": -fallen_px}
        rising = graph.group(part, inputs | there, name="Rising layer").out("Flakes", "float")
        other = graph.choose(drifts, rising, layer, "float")
        turned = graph.node("CompositorNodeFlip", {"Image": other, "Flip X": True, "Flip Y": True})
        return layer + turned.out("Image", "float")


def _normal_noise(canvas: Canvas, cells: Socket) -> Socket:
    """Return standard normal noise of `cells` (columns, rows), by Box and Muller's method (1958)."""
    graph = canvas.graph
    blank = graph.node("CompositorNodeBlankImage", {"Size": cells}).out("Image", "color")
    position = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
    random = canvas.random(0, position)
    distance = graph.math("SQRT", graph.math("LOGARITHM", graph.math("MAXIMUM", random.x, 1e-9), math.e) * -2.0)
    return distance * graph.math("COSINE", random.y * math.tau)


def _layer_graph(radius_px: int) -> Graph:
    """Describe a layer of flakes with streaks of up to 2 radius + 1 pixels."""
    steps = (2 * radius_px + _ROWS - 1) // _ROWS + 1
    graph = Graph(f"Snow Layer ({radius_px} px)", "Flakes out of noise, each with a streak along the fall")
    pixel = graph.input(GroupInput("Pixel", "vector", (0.0, 0.0, 0.0), "Each pixel's column and row, from below"))
    size_px = graph.input(GroupInput("Size", "vector", (1.0, 1.0, 0.0), "Width and height of the frame"))
    noise = graph.input(GroupInput("Noise", "float", 0.0, "Standard normal noise"))
    zoom = graph.input(GroupInput("Zoom", "vector", (0.0, 0.0, 0.0), "Sides of the noise that a pixel spans"))
    corner = graph.input(GroupInput("Corner", "vector", (0.0, 0.0, 1.0), "Where in the noise the first pixel lies"))
    whole = graph.input(GroupInput("Whole", "float", 0.0, "1 where the noise is not enlarged: it is not to be mixed"))
    slope = graph.input(GroupInput("Slope", "float", 0.0, "Columns that a streak leans by in a row"))
    stretch = graph.input(GroupInput("Stretch", "float", 1.0, "Length of a streak in a row"))
    fallen_px = graph.input(GroupInput("Fallen", "float", 0.0, "How far all flakes have fallen"))
    mean = graph.input(GroupInput("Mean", "float", 0.55, "Mean of the noise"))
    deviation = graph.input(GroupInput("Standard deviation", "float", 0.3, "Standard deviation of the noise"))
    threshold = graph.input(GroupInput("Threshold", "float", 0.9, "What is darker than this is no flake"))
    radius = graph.input(GroupInput("Radius", "float", 12.0, "A streak has 2 radius + 1 pixels"))
    sigma = graph.input(GroupInput("Sigma", "float", 8.0, "Standard deviation of its weights"))
    packed = graph.math("CEIL", size_px.y / float(_ROWS)) + float(steps - 1)
    with graph.section("Sheared columns, three rows in the channels"):
        positions = _packed_positions(graph, size_px, packed, slope, whole)
    with graph.section("Flakes"):
        shift = graph.math("MULTIPLY_ADD", graph.vector(slope * fallen_px, fallen_px), zoom, corner)
        rows = graph.vector(*(_noise_at(graph, noise, position, zoom, shift) for position in positions))
        bright = graph.math("MULTIPLY_ADD", rows, _thrice(graph, deviation), _thrice(graph, mean))
        inputs = {"Factor_Float": 1.0, "A_Color": bright, "B_Color": bright > _thrice(graph, threshold)}
        product = {"data_type": "RGBA", "blend_type": "MULTIPLY", "clamp_result": True}
        flakes = graph.node("ShaderNodeMix", inputs, product, label="Bright enough").out("Result_Color", "color")
    with graph.section("Streaks"):
        part = _step_graph()
        fade = graph.math("DIVIDE", -0.5, sigma * sigma)
        inputs = {"Flakes": flakes, "Stretch": stretch, "Length": radius * 2.0 + 0.5, "Fade": fade}
        parts = []
        for step in range(steps):
            before = parts[-1].out("Weights", "vector") if parts else (0.0, 0.0, 0.0)
            name = f"Rows {step * _ROWS} to {step * _ROWS + _ROWS - 1}"
            parts.append(graph.group(part, inputs | {"Step": float(step), "Weights before": before}, name=name))
        # The sum is positioned as its first operand is, so that is the rows that are not shifted.
        total, weight = parts[0].out("Rows", "vector"), parts[0].out("Weight", "float")
        for made in parts[1:]:
            total = total + made.out("Rows", "vector")
        for made in parts[1:]:
            weight = weight + made.out("Weight", "float")
    with graph.section("Upright columns leant again"):
        softness = graph.math("MULTIPLY_ADD", whole, -_SOFTNESS, _SOFTNESS)
        size = graph.vector(size_px.x, packed, 1.0)
        layer = _leant(graph, total / _thrice(graph, weight), pixel, slope=slope, softness=softness, size=size)
        graph.output("Flakes", layer, "float", "The layer")
    return graph


def _packed_positions(graph: Graph, size_px: Socket, packed: Socket, slope: Socket, whole: Socket) -> list[Socket]:
    """Return for each channel which pixel of the frame it shows; each channel is a row further along the streaks.

    Above the frame its uppermost row is repeated, as in the reference. Its left and right sides are joined.
    """
    packed_size = graph.vector(size_px.x, packed * (size_px.x > 0.0))
    blank = graph.node("CompositorNodeBlankImage", {"Size": packed_size}).out("Image", "color")
    position = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
    rows = graph.math("MULTIPLY_ADD", _thrice(graph, position.y), (float(_ROWS),) * 3, (0.0, 1.0, 2.0))
    leant = rows * _thrice(graph, slope)
    rounded = graph.math("FLOOR", graph.math("ADD", leant, (0.5, 0.5, 0.5)))
    columns = _thrice(graph, position.x) + graph.math("MULTIPLY_ADD", rounded - leant, _thrice(graph, whole), leant)
    width_px = _thrice(graph, graph.math("MAXIMUM", size_px.x, 1.0))
    columns = graph.math("WRAP", columns, width_px, (0.0, 0.0, 0.0), label="Columns of the frame")
    rows = graph.math("MINIMUM", rows, _thrice(graph, size_px.y - 1.0), label="Rows of the frame")
    return [graph.vector(getattr(columns, axis), getattr(rows, axis)) for axis in "xyz"]


def _noise_at(graph: Graph, noise: Socket, position: Socket, zoom: Socket, shift: Socket) -> Socket:
    inputs = {"Image": noise, "UV": graph.math("MULTIPLY_ADD", position, zoom, shift), "Interpolation": "Bilinear"}
    node = graph.node("CompositorNodeMapUV", inputs | {"Extension X": "Repeat", "Extension Y": "Repeat"})
    return node.out("Image", "float")


def _thrice(graph: Graph, value: Socket) -> Socket:
    return graph.vector(value, value, value)


def _leant(graph: Graph, packed: Socket, pixel: Socket, *, slope: Socket, softness: Socket, size: Socket) -> Socket:
    """Return the rows in the channels as one image again, each row shifted back by its shear."""
    row = pixel.y
    back = graph.math("MULTIPLY_ADD", graph.vector(row, row), graph.vector(-slope, 1 / _ROWS - 1), pixel)
    # Row numbers are multiples of 1/3, which a float cannot hold exactly: 0.1 keeps the floor right.
    whole = graph.math("FLOOR", graph.math("ADD", back, (0.5, 0.1, 0.0)), label="Nearest column, packed row")
    rest = back - whole
    at = graph.math("MULTIPLY_ADD", rest, graph.vector(softness, 0.0), whole)
    where = graph.math("DIVIDE", graph.math("ADD", at, (0.5, 0.5, 1.0)), size)
    inputs = {"Image": packed, "UV": where, "Interpolation": "Bilinear"}
    node = graph.node("CompositorNodeMapUV", inputs | {"Extension X": "Repeat", "Extension Y": "Extend"})
    third = rest.y
    chosen = graph.vector(*(graph.math("COMPARE", third, k / _ROWS, 0.1) for k in range(_ROWS)))
    return graph.math("DOT_PRODUCT", node.out("Image", "color"), chosen)


def _step_graph() -> Graph:
    """Describe what three rows (in the channels) add to the streaks of three other rows."""
    graph = Graph("Snow Step", "What three rows further up add to a streak: weights of a one-sided Gaussian")
    flakes = graph.input(GroupInput("Flakes", "color", (0.0, 0.0, 0.0, 1.0), "Three rows in the channels"))
    step = graph.input(GroupInput("Step", "float", 0.0, "How many times three rows further"))
    before = graph.input(GroupInput("Weights before", "vector", (0.0, 0.0, 0.0), "Of the three rows before"))
    stretch = graph.input(GroupInput("Stretch", "float", 1.0, "Length of a streak in a row"))
    length = graph.input(GroupInput("Length", "float", 24.5, "Length of the streak"))
    fade = graph.input(GroupInput("Fade", "float", -0.01, "-1 / (2 sigma^2)"))
    with graph.section("Rows further up"):
        inputs = {"Image": flakes, "Displacement": graph.vector(0.0, -step), "Interpolation": "Nearest"}
        node = graph.node("CompositorNodeDisplace", inputs | {"Extension X": "Extend", "Extension Y": "Extend"})
        further = node.out("Image", "color")
    with graph.section("Weights"):
        rows = graph.math("MULTIPLY_ADD", _thrice(graph, step), (3.0, 3.0, 3.0), (0.0, 1.0, 2.0))
        way = rows * _thrice(graph, stretch)
        power = graph.math("POWER", (math.e,) * 3, way * way * _thrice(graph, fade))
        weights = power * (way < _thrice(graph, length))
        graph.output("Weights", weights, "vector", "Of these rows")
        graph.output("Weight", graph.math("DOT_PRODUCT", weights, (1.0, 1.0, 1.0)), "float", "All of them")
    with graph.section("Seen from each of three rows"):
        first = graph.math("DOT_PRODUCT", further, weights)
        second = graph.math("DOT_PRODUCT", further, graph.vector(before.z, weights.x, weights.y))
        third = graph.math("DOT_PRODUCT", further, graph.vector(before.y, before.z, weights.x))
        graph.output("Rows", graph.vector(first, second, third), "vector", "Their part")
    return graph


PERTURBATION = ColourPerturbation(
    name="snow",
    label="Snow",
    stage="environment",
    order=40,
    parameters=Snow,
    newly=QUICKLY,
    severities={
        "mean": (0.1, 0.2, 0.55, 0.55, 0.55),
        "std": (0.3, 0.3, 0.3, 0.3, 0.3),
        "scale": (3, 2, 4, 4.5, 2.5),
        "threshold": (0.5, 0.5, 0.9, 0.85, 0.85),
        "blur_radius_px": (10, 12, 12, 12, 12),
        "blur_sigma_px": (4, 4, 8, 8, 12),
        "blending_ratio": (0.8, 0.7, 0.7, 0.65, 0.55),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Whitens the image and lays streaks of flakes over it, all at one distance",
        "streaks of snowflakes over a whitened image",
        twin="snow_depth",
        of_paper=True,
    ),
    overlay=True,
    apply=apply,
    version=2,  # float colour is rounded before it
    apply_bytes=apply,
    nodes=Nodes(build, capacity={"blur_radius_px": 12}, draws_lit=True),
    temporals=("fresh", "fixed", "drift"),
    counts=frozenset({"blur_radius_px"}),
    tinted=True,
)
