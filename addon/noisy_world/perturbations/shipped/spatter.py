# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatter: drops of water or splashes of mud on the lens."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import INTERFACE, Graph, Kind, Socket, Value
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import (
    QUICKLY,
    Level,
    colour_by_bands,
    gaussian,
    kept_for_sequence,
    quick_key,
    three_channels,
    torus_window,
)
from ._noise import look_up, normal_quantiles, uniform_codes

# The colours, the distance and the kernel are ImageNet-C's.
_WATER_RGB = (175, 238, 238)
_MUD_RGB = (63, 42, 20)
_FAR_PX = 20  # the distance from a drop's rim at which its glint ends
_RIM = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], dtype=np.float32)  # emboss

# Of the reference width: a smaller preview has other drops than the frame. Chosen: it bounds the lattice, and the time.
_SMALLEST_SCALE = 0.25
_OVERLOOKED_AREA = 660.0  # divides the number of overlooked drops by Rice's formula (see _brightest); fitted


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
    run_px: float = key(
        "drift: how far the drops run down a frame", default=0.5, unit="px", minimum=0, maximum=1000, slider=(0, 10)
    )
    coarse: bool = quick_key("draw random numbers by a shorter hash in node groups: other drops, in less time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "mean": "Higher: more of the lens is covered",
        "std": "Higher: drops differ more in size",
        "sigma_px": "Higher: larger, rounder drops",
        "threshold": "Lower: more drops",
        "scaling": "Higher: the drops cover the picture more",
        "complexity": "0 shows drops of water, 1 mud",
        "run_px": "Higher: with the pattern Drift, the drops run down faster",
        "coarse": "On: other drops of the same kind, in less time",
    }


def apply(rgb: NDArray[Level], parameters: Spatter, context: FrameContext) -> NDArray[Level]:
    """Spatter (H, W, 3)."""
    cover = _cover(context, rgb.shape[:2], parameters)
    if context.drift_frames:
        cover = torus_window(cover, rgb.shape[:2], start=(-context.drift_frames * parameters.run_px, 0.0))
    if not cover.any():
        return rgb.copy()
    return colour_by_bands(rgb, _under_mud if parameters.complexity else _under_water, cover)


def _under_water(rgb: NDArray[np.float32], cover: NDArray[np.float32]) -> NDArray[np.float32]:
    spattered = _tinted(cover, _WATER_RGB)
    return np.add(spattered, rgb, out=spattered)


def _under_mud(rgb: NDArray[np.float32], cover: NDArray[np.float32]) -> NDArray[np.float32]:
    left = three_channels(1 - cover)
    left *= rgb
    return np.add(left, _tinted(cover, _MUD_RGB), out=left)


def _tinted(cover: NDArray[np.float32], colour: tuple[int, int, int]) -> NDArray[np.float32]:
    import cv2

    return np.asarray(cv2.merge([cover * np.float32(value / 255) for value in colour]), np.float32)


@kept_for_sequence
def _cover(context: FrameContext, size: tuple[int, int], parameters: Spatter) -> NDArray[np.float32]:
    """Return how much of each pixel the drops cover, (H, W); periodic if it drifts, so that it never ends."""
    import cv2

    quantiles = (normal_quantiles() * parameters.std + parameters.mean).astype(np.float32)
    noise = look_up(uniform_codes(context.pattern_stream(), size), quantiles)
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
    """Return in pixels how far noise has an influence: 4 sigma of each blur, and for water the rim's glint."""
    reach = math.ceil(4 * parameters.scaling) if parameters.complexity else _FAR_PX + 4
    return math.ceil(4 * parameters.sigma_px) + reach


def _mud(layer: NDArray[np.float32], parameters: Spatter) -> NDArray[np.float32]:
    cover = gaussian((layer > 0).astype(np.float32), parameters.scaling)
    cover *= cover >= np.float32(0.8)
    return cover


def _water(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the drops' brightness (H, W): their own, times an embossed image of the distance to their rims."""
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
        noise, soiled = _parted(given["complexity"], noise)
        above = noise - given["threshold"]
        inside = graph.math("GREATER_THAN", above, 0.0)
    with graph.section("Mud"):
        above_mud = soiled - given["threshold"]
        blurred = _blurred(graph.math("GREATER_THAN", above_mud, 0.0), given["scaling"] * (canvas.scale / finest))
        mud = blurred * graph.math("GREATER_THAN", blurred, 0.8)
    with graph.section("Water: distance to the rim"):
        distance = _distance(noise, above, given["mean"], sigma_px) / sigma_px
    with graph.section("Water: relief"):
        height = _height(given, sigma_px)
        # The rims' length, as a share of the rims' length at a threshold equal to the mean (Rice's formula).
        crossed = graph.math("EXPONENT", height * height * -0.5)
        glint = graph.math("MAXIMUM", _relief(canvas, _share_nearer(distance, crossed)), _overlooked(inside))
        drops = graph.math("MINIMUM", noise, 1.0) * inside * glint
    with graph.section("Water: brightness"):
        expected = size_px.x * size_px.y * crossed * height**3.0 / (sigma_px**4.0 * _OVERLOOKED_AREA)
        water = drops * (given["scaling"] / _brightest(canvas, drops, given["threshold"], expected))
    with graph.section("Over the image"):
        cover = _either(given["complexity"], water, mud, "float")
        cover = _positioned(canvas, cover, run_px, size_px)
        cover = graph.vector(cover, cover, cover)
        wet = graph.math("MULTIPLY_ADD", cover, _encoded(_WATER_RGB), canvas.image)
        muddy = graph.mix(canvas.image, _encoded(_MUD_RGB), cover)
        return _either(given["complexity"], wet, muddy, "color")


def _parted(complexity: Socket, noise: Socket) -> tuple[Socket, Socket]:
    """Return the noise for water and for mud.

    Where a severity decides the complexity, Blender calculates both. Then the noise of that which is not shown is a
    single number, of which all the rest takes no time.
    """
    if complexity.node == INTERFACE:
        return noise, noise
    return _either(complexity, noise, 0.0, "float"), _either(complexity, 0.0, noise, "float")


def _either(complexity: Socket, water: Value, mud: Value, kind: Kind) -> Socket:
    """Return one of the two; Blender does not calculate the other where the index is an input of the group itself."""
    types = {"float": "FLOAT", "color": "RGBA"}
    inputs = {"Index": complexity, "Item_0": water, "Item_1": mud}
    return complexity.graph.node("GeometryNodeIndexSwitch", inputs, {"data_type": types[kind]}).out("Output", kind)


def _encoded(rgb: tuple[int, int, int]) -> tuple[float, ...]:
    return tuple(value / 255 for value in rgb)


def _lattice_size(canvas: Canvas, finest: Socket) -> Socket:
    """Return the frame's width and height in whole pixels, as they are at the reference width."""
    graph = canvas.graph
    size = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(finest, finest, 1.0)
    return graph.math("MAXIMUM", graph.math("FLOOR", size + 0.5), 1.0)


def _smooth_noise(
    canvas: Canvas, size_px: Socket, run_px: Socket, given: Mapping[str, Socket], sigma_px: Socket
) -> Socket:
    """Return the blurred noise; rows further up move into the frame as the drops run down."""
    graph = canvas.graph
    lattice = graph.node("CompositorNodeBlankImage", {"Size": size_px}).out("Image", "color")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": lattice}).out("Pixel", "vector")
    # Counted from the top, as rows of the frame are.
    start = graph.vector(0.0, size_px.y - 1.0 - graph.math("FLOOR", run_px))
    position = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), start)
    # Uniform numbers of the same variance: blurred over a dozen pixels or more, their sums are normal all the same.
    span = given["std"] * math.sqrt(12.0)
    return _blurred(
        graph.math("MULTIPLY_ADD", canvas.random_value(0, position), span, given["mean"] - span * 0.5), sigma_px
    )


def _blurred(value: Socket, sigma_px: Socket) -> Socket:
    width = sigma_px * 3.0
    inputs = {"Image": value, "Size": value.graph.vector(width, width), "Type": "Gaussian", "Separable": True}
    return value.graph.node("CompositorNodeBlur", inputs).out("Image", "float")


def _boxed(value: Socket, reach_px: int = 1) -> Socket:
    """Return the mean of the square that reaches `reach_px` pixels to each side: 3 x 3 by default."""
    inputs = {"Image": value, "Size": (float(reach_px),) * 2, "Type": "Flat", "Separable": True}
    return value.graph.node("CompositorNodeBlur", inputs).out("Image", "float")


def _distance(noise: Socket, above: Socket, mean: Socket, sigma_px: Socket) -> Socket:
    """Return an estimate of the distance to the drops' rims in px: 3 x 3 means rounded down, _FAR_PX at most.

    It is the noise's height above the threshold divided by its slope, along a parabola that has the mean curvature of
    smooth normal noise of that height. An exact distance transform takes longer than all the rest together.
    """
    graph = noise.graph
    # Sobel's filter gives 8 times the slope, so 0.125 would be exact; 0.1, a fifth less, was fitted to the reference
    # and makes up for what the parabola leaves out.
    slope = graph.node("CompositorNodeFilter", {"Image": noise, "Type": "Sobel"}).out("Image", "float") * 0.1
    bend = graph.math("MAXIMUM", (noise - mean) * above, 0.0) / (sigma_px * sigma_px)
    steepness = slope + graph.math("SQRT", graph.math("MULTIPLY_ADD", slope, slope, bend))
    # Canny's edge lies on the drop's outermost pixels, which moves the rim inwards: 0.25 is fitted.
    from_rim = graph.math("ABSOLUTE", above * 2.0 / graph.math("MAXIMUM", steepness, 1e-9) - 0.25)
    return graph.math("FLOOR", _boxed(graph.math("MINIMUM", from_rim, float(_FAR_PX))))


def _height(given: Mapping[str, Socket], sigma_px: Socket) -> Socket:
    """Return the threshold's height above the mean, in standard deviations of the blurred noise."""
    return (given["threshold"] - given["mean"]) * (sigma_px * (2.0 * math.sqrt(math.pi))) / given["std"]


def _share_nearer(distance: Socket, crossed: Socket) -> Socket:
    """Return the share of the frame that lies nearer to a rim, which is what equalising the histogram gives.

    The form 1 - exp(-(a x + b x^2)) is the probability that a disc of radius x, in sigmas, meets a rim. Its numbers are
    fitted to the reference.
    """
    graph = distance.graph
    across = graph.math("MULTIPLY_ADD", crossed * crossed, 0.5, 0.58)
    exponent = graph.math("MULTIPLY_ADD", distance, 0.2, across) * distance * (crossed * -1.0)
    return 1.0 - graph.math("EXPONENT", exponent)


def _relief(canvas: Canvas, share: Socket) -> Socket:
    """Return the share embossed as by _RIM and averaged over 3 x 3."""
    graph = share.graph
    looked_up = _boxed(graph.clamp(graph.math("MULTIPLY_ADD", _embossed(graph, share), 4.5, share)))
    if canvas.always_lit:
        return looked_up
    # A bilinear look-up 2/3 of a pixel away on the diagonal weights its neighbours 2 : 1 : 1; the difference of the two
    # sides is _RIM without its middle.
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
    moved = _boxed(graph.clamp(graph.math("MULTIPLY_ADD", sides[0] - sides[1], 4.5, share)))
    assert canvas.quick is not None
    return graph.choose(canvas.quick, looked_up, moved, "float")


def _embossed(graph: Graph, share: Socket) -> Socket:
    """Return the difference of both sides looked up, which leaves the image where it is: Displace moves it."""
    place = graph.node("CompositorNodeImageCoordinates", {"Image": share}).out("Normalized", "vector")
    size = graph.node("CompositorNodeImageInfo", {"Image": share}).out("Resolution", "vector")
    sides = []
    for sign in (1, -1):
        step = graph.math("DIVIDE", (sign * 2 / 3, -sign * 2 / 3, 1.0), graph.math("MAXIMUM", size, (1.0, 1.0, 1.0)))
        inputs = {"Image": share, "UV": place + step, "Interpolation": "Bilinear"}
        inputs |= {"Extension X": "Extend", "Extension Y": "Extend"}
        sides.append(graph.node("CompositorNodeMapUV", inputs).out("Image", "float"))
    return sides[0] - sides[1]


def _overlooked(inside: Socket) -> Socket:
    """Return the glint of drops of four pixels.

    Canny overlooks drops of 2 x 2 pixels, so their brightness depends on the distance to other drops. Here every drop
    of four pixels gets a glint; there are more of these, and 0.45 is fitted so that their power is the same.
    """
    return inside.graph.math("COMPARE", _boxed(inside, 2), 4 / 25, 0.5 / 25, label="Four pixels of 5 x 5") * 0.45


def _brightest(canvas: Canvas, drops: Socket, threshold: Socket, expected: Socket) -> Socket:
    """Return the brightness of the frame's brightest pixel, which gets the strength `scaling`.

    It is often in a drop that Canny overlooks, far from any rim that Canny finds. The equalised distance there is
    uniform in [0, 1]; the largest of n such numbers is distributed as U^(1 / n), and the emboss adds to it (1.25,
    fitted). expected: n, the expected number of such drops.
    """
    graph = canvas.graph
    seen = graph.node("CompositorNodeLevels", {"Image": drops, "Channel": "Red"}).out("Maximum", "float")
    largest = canvas.random_value(1) ** (1.0 / graph.math("MAXIMUM", expected, 1e-3))
    overlooked = threshold * graph.math("MINIMUM", largest * 1.25, 1.0)
    # The reference's normal numbers reach a little further than ours, by 3 % (fitted).
    return graph.math("MAXIMUM", seen * 1.03, overlooked)


def _positioned(canvas: Canvas, cover: Socket, run_px: Socket, size_px: Socket) -> Socket:
    """Return the drops at the image's size, moved by the fraction of a pixel that they have run."""
    graph = canvas.graph
    rest = graph.math("FRACT", run_px)
    moving = graph.math("GREATER_THAN", graph.math("ABSOLUTE", canvas.scale - 1.0) + rest, 1e-6)
    # The switch below calculates both branches; where nothing moves, this one is made a single pixel.
    sides = {"Width": canvas.width_px * moving, "Height": canvas.height_px * moving}
    inputs = {"Image": canvas.image} | {name: graph.math("MAXIMUM", side, 1.0) for name, side in sides.items()}
    image = graph.node("CompositorNodeCrop", inputs).out("Image", "color")
    share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
    # The third number is Map UV's weight: 1 shows the drops as they are.
    position = graph.math("ADD", share, graph.vector(0.0, rest / size_px.y, 1.0))
    inputs = {"Image": cover, "UV": position, "Interpolation": "Bilinear"}
    inputs |= {"Extension X": "Extend", "Extension Y": "Extend"}
    moved = graph.node("CompositorNodeMapUV", inputs).out("Image", "float")
    return graph.choose(moving, moved, cover, "float")


PERTURBATION = ColourPerturbation(
    name="spatter",
    label="Spatter",
    stage="environment",
    order=50,
    parameters=Spatter,
    newly=QUICKLY,
    severities={
        "mean": (0.65, 0.65, 0.65, 0.65, 0.67),
        "std": (0.3, 0.3, 0.3, 0.3, 0.4),
        "sigma_px": (4, 3, 2, 1, 1),
        "threshold": (0.69, 0.68, 0.68, 0.65, 0.65),
        "scaling": (0.6, 0.6, 0.5, 1.5, 1.5),
        "complexity": (0, 0, 0, 1, 1),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the drops: ImageNet-C',
    about=About(
        "Lays drops of water or mud over the image, which show nothing through them",
        "drops of water (severities 1 to 3) or mud",
        caption="drops of water; mud from severity 4 on.",
        twin="lens_drops",
        of_paper=True,
    ),
    overlay=True,
    apply=apply,
    version=2,  # its noise is drawn by tables, and float colour is rounded before it
    apply_bytes=apply,
    nodes=Nodes(build, draws_lit=True),
    temporals=("fresh", "fixed", "drift"),
    counts=frozenset({"complexity"}),
    tinted=True,
)
