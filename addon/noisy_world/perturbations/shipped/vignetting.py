# SPDX-License-Identifier: GPL-3.0-or-later
"""Vignetting: a lens passes less light towards the border of the image."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.node_graph import Socket
from ...core.schema import key
from ...core.srgb import decoded, encoded
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import axis_by_camera, axis_px, camera_of
from ._arrays import by_camera as view_by_camera


@dataclass(frozen=True)
class Vignetting:
    """Linear light x (1 - corner_loss r^radius_power) x cos(angle)^cosine_power.

    r: the distance from the axis as a share of half the diagonal. The first factor is what the lens's own barrel and
    stops take. The second is the cosine law of a thin lens, whose power is 4 (natural vignetting); most lenses for
    sensors are made to have less of it.
    """

    corner_loss: float = key(
        "share of the light that is lost half a diagonal from the axis", default=0.5, minimum=0, maximum=1
    )
    radius_power: float = key("how late the loss begins: the power of the radius", default=2.0, minimum=0.5, maximum=12)
    cosine_power: float = key(
        "power of the cosine of the angle from the axis; 4 is the law of a thin lens", default=0.0, minimum=0, maximum=8
    )
    view_deg: float = key(
        "horizontal field of view, where the camera's intrinsics are unknown",
        default=90.0,
        unit="deg",
        minimum=1,
        maximum=170,
    )
    axis_across: float = key(
        "where the axis is, of the width, where intrinsics are unknown", default=0.5, minimum=-1, maximum=2
    )
    axis_down: float = key(
        "where the axis is, of the height, where intrinsics are unknown", default=0.5, minimum=-1, maximum=2
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "corner_loss": "Higher: the corners get darker; 1: black",
        "radius_power": "Higher: the loss begins nearer to the corners",
        "cosine_power": "Higher: the border gets darker, in a wide view most; 4 as behind a thin lens",
        "view_deg": "Higher: a wider view, in which the law of the cosine darkens more",
        "axis_across": "Higher: the brightest place is further right",
        "axis_down": "Higher: the brightest place is further down",
    }


def gain(parameters: Vignetting, context: FrameContext, size_px: tuple[int, int]) -> NDArray[np.float32]:
    """Return which share of the light each pixel gets, (H, W) float32. size_px: width, height."""
    width, height = size_px
    column, row = axis_px(context.intrinsics, size_px, parameters.axis_across, parameters.axis_down)
    camera = camera_of(context.intrinsics, size_px, parameters.view_deg)
    x, y = np.arange(width) - column, (np.arange(height) - row)[:, None]
    reach = math.hypot(width, height) / 2
    passed = 1.0 - parameters.corner_loss * ((x * x + y * y) / reach**2) ** (parameters.radius_power / 2)
    square = 1.0 + (x / camera.fx_px) ** 2 + (y / camera.fy_px) ** 2
    return (np.maximum(passed, 0.0) * square ** (-parameters.cosine_power / 2)).astype(np.float32)


def apply(rgb: NDArray[np.float32], parameters: Vignetting, context: FrameContext) -> NDArray[np.float32]:
    """Darken the border of (H, W, 3)."""
    light = decoded(rgb)
    light *= gain(parameters, context, (rgb.shape[1], rgb.shape[0]))[..., None]
    return encoded(light)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Multiply the light by what passes."""
    graph, image = canvas.graph, canvas.image
    with graph.section("From the axis"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
        x = (share.x - given["axis_across"]) * canvas.width_px
        y = (1.0 - share.y - given["axis_down"]) * canvas.height_px
        square = graph.math("MULTIPLY_ADD", x, x, y * y)
    with graph.section("Barrel"):
        reach = graph.math("MULTIPLY_ADD", canvas.width_px, canvas.width_px, canvas.height_px * canvas.height_px) * 0.25
        lost = given["corner_loss"] * graph.math("POWER", square / reach, given["radius_power"] * 0.5)
        passed = graph.math("MAXIMUM", 1.0 - lost, 0.0)
    with graph.section("Cosine"):
        focal = canvas.width_px * 0.5 / graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
        slope = square / (focal * focal) + 1.0
        cosine = graph.math("POWER", slope, given["cosine_power"] * -0.5)
    with graph.section("Light"):
        factor = passed * cosine
        return image * graph.vector(factor, factor, factor)


def by_camera(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the parameters that intrinsics decide: the field of view and the axis."""
    return {**view_by_camera(intrinsics), **axis_by_camera(intrinsics)}


PERTURBATION = ColourPerturbation(
    name="vignetting",
    label="Vignetting",
    stage="lens",
    order=56,
    parameters=Vignetting,
    severities={"corner_loss": (0.2, 0.35, 0.5, 0.65, 0.8)},
    source="our own: chosen, from a lens that is stopped down to a cheap one wide open",
    about=About(
        "Darkens the image towards its corners, as lenses do",
        "light is lost towards the corners, on linear light ([the camera](camera.md))",
    ),
    apply=apply,
    repeatable=True,
    nodes=Nodes(build, linear=True, by_camera=by_camera),
)
