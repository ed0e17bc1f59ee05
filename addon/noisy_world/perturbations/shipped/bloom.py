# SPDX-License-Identifier: GPL-3.0-or-later
"""Bloom: a lens scatters a share of all light around where it falls, so what is bright glows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ...core.srgb import decoded, encoded
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICKLY, as_blur_node, quick_key
from ._glass import reduced, reduced_nodes, sampled

Float32: TypeAlias = NDArray[np.float32]

# Share of what is scattered, standard deviation over the reach, and how often the image is halved for it; chosen.
PARTS = ((0.5, 0.08, 0), (0.3, 0.3, 2), (0.2, 1.2, 3))
QUICK_PARTS = ((0.5, 0.08, 1), (0.3, 0.3, 2), (0.2, 1.2, 3))
HALF = 0.5**0.5  # of a standard deviation: what two blurs in a row have each


@dataclass(frozen=True)
class Bloom:
    """A share of the light is spread by a sum of three Gaussians of sum 1, near, middle and far: none is lost.

    On linear light. Beyond the border the image goes on as it is there.
    """

    amount: float = key("share of the light that is spread", default=0.15, minimum=0, maximum=1)
    reach_px: float = key(
        "how far it is spread: half of it within a tenth of this, a fifth beyond it",
        default=60.0,
        unit="px",
        minimum=0,
        maximum=400,
    )
    coarse: bool = quick_key("blur what is near at half the frame's size, too: hardly another, in half the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "amount": "Higher: bright things glow more, and all is veiled",
        "reach_px": "Higher: the glow is wider and fainter",
        "coarse": "On: hardly another glow, in half the time",
    }


def apply(rgb: Float32, parameters: Bloom, _context: FrameContext) -> Float32:
    """Let (H, W, 3) glow."""
    light = decoded(rgb)
    made = light * np.float32(1 - parameters.amount)
    if parameters.coarse:
        made += _quickly(light, parameters.reach_px) * np.float32(parameters.amount)
        return encoded(made)
    for share, times, halvings in PARTS:
        made += glow(light, parameters.reach_px * times, halvings) * np.float32(share * parameters.amount)
    return encoded(made)


def _quickly(light: Float32, reach_px: float) -> Float32:
    """Return the sum of the glows of linear light (H, W, 3), each enlarged to the size of the next nearer one."""
    import cv2

    total: Float32 | None = None
    for share, times, halvings in reversed(QUICK_PARTS):
        size_px = reach_px * times * 3.0 * HALF * 0.5**halvings
        small = as_blur_node(as_blur_node(reduced(light, halvings), size_px), size_px) * np.float32(share)
        total = small if total is None else small + np.asarray(cv2.resize(total, small.shape[1::-1]), np.float32)
    assert total is not None
    return np.asarray(cv2.resize(total, light.shape[1::-1]), np.float32).reshape(light.shape)


def glow(light: Float32, sigma_px: float, halvings: int) -> Float32:
    """Return linear light (H, W, 3) through a Gaussian, on an image that is halved so many times."""
    import cv2

    size_px = sigma_px * 3.0 * HALF * 0.5**halvings
    small = as_blur_node(as_blur_node(reduced(light, halvings), size_px), size_px)
    if not halvings:
        return small
    large = cv2.resize(small, light.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(large, np.float32).reshape(light.shape)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Blur three images of less and less pixels, and mix them."""
    graph, amount = canvas.graph, given["amount"]
    with graph.section("What stays"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
        left = 1.0 - amount
        total = kept = canvas.image * graph.vector(left, left, left)
    images = [reduced_nodes(canvas, halvings) if halvings else canvas.image for _, _, halvings in PARTS]
    for small, name, (part, times, halvings) in zip(images, ("Near", "Middle", "Far"), PARTS, strict=True):
        with graph.section(name):
            reach = given["reach_px"] / canvas.scale * (0.5**halvings) if halvings else given["reach_px"]
            size = reach * (times * 3.0 * HALF)
            spread = _blurred(_blurred(small, size), size)
            weight = amount * part
            seen = sampled(spread, share) if halvings else spread
            total = graph.math("MULTIPLY_ADD", seen, graph.vector(weight, weight, weight), total)
    with graph.section("Quickly"):
        glows: Socket | None = None
        for part, times, halvings in reversed(QUICK_PARTS):
            small = reduced_nodes(canvas, halvings)
            size = given["reach_px"] / canvas.scale * (0.5**halvings * times * 3.0 * HALF)
            spread = _blurred(_blurred(small, size), size) * (part, part, part)
            own = graph.node("CompositorNodeImageCoordinates", {"Image": small}).out("Normalized", "vector")
            glows = spread if glows is None else spread + sampled(glows, own)
        assert glows is not None
        quickly = graph.math("MULTIPLY_ADD", sampled(glows, share), graph.vector(amount, amount, amount), kept)
        return graph.choose(given["coarse"], quickly, total, "vector")


def _blurred(image: Socket, size: Socket) -> Socket:
    inputs = {"Image": image, "Size": image.graph.vector(size, size), "Type": "Gaussian", "Separable": True}
    return image.graph.node("CompositorNodeBlur", inputs).out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="bloom",
    label="Bloom",
    stage="lens",
    order=52,
    parameters=Bloom,
    newly=QUICKLY,
    severities={"amount": (0.05, 0.1, 0.15, 0.25, 0.4)},
    source="our own: chosen, from a good lens to a hazy one",
    about=About(
        "Lets bright things glow, as a lens scatters a part of their light",
        "a share of the light is spread by three Gaussians, on linear light ([the camera](camera.md))",
    ),
    apply=apply,
    repeatable=True,
    nodes=Nodes(build, linear=True),
    tinted=True,
)
