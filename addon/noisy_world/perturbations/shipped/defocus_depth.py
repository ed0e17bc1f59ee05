# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of field: a thin lens blurs what is nearer or farther than its focus."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._glass import sampled_at

NEAREST_M = 1e-3  # least distance of the focus beyond the focal length; chosen: nearer, a lens cannot focus
ROWS = 16  # of a band; chosen so that a band's arrays stay in the processor's cache
# Where wide disks are summed at half the frame's size. Each is chosen but LOST_PX2.
FINE_PX = 1.75  # largest radius that is still summed at the full size: 25 pixels
WIDE_PX = 2.0  # radius from which half the size comes in; a pixel more, and it is all
LEAST_HALF_PX = 1.0  # least radius at half the size, in its pixels
# Halving and enlarging blur by themselves: in pixels of the frame, along a line, by a variance of 1/4 (the mean of two
# pixels) and 2/3 (a triangle between pixels 2 apart). A disk's variance is a quarter of its squared radius.
LOST_PX2 = 4 * (1 / 4 + 2 / 3)
LEAST_LIGHT = 1 / 256  # weight of a pixel in focus in its neighbours' disks, of 1; chosen: above 0, so sums are never 0


@dataclass(frozen=True)
class DefocusDepth:
    """Each pixel is the mean of a disk of its own circle of confusion, by the thin lens and the pixel's depth.

    The circle's diameter on the sensor is |f^2 (z - s) / (N z (s - f))|, with focal length f, focus s, f-number N and
    planar depth z; void, depth 0, is infinitely far. A pixel in focus spreads no light, so that it does not bleed into
    its blurred neighbours. Not modelled: light of a blurred foreground on what is sharp behind it. Its edge stays hard.
    """

    focus_m: float = key(
        "planar depth of what is sharp", default=1.5, unit="m", minimum=0.05, maximum=1000, slider=(0.1, 10)
    )
    f_number: float = key(
        "focal length over the aperture's diameter", default=5.6, minimum=0.5, maximum=64, label="F-Stop"
    )
    focal_length_mm: float = key(
        "focal length of the lens", default=50.0, unit="mm", minimum=1, maximum=1000, slider=(10, 200)
    )
    sensor_width_mm: float = key(
        "width of the sensor behind it", default=36.0, unit="mm", minimum=1, maximum=100, slider=(4, 50)
    )
    max_radius_px: float = key(
        "no circle of confusion is larger; the time goes with its square",
        default=6.5,
        unit="px",
        minimum=1,
        maximum=30,
        slider=(1, 30),
    )
    coarse: bool = key(
        "sum disks of more than 2 px at half the frame's size: softer rims, in a fraction of the time",
        default=False,
        later=True,
        label="Quick",
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "focus_m": "How far away the sharp plane is; what is nearer or farther is blurred",
        "f_number": "Lower: a wider aperture, so less is sharp before and behind the focus",
        "focal_length_mm": "Higher: less is sharp before and behind the focus",
        "sensor_width_mm": "Higher: the same lens blurs fewer pixels",
        "max_radius_px": "Higher: what is far out of focus may blur more, and takes longer",
        "coarse": "On: disks have softer rims, and it takes a third of the time",
    }


def apply(rgb: NDArray[np.float32], parameters: DefocusDepth, context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3) by the context's planar depth (H, W), metres, 0 = void."""
    radius_px = confusion_radius_px(context.depth_m, parameters, rgb.shape[1])
    light = np.clip(radius_px, LEAST_LIGHT, 1)[..., None]
    spread = np.concatenate([rgb * light, light], axis=2)
    largest_px = FINE_PX if parameters.coarse else parameters.max_radius_px
    gathered = _gather(spread, np.clip(radius_px, 1, largest_px), math.ceil(largest_px) + 1)
    share = np.minimum(radius_px, 1)[..., None] ** 2
    blurred = np.divide(gathered[..., :3], gathered[..., 3:], dtype=np.float32)
    if parameters.coarse:
        wide = np.clip(radius_px - np.float32(WIDE_PX), 0, 1)[..., None]
        blurred += (_gathered_at_half(spread, radius_px, parameters.max_radius_px) - blurred) * wide
    return rgb + (blurred - rgb) * share


def _gathered_at_half(
    spread: NDArray[np.float32], radius_px: NDArray[np.float32], max_radius_px: float
) -> NDArray[np.float32]:
    """Return the means (H, W, 3) of wide disks, summed at half the size. spread: light times colour, and light."""
    import cv2

    height, width = radius_px.shape
    upper = height % 2  # pairs of rows begin below, as Blender counts them

    def halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
        even = cv2.copyMakeBorder(image, upper, 0, 0, width % 2, cv2.BORDER_REPLICATE)
        return np.asarray(cv2.resize(even, (even.shape[1] // 2, even.shape[0] // 2)), np.float32)

    small, radius = halved(spread), halved(radius_px)
    reach = np.sqrt(np.maximum(radius * radius - np.float32(LOST_PX2), 0)) * np.float32(0.5)
    gathered = _gather(small, np.maximum(reach, np.float32(LEAST_HALF_PX)), math.ceil(max_radius_px / 2) + 1)
    means = np.divide(gathered[..., :3], gathered[..., 3:], dtype=np.float32)
    large = cv2.resize(means, (2 * means.shape[1], 2 * means.shape[0]))
    return np.asarray(large, np.float32)[upper:, :width]


def confusion_radius_px(depth_m: NDArray[np.float32], parameters: DefocusDepth, width_px: int) -> NDArray[np.float32]:
    """Return (H, W) px: the radius of a thin lens's circle of confusion, limited to `max_radius_px`."""
    focal_m = parameters.focal_length_mm / 1000
    beyond_m = max(parameters.focus_m - focal_m, NEAREST_M)
    diameter_m = focal_m**2 / (parameters.f_number * beyond_m)  # of a point at infinity
    far_px = np.float32(diameter_m / (parameters.sensor_width_mm / 1000) * width_px / 2)
    nearness = np.divide(
        np.float32(parameters.focus_m), depth_m, out=np.zeros_like(depth_m), where=depth_m > 0, dtype=np.float32
    )
    return np.minimum(far_px * np.abs(1 - nearness), np.float32(parameters.max_radius_px))


def _gather(image: NDArray[np.float32], radius_px: NDArray[np.float32], grain: int) -> NDArray[np.float32]:
    """Sum (H, W, C) over each pixel's own disk, the border replicated. radius_px: (H, W), at least 1.

    grain: the side of the table of weights, in cells.
    """
    import cv2

    size = (radius_px + np.float32(0.5)) * np.float32((grain + 1) / grain) - 1
    reach = math.ceil(float(size.max()))
    padded = np.asarray(cv2.copyMakeBorder(image, reach, reach, reach, reach, cv2.BORDER_REPLICATE), np.float32)
    total = np.empty_like(image)
    for top in range(0, len(image), ROWS):
        band = slice(top, top + ROWS)
        total[band] = _gather_band(padded[top : top + ROWS + 2 * reach], size[band], reach, grain)
    return total


def _gather_band(
    padded: NDArray[np.float32], size: NDArray[np.float32], border: int, grain: int
) -> NDArray[np.float32]:
    height, width = size.shape
    total = padded[border : border + height, border : border + width].copy()
    reach = math.ceil(float(size.max()))
    indices = _table_indices(size, reach, grain)
    table = np.pad(disk_quadrant(grain), (0, 1)).astype(np.float32)  # padded: the last row and column need a neighbour
    for small, large in ((a, b) for b in range(1, reach + 1) for a in range(b + 1)):
        weight = _weight(indices[small], indices[large], table)
        if not weight.any():
            continue
        ring = np.zeros_like(total)
        for row, column in _offsets(small, large):
            top, left = border + row, border + column
            ring += padded[top : top + height, left : left + width]
        ring *= weight[..., None]
        total += ring
    return total


def _offsets(small: int, large: int) -> list[tuple[int, int]]:
    """Return all offsets (rows, columns) whose absolute values are these two, in either order."""
    signs = product((1, -1), repeat=2)
    return sorted({(row * y, column * x) for row, column in signs for y, x in ((small, large), (large, small))})


TableIndex: TypeAlias = tuple[NDArray[np.intp], NDArray[np.float32]]


def _table_indices(size: NDArray[np.float32], reach: int, grain: int) -> list[TableIndex]:
    """Return for each offset 0 to `reach` its position in the table: the row below it, and the fraction from there.

    This repeats Blender's Blur node: where its size varies by pixel, it looks the weights up in a quadrant of the
    largest disk, with bilinear interpolation.
    """
    scale = np.float32(grain + 1) / (size + 1)
    found = []
    for offset in range(reach + 1):
        indices = np.minimum((offset + np.float32(0.5)) * scale - np.float32(0.5), grain) * np.float32(offset > 0)
        low = indices.astype(np.intp)
        found.append((low, indices - low.astype(np.float32)))
    return found


def _weight(first: TableIndex, second: TableIndex, table: NDArray[np.float32]) -> NDArray[np.float32]:
    """Interpolate the table bilinearly between four neighbours."""
    (row, down), (column, right) = first, second
    width = table.shape[1]
    corner = row * width + column
    upper, lower = (
        table.take(corner + step) * (1 - right) + table.take(corner + step + 1) * right for step in (0, width)
    )
    return upper + (lower - upper) * down


def disk_quadrant(grain: int) -> NDArray[np.bool_]:
    """Return a mask (grain + 1, grain + 1): the offsets in a disk of radius grain - 1/2, so without the outermost."""
    offsets = np.arange(grain + 1)
    return offsets[:, None] ** 2 + offsets**2 <= (grain - 0.5) ** 2


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Blur with the Blur node, whose size varies by pixel."""
    graph, image, depth_m, quick = canvas.graph, canvas.image, canvas.depth_m, given["coarse"]
    assert depth_m is not None
    with graph.section("Circle of confusion"):
        focal_m = given["focal_length_mm"] / 1000.0
        beyond_m = graph.math("MAXIMUM", given["focus_m"] - focal_m, NEAREST_M)
        aperture_m = focal_m / given["f_number"]
        diameter_m = graph.math("MULTIPLY", aperture_m, focal_m / beyond_m, label="Of a point at infinity")
        far_px = diameter_m * canvas.width_px * 500.0 / given["sensor_width_mm"]
        nearness = graph.math("DIVIDE", given["focus_m"], depth_m, label="0 at infinity and where depth is void")
        free_px = far_px * graph.math("ABSOLUTE", 1.0 - nearness)
        radius_px = graph.math("MINIMUM", free_px, given["max_radius_px"], label="Radius in pixels")
    with graph.section("A column for the largest disk"):
        # The Blur node scales its disks down from the largest in the image. An added column, cut off again below,
        # always holds the largest one, so that the weights do not depend on the frame.
        largest = graph.choose(quick, FINE_PX, given["max_radius_px"], "float")
        grain = graph.math("CEIL", largest) + 1.0
        column, wide, radius = _widened(canvas, radius_px)
    with graph.section("Light that spreads"):
        light = graph.clamp(radius, LEAST_LIGHT)
        spread = _with_alpha(graph.math("MULTIPLY", wide, graph.vector(light, light, light)), light)
    with graph.section("Blur"):
        disk = graph.math("MINIMUM", graph.math("MAXIMUM", radius, 1.0), largest)
        kept = _summed(spread, disk, column, grain, (canvas.width_px, canvas.height_px))
    half = _at_half(canvas, quick, radius_px, given["max_radius_px"])
    with graph.section("Mix"):
        mean = _mean(kept)
        wide = graph.clamp(radius_px - WIDE_PX)
        mean = graph.choose(quick, graph.mix(mean, half, graph.vector(wide, wide, wide)), mean, "vector")
        below = graph.math("MINIMUM", radius_px, 1.0)
        share = below * below
        return graph.mix(image, mean, graph.vector(share, share, share))


def _summed(spread: Socket, radius: Socket, column: Socket, grain: Socket, size: tuple[Socket, Socket]) -> Socket:
    """Sum each pixel's disk, and cut the column off. size: width and height without it."""
    graph = spread.graph
    own = (radius + 0.5) * ((grain + 1.0) / grain) - 1.0
    each = graph.math("MAXIMUM", own, column * (grain - 0.5))
    inputs = {"Image": spread, "Size": graph.vector(each, each), "Type": "Flat", "Separable": False}
    blurred = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    inputs = {"Image": blurred, "X": 0, "Y": 0, "Width": size[0], "Height": size[1]}
    return graph.node("CompositorNodeCrop", inputs | {"Alpha Crop": False}).out("Image", "color")


def _mean(summed: Socket) -> Socket:
    weight = _alpha(summed)
    return summed.graph.math("DIVIDE", summed, summed.graph.vector(weight, weight, weight))


def _at_half(canvas: Canvas, quick: Socket, radius_px: Socket, max_radius_px: Socket) -> Socket:
    """Return the means of wide disks, summed at half the size; of nothing where it is not asked for, at no cost."""
    graph = canvas.graph
    with graph.section("Half the size"):
        width, height = (graph.math("FLOOR", side * 0.5 + 0.5) for side in (canvas.width_px, canvas.height_px))
        image, radius = graph.choose(quick, canvas.image, 0.0), graph.choose(quick, radius_px, 0.0, "float")
        light = graph.clamp(radius, LEAST_LIGHT)
        spread = _with_alpha(graph.math("MULTIPLY", image, graph.vector(light, light, light)), light)
        blank = graph.choose(quick, graph.vector(width + 1.0, height), (1.0, 1.0, 0.0), "vector")
        wide = graph.node("CompositorNodeBlankImage", {"Size": blank}).out("Image", "color")
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": wide}).out("Pixel", "vector")
        last = graph.math("MINIMUM", pixel, graph.vector(width - 1.0, height))  # the column repeats the last one
        between = graph.math("MULTIPLY_ADD", last, (2.0, 2.0, 0.0), (1.0, 1.0, 1.0))
        where = graph.math("DIVIDE", between, graph.vector(canvas.width_px, canvas.height_px, 1.0))
        small, seen = sampled_at(spread, where), sampled_at(radius, where).r
    with graph.section("Blur at half the size"):
        free = graph.math("MAXIMUM", seen * seen - LOST_PX2, 0.0)
        reach = graph.math("MAXIMUM", graph.math("SQRT", free) * 0.5, LEAST_HALF_PX)
        grain = graph.math("CEIL", max_radius_px * 0.5) + 1.0
        summed = _summed(small, reach, pixel.x > width - 0.5, grain, (width, height))
        share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
        times = graph.vector(canvas.width_px / (width * 2.0), canvas.height_px / (height * 2.0))
        return sampled_at(_mean(summed), graph.math("MULTIPLY_ADD", share, times, (0.0, 0.0, 1.0)))


def _widened(canvas: Canvas, radius_px: Socket) -> tuple[Socket, Socket, Socket]:
    """Return a mask of the added column (1 there, 0 elsewhere), the image with the column, and the radius with it."""
    graph = canvas.graph
    size = graph.vector(canvas.width_px + 1.0, canvas.height_px)
    wide = graph.node("CompositorNodeBlankImage", {"Size": size}).out("Image", "color")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": wide}).out("Pixel", "vector")
    frame = graph.vector(canvas.width_px, canvas.height_px, 1.0)
    where = graph.math("DIVIDE", graph.math("ADD", pixel, (0.5, 0.5, 1.0)), frame)
    extend = {"Extension X": "Extend", "Extension Y": "Extend"}
    inputs = {"Image": _with_alpha(canvas.image, radius_px), "UV": where, "Interpolation": "Nearest", **extend}
    found = graph.node("CompositorNodeMapUV", inputs).out("Image", "color")
    return pixel.x > canvas.width_px - 0.5, found, _alpha(found)


def _with_alpha(image: Socket, alpha: Socket) -> Socket:
    inputs = {"Image": image, "Alpha": alpha, "Type": "Replace Alpha"}
    return image.graph.node("CompositorNodeSetAlpha", inputs).out("Image", "color")


def _alpha(image: Socket) -> Socket:
    node = image.graph.node("CompositorNodeSeparateColor", {"Image": image}, {"mode": "RGB"})
    return node.out("Alpha", "float")


PERTURBATION = ColourPerturbation(
    name="defocus_depth",
    label="Depth of field",
    stage="lens",
    order=20,
    parameters=DefocusDepth,
    severities={"f_number": (11, 8, 5.6, 4, 2.8)},
    source="our own: full stops of a 50 mm lens on full frame, focused at 1.5 m",
    about=About(
        "Blurs what is nearer or farther than the focus, as a lens does",
        "the depth of field of a thin lens, by planar depth; needs depth",
    ),
    apply=apply,
    averages=True,
    repeatable=True,
    nodes=Nodes(build),
    newly={"coarse": True},
    needs_depth=True,
)
