# SPDX-License-Identifier: GPL-3.0-or-later
"""Elastic transform: the image drawn like a sheet of rubber; depth no longer fits it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICKLY, kept_for_sequence, quick_key
from ._glass import sampled
from ._noise import CODES, uniform_codes, white_noise
from ._sizes import FullSize, full_size

FINEST, LARGEST = 2.0, 4  # of larger pixels: the least standard deviation in them, and their side; chosen
TRUNCATE = 3  # standard deviations at which the Gaussian ends, as the Blur node's does


@dataclass(frozen=True)
class ElasticTransform:
    """Each pixel taken from a place nearby, by uniform noise that a Gaussian has smoothed, as imagecorruptions.

    It moves colour alone: depth, poses and intrinsics no longer fit what the image shows. At the image's border the
    outermost pixels are repeated, where imagecorruptions mirrors them.
    """

    alpha: float = key("factor of the smoothed noise", default=21.25, minimum=0, maximum=1000)
    sigma_share: float = key(
        "standard deviation of the Gaussian, of the image's height down and width across",
        default=0.01,
        above=0,
        maximum=0.1,
    )
    noise_share: float = key(
        "largest noise before the Gaussian, of the image's height", default=0.005, minimum=0, maximum=1
    )
    coarse: bool = quick_key("draw and smooth the noise of fewer, larger pixels: another sheet, in a third of the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "alpha": "Higher: everything is drawn farther from its place",
        "sigma_share": "Higher: the sheet bends in wider and shallower waves",
        "noise_share": "Higher: everything is drawn farther from its place",
        "coarse": "On: another sheet of the same kind, in a third of the time",
    }


def apply(rgb: NDArray[np.float32], parameters: ElasticTransform, context: FrameContext) -> NDArray[np.float32]:
    """Warp (H, W, 3)."""
    import cv2

    height, width = rgb.shape[:2]
    columns, rows = _places(context, height, width, parameters, lit=context.lit)
    moved = cv2.remap(rgb, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32).reshape(rgb.shape)


@kept_for_sequence
def _places(
    context: FrameContext, height: int, width: int, parameters: ElasticTransform, *, lit: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return from which column and which row each pixel is taken, both (H, W). lit: by the numbers that nodes draw."""
    import cv2

    times = _larger(min(width, height) * parameters.sigma_share) if parameters.coarse else 1
    small = (width + times // 2) // times, (height + times // 2) // times
    x, y = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in small))
    if lit:
        noise = 2 * np.stack(white_noise(context, quick=parameters.coarse).random(0, x, y)[:2]) - 1
    else:
        codes = uniform_codes(context.pattern_stream(), (2, *small[::-1]))
        noise = (codes.astype(np.float32) - np.float32((CODES - 1) / 2)) * np.float32(2 / CODES)
    # Of fewer numbers the mean is as many times larger.
    most_px = parameters.alpha * parameters.noise_share * height / times
    across, down = (_weights(size * parameters.sigma_share) for size in small)
    columns, rows = (
        np.asarray(cv2.sepFilter2D(item, -1, across, most_px * down, borderType=cv2.BORDER_REFLECT), np.float32)
        for item in noise
    )
    if times > 1:
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        columns, rows = (np.asarray(cv2.resize(item, (width, height)), np.float32) for item in (columns, rows))
    return x - columns.reshape(x.shape), y + rows.reshape(y.shape)  # as the Displace node, which counts rows upwards


def _larger(sigma_px: float) -> int:
    """Return how many times larger the pixels of the noise may be."""
    return min(max(math.floor(sigma_px / FINEST), 1), LARGEST)


def _weights(sigma_px: float) -> NDArray[np.float64]:
    """Return the weights of a Gaussian, odd, as the Blur node has them."""
    reach = math.ceil(TRUNCATE * sigma_px)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    return weights / weights.sum()


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Smooth noise that is mirrored at the border, and displace the frame by it; a preview's at full size."""
    full = full_size(canvas)
    return full.back(_displaced(full, given))


def _displaced(full: FullSize, given: Mapping[str, Socket]) -> Socket:
    canvas = full.canvas
    graph = canvas.graph
    quick, sides = given["coarse"], (canvas.width_px, canvas.height_px)
    with graph.section("Pixels of the noise"):
        least = graph.math("MINIMUM", *sides) * given["sigma_share"]
        times = graph.clamp(graph.math("FLOOR", least * (1 / FINEST)), 1.0, float(LARGEST))
        small = (graph.math("FLOOR", side / times + 0.5) for side in sides)
        width, height = (graph.choose(quick, *each, "float") for each in zip(small, sides, strict=True))
        times = graph.choose(quick, times, 1.0, "float")
        size = graph.vector(width, height, 1.0)
    with graph.section("Mirror the border"):
        reach = size * graph.vector(given["sigma_share"], given["sigma_share"], 0.0) * float(TRUNCATE)
        border = graph.math("CEIL", reach + 1.0)
        wide = graph.node("CompositorNodeBlankImage", {"Size": graph.math("MULTIPLY_ADD", border, 2.0, size)})
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": wide.out("Image", "color")}).out(
            "Pixel", "vector"
        )
        inside = graph.math("ABSOLUTE", graph.math("SUBTRACT", pixel, border) + 0.5)
        position = graph.math("SUBTRACT", size, graph.math("ABSOLUTE", graph.math("SUBTRACT", size, inside))) - 0.5
        from_top = graph.math("MULTIPLY_ADD", position, (1.0, -1.0, 0.0), graph.vector(0.0, height - 1.0))
        place = graph.math("FLOOR", from_top + 0.25)
    with graph.section("Noise"):
        # Smoothed over as large a share of the image, noise displaces by as many pixels at any size, so it is scaled.
        most = given["alpha"] * given["noise_share"] * canvas.height_px * canvas.scale / times
        noise = graph.math("MULTIPLY_ADD", canvas.random(0, place), (2.0, 2.0, 0.0), (-1.0, -1.0, 0.0))
    with graph.section("Smooth"):
        inputs = {"Image": noise, "Size": reach, "Type": "Gaussian", "Separable": True}
        smooth = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
        cut = {"Image": smooth, "X": border.x, "Y": border.y, "Width": width, "Height": height}
        offset = graph.node("CompositorNodeCrop", cut | {"Alpha Crop": False}).out("Image", "color")
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
        offset = graph.choose(quick, sampled(offset, share), offset)
    with graph.section("Displace"):
        extend = {"Extension X": "Extend", "Extension Y": "Extend"}
        by = offset * graph.vector(most, most, 0.0)
        inputs = {"Image": canvas.image, "Displacement": by, "Interpolation": "Bilinear", **extend}
        return graph.node("CompositorNodeDisplace", inputs).out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="elastic_transform",
    label="Elastic transform",
    stage="lens",
    order=64,
    parameters=ElasticTransform,
    newly=QUICKLY,
    severities={"alpha": (12.5, 16.25, 21.25, 25.0, 30.0)},
    source="imagecorruptions, elastic_transform: 250 x 0.05, 0.065, 0.085, 0.1 and 0.12",
    about=About(
        "Draws the image out and together like a sheet of rubber; depth no longer fits it",
        "pixels moved by smoothed noise; depth no longer fits",
        of_imagenet_c=True,
    ),
    apply=apply,
    averages=True,
    temporals=("fresh", "fixed"),
    nodes=Nodes(build),
    breaks_depth=True,
)
