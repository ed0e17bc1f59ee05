# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation as a node group: the sockets and conversions that all groups share, around each group's own nodes.

A group's own nodes work on sRGB-encoded values in [0, 1], as the definitions do, or on linear light of any brightness,
as the perturbation says. A group takes and gives scene-linear light and converts where it has to; with `Encoded` on, it
takes and gives encoded values.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ..errors import NoisyWorldError
from ..labels import title
from ..perturbing.kinds import ColourPerturbation
from .camera import (
    CAMERA_PANEL,
    OVERRIDE_CAMERA_INPUT,
    CameraSockets,
    camera_sockets,
    looks_at_scene,
    of_scene,
    scene_values,
)
from .graph import Graph, Kind, Socket, Value
from .group_inputs import (
    CLIP_INPUT,
    DEPTH_INPUT,
    ENABLED_INPUT,
    ENCODED_INPUT,
    IMAGE_INPUT,
    MASK_INPUT,
    OVERRIDE_INPUT,
    REFERENCE_INPUT,
    SEVERITY_INPUT,
    frame_inputs,
    parameter_inputs,
    socket_name,
    timing_sockets,
    unit_of,
)
from .light import BACK, Light, convert
from .severity_table import by_severity, strength

__all__ = ["PURPOSES", "Canvas", "build_group", "convert", "group_name", "socket_name"]

PURPOSES = 32  # fields of random numbers that a group may draw for a frame; chosen
LARGEST_FRAME = 2**24 // PURPOSES  # frame x PURPOSES + purpose keys the noise and has to be exact in float32
# Added to a number of less than 2^22 and subtracted again, it rounds as the processor does, ties to the even number: of
# float32's numbers from 2^23 on, only whole ones are left.
ROUNDING = 1.5 * 2.0**23
HALF = 0.5 - 2**-6  # subtracted before rounding instead of rounding down: whole numbers stay, clear of a tie
BRIGHTEST = 1e6  # chosen: no light of a scene is brighter, and float32 holds it with room


@dataclass(frozen=True)
class Canvas:
    """What a perturbation builds on.

    image: encoded, in [0, 1], or linear light of any brightness, as the perturbation says; its alpha has no meaning.
    width_px, height_px: of the input image, one number each. scale: pixels of the input image per pixel at the
    reference width. position_px: each pixel's column and row (x, y, 0) at the reference width, whole numbers, from the
    upper left. drift_frames: how many frames a kept pattern has moved on. drifts: 1 where it moves at all.
    depth_m: planar depth, 0 = void, in a group that asks for it. white: the brightest encoded value that there is; 1,
    or far beyond where nothing is clipped. lit: 1 where nothing is clipped, as the image is light of any brightness,
    else 0.
    camera: how it stands and moves, in a group that asks for motion.
    """

    graph: Graph
    image: Socket
    width_px: Socket
    height_px: Socket
    scale: Socket
    position_px: Socket
    seed: Socket | None = None
    key: Socket | None = None
    drift_frames: Value = 0.0
    drifts: Value = 0.0
    depth_m: Socket | None = None
    white: Socket | float = 1.0
    lit: Socket | float = 0.0
    camera: CameraSockets | None = None

    @property
    def never_lit(self) -> bool:
        """Whether it is known that the image is clipped."""
        return not isinstance(self.lit, Socket) and self.lit == 0

    @property
    def always_lit(self) -> bool:
        """Whether it is known that the image is light of any brightness."""
        return not isinstance(self.lit, Socket) and self.lit == 1

    def random(self, purpose: int, position: Value = (0.0, 0.0, 0.0)) -> Socket:
        """Return three independent uniform numbers in [0, 1] for each position, of this seed and frame.

        purpose: from 0 to 31; each gives other numbers at the same position. position: whole numbers x and y, such as
        position_px; without it, the numbers are the same for the whole frame.
        """
        return self._white_noise(purpose, position, "Color", "vector")

    def random_value(self, purpose: int, position: Value = (0.0, 0.0, 0.0)) -> Socket:
        """Return one uniform number in [0, 1] for each position; faster than `random`."""
        return self._white_noise(purpose, position, "Value", "float")

    def _white_noise(self, purpose: int, position: Value, output: str, kind: Kind) -> Socket:
        if not 0 <= purpose < PURPOSES or self.seed is None or self.key is None:
            raise ValueError(
                f"{self.graph.name}: purpose {purpose} has to be from 0 to {PURPOSES - 1}, of a seeded group"
            )
        graph = self.graph
        w = graph.math("MULTIPLY_ADD", self.key, float(PURPOSES), float(purpose))
        if isinstance(position, Socket):
            where: Value = graph.math("ADD", position, graph.vector(0.0, 0.0, self.seed))
        else:
            where = graph.vector(0.0, 0.0, self.seed)
        node = graph.node("ShaderNodeTexWhiteNoise", {"Vector": where, "W": w}, {"noise_dimensions": "4D"})
        return node.out(output, kind)


def build_group(
    perturbation: ColourPerturbation,
    capacity: Mapping[str, float] | None = None,
    *,
    bare: bool = False,
    lit: bool = False,
) -> Graph:
    """Describe the node group of a perturbation of colour.

    capacity: for each parameter that the number of nodes depends on, the largest value to serve; by default that of
    the perturbation. bare: as the generator uses it, with the definition's own sockets only: without severity and mask,
    and always clipped. lit: for linear light, so never clipped, where it is bare. Raises NoisyWorldError where the
    perturbation has no group.
    """
    if perturbation.build is None:
        raise NoisyWorldError(f"{perturbation.name}: has no node group; the backend reference carries it out")
    served = dict(perturbation.capacity) | dict(capacity or {})
    larger = {name: value for name, value in served.items() if value != perturbation.capacity[name]}
    more = [f"{socket_name(perturbation, name)} {value:g}" for name, value in larger.items()]
    text = " ".join((perturbation.parameters.__doc__ or "").split("\n\n")[0].split())
    graph = Graph(
        group_name(perturbation) + (f" ({', '.join(more)})" if more else ""),
        f"{text} Takes and gives scene-linear colour, or encoded colour where Encoded is on",
        category="" if more else perturbation.stage,
        tags=("noisy world", perturbation.stage, perturbation.name),
    )
    image = graph.input(IMAGE_INPUT)
    depth_m = graph.input(DEPTH_INPUT) if perturbation.needs_depth else None
    mask = None if bare else graph.input(MASK_INPUT)
    severity = graph.input(SEVERITY_INPUT) if perturbation.group_severities and not bare else None
    enabled = graph.input(ENABLED_INPUT)
    given, override, own_camera = _parameters(graph, perturbation, served, severity, bare=bare)
    timing = timing_sockets(graph, perturbation)
    camera = camera_sockets(graph, own_camera) if perturbation.uses_motion else None
    reference, encoded = graph.input(REFERENCE_INPUT), graph.input(ENCODED_INPUT)
    light = Light(image, encoded, not lit if bare else graph.input(CLIP_INPUT))
    share = mask
    if severity is not None and override is not None and mask is not None:
        with graph.section("Severity"):
            given |= by_severity(perturbation, severity, override, given)
            share = strength(severity, override, mask)
    source = _given(light, perturbation)
    scenes = () if own_camera is None else of_scene(perturbation)
    with graph.section("Size"):
        canvas = _timed(_canvas(source, reference, depth_m, light.clip), perturbation, timing)
        canvas = replace(canvas, camera=camera)
        scaled = {
            key: _in_pixels_and_degrees(perturbation, key, value, canvas)
            for key, value in given.items()
            if key not in scenes
        }
    if own_camera is not None:
        with graph.section("The scene's lens"):
            seen = scene_values(graph, canvas.width_px, canvas.height_px)
            for key in scenes:
                value = graph.choose(own_camera, given[key], seen[key], "float")
                scaled[key] = _in_pixels_and_degrees(perturbation, key, value, canvas)
    with graph.section(perturbation.label):
        result = perturbation.build(canvas, scaled, served)
    given_back = _given_back(light, perturbation)(result, share)
    with graph.section(BACK):
        if depth_m is not None and not bare:
            given_back = graph.choose(_is_there(depth_m), given_back, image)
        graph.output("Image", graph.choose(enabled, given_back, image), description="The perturbed frame")
    return graph


def _is_there(depth_m: Socket) -> Socket:
    """Return 1 where a frame has depth at all, else 0: Blender gives 0 everywhere where an engine's view has none.

    Of a render, what has no surface is far away, so a whole frame of zeros is none.
    """
    found = depth_m.graph.node("CompositorNodeLevels", {"Image": depth_m, "Channel": "Red"}, label="Is there depth?")
    return found.out("Maximum", "float") > 0.0


def group_name(perturbation: ColourPerturbation) -> str:
    """Return the name of a perturbation's group."""
    return title(perturbation.label)


def _given(light: Light, perturbation: ColourPerturbation) -> Socket:
    """Return the image as a perturbation works on it."""
    if perturbation.linear:
        return light.to_linear()
    return light.to_average() if perturbation.averages else light.to_encoded()


def _given_back(light: Light, perturbation: ColourPerturbation) -> Callable[[Socket, Socket | None], Socket]:
    """Return what gives a perturbation's result back as the image was given."""
    if perturbation.linear:
        return light.from_linear
    return light.from_average if perturbation.averages else light.from_encoded


def _parameters(
    graph: Graph,
    perturbation: ColourPerturbation,
    served: Mapping[str, float],
    severity: Socket | None,
    *,
    bare: bool,
) -> tuple[dict[str, Socket], Socket | None, Socket | None]:
    """Add a socket for each parameter, or for what the group is told for a frame.

    With severity, the switch by which those of its table override it; unless it is bare, the switch by which those that
    the scene decides override that.
    """
    if not perturbation.has_parameter_sockets:
        return {name: graph.input(item) for name, item in frame_inputs(perturbation).items()}, None, None
    inputs = parameter_inputs(perturbation, served)
    scenes = () if bare else of_scene(perturbation)
    always = [name for name in inputs if name not in perturbation.severities and name not in scenes]
    given = {name: graph.input(inputs[name]) for name in always}
    override = None if severity is None else graph.input(OVERRIDE_INPUT)
    given |= {name: graph.input(item) for name, item in inputs.items() if name not in given and name not in scenes}
    own_camera = None if bare or not looks_at_scene(perturbation) else graph.input(OVERRIDE_CAMERA_INPUT)
    given |= {name: graph.input(replace(inputs[name], panel=CAMERA_PANEL)) for name in scenes}
    return {name: given[name] for name in inputs}, override, own_camera


def _in_pixels_and_degrees(perturbation: ColourPerturbation, name: str, value: Socket, canvas: Canvas) -> Socket:
    """Return a parameter as a perturbation builds on it: sizes in pixels of the image, angles in degrees."""
    unit = unit_of(perturbation, name) if perturbation.has_parameter_sockets else ""
    return value * canvas.scale if unit == "px" else value * (180 / math.pi) if unit == "deg" else value


def _canvas(image: Socket, reference: Socket, depth_m: Socket | None, clip: Socket | bool) -> Canvas:
    graph = image.graph
    size = graph.node("CompositorNodeImageInfo", {"Image": image}).out("Resolution", "vector")
    width, height = size.x, size.y
    scale = graph.math("DIVIDE", width, reference, label="Pixels for a reference pixel")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
    # From pixels of a small preview, counted from its lower left, to whole pixels of the full frame from its upper
    # left: (pixel + 1/2) / scale rounded down, by adding and subtracting, which takes an eighth of a division's time.
    each = graph.math("DIVIDE", 1.0, scale)
    first = graph.vector(0.5 * each - HALF, (height - 0.5) * each - HALF)
    place = graph.math("MULTIPLY_ADD", pixel, graph.vector(each, each * -1.0), first)
    position = graph.math("SUBTRACT", place + ROUNDING, ROUNDING, label="Position")
    if isinstance(clip, bool):
        white, lit = (1.0, 0.0) if clip else (BRIGHTEST, 1.0)
    else:
        white, lit = (graph.choose(clip, *ends, "float") for ends in ((1.0, BRIGHTEST), (0.0, 1.0)))
    return Canvas(graph, image, width, height, scale, position, depth_m=depth_m, white=white, lit=lit)


def _timed(canvas: Canvas, perturbation: ColourPerturbation, timing: Mapping[str, Socket]) -> Canvas:
    """Return the canvas with what keys its random numbers."""
    if not timing:
        return canvas
    graph = canvas.graph
    now = graph.node("CompositorNodeSceneTime", {}).out("Frame", "float") + timing["offset"]
    states: dict[str, Value] = dict.fromkeys(perturbation.temporals, 1.0)
    if "pattern" in timing:
        states |= zip(perturbation.temporals, graph.chosen(timing["pattern"]), strict=True)
    drifts = states.get("drift", 0.0)
    drift = now * drifts if "drift" in states else 0.0
    return replace(canvas, seed=timing["seed"], key=now * states.get("fresh", 0.0), drift_frames=drift, drifts=drifts)
