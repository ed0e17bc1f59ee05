# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatter: drops of water or splashes of mud on the lens."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Kind, Socket
from ..core.node_graphs.groups import Canvas
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._kernels import gaussian
from ._patterns import kept_for_sequence, three_channels, torus_window

_WATER_RGB = (175, 238, 238)
_MUD_RGB = (63, 42, 20)
_FAR_PX = 20  # the rim's glint reaches no further
_RIM = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], dtype=np.float32)

_SMALLEST_SCALE = 0.25  # a preview smaller than this has drops of its own
_OVERLOOKED_AREA = 660.0  # px: fitted, as small drops have it by Rice's formula


@dataclass(frozen=True)
class Spatter:
    """Drops where smoothed normal noise is above a threshold, as ImageNet-C.

    Water adds a pale tint, strongest near the drops' rims; mud covers. Where no drop falls, the image stays as it is.
    """

    mean: float = key("mean of the noise", default=0.65, minimum=-1, maximum=2)
    std: float = key("standard deviation of the noise", default=0.3, minimum=0, maximum=2)
    sigma_px: float = key("standard deviation of its smoothing", default=2.0, unit="px", minimum=0, maximum=50)
    threshold: float = key("what is below this is no drop", default=0.68, minimum=0, maximum=2)
    scaling: float = key(
        "water: the tint's greatest strength; mud: standard deviation of the edges' smoothing in px",
        default=0.5,
        minimum=0,
        maximum=50,
    )
    complexity: int = key("0 is water, 1 is mud", default=0, minimum=0, maximum=1)
    run_px: float = key("drift: how far the drops run down a frame", default=0.5, unit="px", minimum=0, maximum=1000)


def apply(rgb: NDArray[np.float32], parameters: Spatter, context: FrameContext) -> NDArray[np.float32]:
    """Spatter (H, W, 3)."""
    cover = _cover(context, rgb.shape[:2], parameters)
    if context.drift_frames:
        cover = torus_window(cover, rgb.shape[:2], start=(-context.drift_frames * parameters.run_px, 0.0))
    if not cover.any():
        return rgb.copy()
    spattered = _tinted(cover, _MUD_RGB if parameters.complexity else _WATER_RGB)
    if not parameters.complexity:
        spattered += rgb
        return spattered
    left = three_channels(1 - cover)
    left *= rgb
    left += spattered
    return left


def _tinted(cover: NDArray[np.float32], colour: tuple[int, int, int]) -> NDArray[np.float32]:
    import cv2

    return np.asarray(cv2.merge([cover * np.float32(value / 255) for value in colour]), np.float32)


@kept_for_sequence
def _cover(context: FrameContext, size: tuple[int, int], parameters: Spatter) -> NDArray[np.float32]:
    """Return how much of each pixel the drops cover, (H, W); on a torus if it drifts, so that it runs on and on."""
    import cv2

    noise = context.pattern_stream().standard_normal(size, dtype=np.float32)
    noise *= np.float32(parameters.std)
    noise += np.float32(parameters.mean)
    margin = _margin(parameters) if context.temporal == "drift" else 0
    if margin:
        noise = np.asarray(cv2.copyMakeBorder(noise, margin, margin, margin, margin, cv2.BORDER_WRAP), np.float32)
    layer = gaussian(noise, parameters.sigma_px)
    layer *= layer >= np.float32(parameters.threshold)
    cover = _mud(layer, parameters) if parameters.complexity else _water(layer)
    cover = cover[margin : margin + size[0], margin : margin + size[1]]
    if not parameters.complexity and (brightest := float(cover.max())) > 0:
        cover = cover * np.float32(parameters.scaling / brightest)
    cover = np.ascontiguousarray(cover)
    cover.flags.writeable = False
    return cover


def _margin(parameters: Spatter) -> int:
    """Return how far away noise has an influence."""
    reach = math.ceil(4 * parameters.scaling) if parameters.complexity else _FAR_PX + 4
    return math.ceil(4 * parameters.sigma_px) + reach


def _mud(layer: NDArray[np.float32], parameters: Spatter) -> NDArray[np.float32]:
    cover = gaussian((layer > 0).astype(np.float32), parameters.scaling)
    cover *= cover >= np.float32(0.8)
    return cover


def _water(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the drops' brightness: their own, times a relief of the distance to their rims."""
    import cv2

    drops = np.minimum(layer * np.float32(255), np.float32(255)).astype(np.uint8)
    distance = cv2.distanceTransform(255 - cv2.Canny(drops, 50, 150), cv2.DIST_L2, 5)
    np.minimum(distance, np.float32(_FAR_PX), out=distance)
    relief = cv2.equalizeHist(cv2.blur(distance, (3, 3)).astype(np.uint8))
    relief = cv2.blur(cv2.filter2D(relief, cv2.CV_8U, _RIM), (3, 3))
    return drops * relief.astype(np.float32)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Blur noise at the reference width, cut drops out of it, and bring them to the image's size."""
    graph = canvas.graph
    with graph.section("Drops, at the reference width"):
        finest = graph.math("MAXIMUM", canvas.scale, _SMALLEST_SCALE)
        sigma_px = given["sigma_px"] / finest
        run_px = canvas.drift_frames * given["run_px"] / finest
        size_px = _lattice_size(canvas, finest)
        noise = _smooth_noise(canvas, size_px, run_px, given, sigma_px)
        above = noise - given["threshold"]
        inside = graph.math("GREATER_THAN", above, 0.0)
    with graph.section("Mud"):
        blurred = _blurred(inside, given["scaling"] * (canvas.scale / finest))
        mud = blurred * graph.math("GREATER_THAN", blurred, 0.8)
    with graph.section("Water: distance to the rim"):
        distance = _distance(noise, above, given["mean"], sigma_px) / sigma_px
    with graph.section("Water: relief"):
        height = _height(given, sigma_px)
        # How long the rims are, of what they are at the mean (Rice's formula).
        crossed = graph.math("EXPONENT", height * height * -0.5)
        glint = graph.math("MAXIMUM", _relief(_share_nearer(distance, crossed)), _overlooked(inside))
        drops = graph.math("MINIMUM", noise, 1.0) * inside * glint
    with graph.section("Water: brightness"):
        expected = size_px.x * size_px.y * crossed * height**3.0 / (sigma_px**4.0 * _OVERLOOKED_AREA)
        water = drops * (given["scaling"] / _brightest(canvas, drops, given["threshold"], expected))
    with graph.section("Over the image"):
        cover = _either(given["complexity"], water, mud, "float")
        cover = _placed(canvas, cover, run_px, size_px)
        cover = graph.vector(cover, cover, cover)
        wet = graph.math("MULTIPLY_ADD", cover, _encoded(_WATER_RGB), canvas.image)
        muddy = graph.mix(canvas.image, _encoded(_MUD_RGB), cover)
        return _either(given["complexity"], wet, muddy, "color")


def _either(complexity: Socket, water: Socket, mud: Socket, kind: Kind) -> Socket:
    """Return one of two; the other is not calculated, as the index is the group's own input."""
    types = {"float": "FLOAT", "color": "RGBA"}
    inputs = {"Index": complexity, "Item_0": water, "Item_1": mud}
    return water.graph.node("GeometryNodeIndexSwitch", inputs, {"data_type": types[kind]}).out("Output", kind)


def _encoded(rgb: tuple[int, int, int]) -> tuple[float, ...]:
    return tuple(value / 255 for value in rgb)


def _lattice_size(canvas: Canvas, finest: Socket) -> Socket:
    """Return the frame's width and height at the reference width, whole numbers."""
    graph = canvas.graph
    size = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(finest, finest, 1.0)
    return graph.math("MAXIMUM", graph.math("FLOOR", size + 0.5), 1.0)


def _smooth_noise(
    canvas: Canvas, size_px: Socket, run_px: Socket, given: Mapping[str, Socket], sigma_px: Socket
) -> Socket:
    """Return the noise, blurred; it comes from further and further above as the drops run down."""
    graph = canvas.graph
    lattice = graph.node("CompositorNodeBlankImage", {"Size": size_px}).out("Image", "color")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": lattice}).out("Pixel", "vector")
    # Counted from the top, as rows of the frame are.
    start = graph.vector(0.0, size_px.y - 1.0 - graph.math("FLOOR", run_px))
    place = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), start)
    # Uniform numbers of the same variance: blurred over a dozen pixels and more, they are normal all the same.
    span = given["std"] * math.sqrt(12.0)
    return _blurred(
        graph.math("MULTIPLY_ADD", canvas.random_value(0, place), span, given["mean"] - span * 0.5), sigma_px
    )


def _blurred(value: Socket, sigma_px: Socket) -> Socket:
    width = sigma_px * 3.0
    inputs = {"Image": value, "Size": value.graph.vector(width, width), "Type": "Gaussian", "Separable": True}
    return value.graph.node("CompositorNodeBlur", inputs).out("Image", "float")


def _boxed(value: Socket, reach_px: int = 1) -> Socket:
    """Return the mean of 3 x 3, or of what is no further than `reach_px`."""
    inputs = {"Image": value, "Size": (float(reach_px),) * 2, "Type": "Flat", "Separable": True}
    return value.graph.node("CompositorNodeBlur", inputs).out("Image", "float")


def _distance(noise: Socket, above: Socket, mean: Socket, sigma_px: Socket) -> Socket:
    """Return the distance to the drops' rims, some 20 px at most, its 3 x 3 means cut to whole pixels.

    From the noise itself: how far above the threshold it is, by its slope, along a parabola as curved as smooth normal
    noise of that height is on average. An exact distance transform takes longer than all the rest together.
    """
    graph = noise.graph
    # Sobel's is eight times the slope; a fifth less makes up for what the parabola leaves out.
    slope = graph.node("CompositorNodeFilter", {"Image": noise, "Type": "Sobel"}).out("Image", "float") * 0.1
    bend = graph.math("MAXIMUM", (noise - mean) * above, 0.0) / (sigma_px * sigma_px)
    steepness = slope + graph.math("SQRT", graph.math("MULTIPLY_ADD", slope, slope, bend))
    # Canny's edge lies on the drop's outermost pixels.
    from_rim = graph.math("ABSOLUTE", above * 2.0 / graph.math("MAXIMUM", steepness, 1e-9) - 0.25)
    return graph.math("FLOOR", _boxed(graph.math("MINIMUM", from_rim, float(_FAR_PX))))


def _height(given: Mapping[str, Socket], sigma_px: Socket) -> Socket:
    """Return the threshold's height above the mean, in standard deviations of the blurred noise."""
    return (given["threshold"] - given["mean"]) * (sigma_px * (2.0 * math.sqrt(math.pi))) / given["std"]


def _share_nearer(distance: Socket, crossed: Socket) -> Socket:
    """Return the share of the frame that lies nearer to a rim: what equalising the histogram gives.

    1 - exp(-(a x + b x^2)), as discs of radius x that meet no rim have it; x in sigmas. Fitted to the reference.
    """
    graph = distance.graph
    across = graph.math("MULTIPLY_ADD", crossed * crossed, 0.5, 0.58)
    exponent = graph.math("MULTIPLY_ADD", distance, 0.2, across) * distance * (crossed * -1.0)
    return 1.0 - graph.math("EXPONENT", exponent)


def _relief(share: Socket) -> Socket:
    """Return the share, embossed as by _RIM, blurred by 3 x 3."""
    graph = share.graph
    # Bilinear, 2/3 of a pixel aslant: weights as 2 to 1 to 1, so that their difference is _RIM without its middle.
    sides = [
        graph.node(
            "CompositorNodeDisplace",
            {
                "Image": share,
                "Displacement": (-sign * 2 / 3, sign * 2 / 3),
                "Interpolation": "Bilinear",
                "Extension X": "Extend",
                "Extension Y": "Extend",
            },
        ).out("Image", "float")
        for sign in (1, -1)
    ]
    return _boxed(graph.clamp(graph.math("MULTIPLY_ADD", sides[0] - sides[1], 4.5, share)))


def _overlooked(inside: Socket) -> Socket:
    """Return the glint of drops of four pixels.

    Canny overlooks those of 2 x 2, which are as bright then as the distance to other drops makes them. Fitted: with
    this glint all drops of four pixels, which are more, have the power of those.
    """
    return inside.graph.math("COMPARE", _boxed(inside, 2), 4 / 25, 0.5 / 25, label="Four pixels of 5 x 5") * 0.45


def _brightest(canvas: Canvas, drops: Socket, threshold: Socket, expected: Socket) -> Socket:
    """Return the brightness of the frame's brightest place, which gets the strength `scaling`.

    That is often a drop that Canny overlooks, far from any rim that it knows, where the equalised distance is any
    number in [0, 1]: the largest of n is U^(1 / n), and its emboss some more. expected: how many such drops there are.
    """
    graph = canvas.graph
    seen = graph.node("CompositorNodeLevels", {"Image": drops, "Channel": "Red"}).out("Maximum", "float")
    largest = canvas.random_value(1) ** (1.0 / graph.math("MAXIMUM", expected, 1e-3))
    overlooked = threshold * graph.math("MINIMUM", largest * 1.25, 1.0)
    # The reference's normal numbers reach a little further than ours.
    return graph.math("MAXIMUM", seen * 1.03, overlooked)


def _placed(canvas: Canvas, cover: Socket, run_px: Socket, size_px: Socket) -> Socket:
    """Return the drops at the image's size, moved by what is left of a whole pixel."""
    graph = canvas.graph
    rest = graph.math("FRACT", run_px)
    moving = graph.math("GREATER_THAN", graph.math("ABSOLUTE", canvas.scale - 1.0) + rest, 1e-6)
    # Where nothing moves, what a switch would calculate all the same is one pixel.
    sides = {"Width": canvas.width_px * moving, "Height": canvas.height_px * moving}
    inputs = {"Image": canvas.image} | {name: graph.math("MAXIMUM", side, 1.0) for name, side in sides.items()}
    image = graph.node("CompositorNodeCrop", inputs).out("Image", "color")
    share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
    # The third number is the share of the picture that shows.
    place = graph.math("ADD", share, graph.vector(0.0, rest / size_px.y, 1.0))
    inputs = {"Image": cover, "UV": place, "Interpolation": "Bilinear"}
    inputs |= {"Extension X": "Extend", "Extension Y": "Extend"}
    moved = graph.node("CompositorNodeMapUV", inputs).out("Image", "float")
    return graph.choose(moving, moved, cover, "float")


PERTURBATION = ColourPerturbation(
    name="spatter",
    label="Spatter",
    stage="environment",
    order=50,
    parameters=Spatter,
    severities={
        "mean": (0.65, 0.65, 0.65, 0.65, 0.67),
        "std": (0.3, 0.3, 0.3, 0.3, 0.4),
        "sigma_px": (4, 3, 2, 1, 1),
        "threshold": (0.69, 0.68, 0.68, 0.65, 0.65),
        "scaling": (0.6, 0.6, 0.5, 1.5, 1.5),
        "complexity": (0, 0, 0, 1, 1),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the drops: ImageNet-C',
    apply=apply,
    build=build,
    temporals=("fresh", "fixed", "drift"),
    counts=frozenset({"complexity"}),
)
