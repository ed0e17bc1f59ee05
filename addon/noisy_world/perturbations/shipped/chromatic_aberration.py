# SPDX-License-Identifier: GPL-3.0-or-later
"""Lateral chromatic aberration: a lens magnifies red and blue otherwise than green, so edges have coloured fringes."""

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
from ._arrays import axis_by_camera, axis_px


@dataclass(frozen=True)
class ChromaticAberration:
    """Red and blue are resampled from images that are magnified about the axis; green stays. The border is repeated."""

    red_px: float = key(
        "how far outwards red is, half a diagonal from the axis", default=1.5, unit="px", minimum=-50, maximum=50
    )
    blue_px: float = key(
        "how far outwards blue is, half a diagonal from the axis", default=-1.5, unit="px", minimum=-50, maximum=50
    )
    axis_across: float = key(
        "where the axis is, of the width, where intrinsics are unknown", default=0.5, minimum=-1, maximum=2
    )
    axis_down: float = key(
        "where the axis is, of the height, where intrinsics are unknown", default=0.5, minimum=-1, maximum=2
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "red_px": "Further from 0: wider fringes of red near the corners; above 0 outwards",
        "blue_px": "Further from 0: wider fringes of blue near the corners; above 0 outwards",
        "axis_across": "Higher: what has no fringes is further right",
        "axis_down": "Higher: what has no fringes is further down",
    }


def apply(rgb: NDArray[np.float32], parameters: ChromaticAberration, context: FrameContext) -> NDArray[np.float32]:
    """Magnify red and blue of (H, W, 3) apart."""
    height, width = rgb.shape[:2]
    axis = axis_px(context.intrinsics, (width, height), parameters.axis_across, parameters.axis_down)
    reach_px = math.hypot(width, height) / 2
    made = rgb.copy()
    for channel, out_px in ((0, parameters.red_px), (2, parameters.blue_px)):
        made[..., channel] = _magnified(rgb[..., channel], 1.0 + out_px / reach_px, axis)
    return made


def _magnified(plane: NDArray[np.float32], times: float, axis: tuple[float, float]) -> NDArray[np.float32]:
    """Return a channel (H, W) magnified about the axis (column, row): interpolated along rows, then along columns."""
    if times == 1.0:
        return plane
    for along, middle in ((0, axis[1]), (1, axis[0])):
        count = plane.shape[along]
        place = np.clip(middle + (np.arange(count) - middle) / times, 0.0, count - 1.0)
        first = np.floor(place).astype(np.intp)
        part = (place - first).astype(np.float32)
        part = part[:, None] if along == 0 else part
        after = np.minimum(first + 1, count - 1)
        plane = np.take(plane, first, axis=along) * (1 - part) + np.take(plane, after, axis=along) * part
    return plane


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Look red and blue up where they come from."""
    graph, image = canvas.graph, canvas.image
    with graph.section("Places"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
        axis = graph.vector(given["axis_across"], 1.0 - given["axis_down"])
        size = graph.vector(canvas.width_px, canvas.height_px)
        reach = graph.math("LENGTH", size) * 0.5
        offset = graph.math("SUBTRACT", share, axis)
    parts: list[Socket] = [image * (0.0, 1.0, 0.0)]
    for name, only in (("red_px", (1.0, 0.0, 0.0)), ("blue_px", (0.0, 0.0, 1.0))):
        with graph.section("Red" if name == "red_px" else "Blue"):
            times = reach / (reach + given[name])
            where = graph.math("MULTIPLY_ADD", offset, graph.vector(times, times), axis) * (1.0, 1.0, 0.0) + (
                0.0,
                0.0,
                1.0,
            )
            inputs = {"Image": image, "UV": where, "Interpolation": "Bilinear"}
            extended = {"Extension X": "Extend", "Extension Y": "Extend"}
            found = graph.node("CompositorNodeMapUV", inputs | extended).out("Image", "color")
            parts.append(found * only)
    with graph.section("Together"):
        return parts[0] + parts[1] + parts[2]


PERTURBATION = ColourPerturbation(
    name="chromatic_aberration",
    label="Chromatic aberration",
    stage="lens",
    order=54,
    parameters=ChromaticAberration,
    severities={"red_px": (0.5, 1.0, 1.5, 2.5, 4.0), "blue_px": (-0.5, -1.0, -1.5, -2.5, -4.0)},
    source="our own: chosen, from a lens that is hardly seen to have it to a cheap wide one",
    about=About(
        "Moves red outwards and blue inwards, so edges near the border have coloured fringes",
        "red and blue are magnified otherwise than green, about the optical axis ([the camera](camera.md))",
    ),
    apply=apply,
    averages=True,
    repeatable=True,
    nodes=Nodes(build, by_camera=axis_by_camera),
)
