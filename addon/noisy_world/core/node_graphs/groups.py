# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation as a node group: the sockets and conversions that all groups share, around each group's own nodes.

A group's own nodes work on sRGB-encoded values in [0, 1], as the definitions do, or on linear light of any brightness,
as the perturbation says. A group takes and gives scene-linear light and converts where it has to; with `Encoded` on, it
takes and gives encoded values.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, get_type_hints

from ..errors import NoisyWorldError
from ..labels import american, parameter_label
from ..perturbing.kinds import ColourPerturbation, Perturbation
from ..streams import stream
from .camera import CameraSockets, camera_sockets
from .graph import Graph, GroupInput, Kind, Socket, Value

REFERENCE_WIDTH_PX = 1200  # of Replica's sequences, whose severities these are
SEEDS = 2**24  # float32 holds the whole numbers below this exactly
PURPOSES = 32  # fields of random numbers that a group may draw for a frame; chosen
LARGEST_FRAME = 2**24 // PURPOSES  # frame x PURPOSES + purpose keys the noise and has to be exact in float32

BACK = "From encoded colour"
IMAGE_INPUT = GroupInput("Image", "color", (0.5, 0.5, 0.5, 1.0), "The frame")
DEPTH_INPUT = GroupInput("Depth", "float", 1.0, "Planar depth: the Depth pass", 0.0, subtype="DISTANCE")
REFERENCE_INPUT = GroupInput(
    "Reference Width",
    "int",
    REFERENCE_WIDTH_PX,
    "The frame's full width: sizes in pixels are meant at it, and follow the image where that is smaller",
    minimum=1,
    maximum=65500,
    subtype="PIXEL",
)
ENCODED_INPUT = GroupInput("Encoded", "bool", False, "The image is sRGB-encoded already, and is to be given so")

_SUBTYPES = {"px": "PIXEL", "deg": "ANGLE", "m": "DISTANCE"}


@dataclass(frozen=True)
class Canvas:
    """What a perturbation builds on.

    image: encoded, in [0, 1], or linear light of any brightness, as the perturbation says; its alpha has no meaning.
    width_px, height_px: of the input image, one number each. scale: pixels of the input image per pixel at the
    reference width. position_px: each pixel's column and row (x, y, 0) at the reference width, whole numbers, from the
    upper left. drift_frames: how many frames a kept pattern has moved on. depth_m: planar depth, 0 = void, in a group
    that asks for it. camera: how it stands and moves, in a group that asks for motion.
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
    depth_m: Socket | None = None
    camera: CameraSockets | None = None

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


def socket_name(parameter: str) -> str:
    """Return the name of a parameter's socket: its label, without the unit, which the socket's subtype gives."""
    return parameter_label(parameter)


def socket_value(perturbation: Perturbation, parameter: str, value: Any) -> Any:
    """Return a parameter's value in its socket's unit: angles are radians there."""
    info = next(item for item in fields(perturbation.parameters) if item.name == parameter).metadata["key"]
    return math.radians(value) if info.unit == "deg" else value


def seed_of(identifiers: tuple[str | int, ...]) -> int:
    """Return the value of the Seed socket for a stream: a random number drawn from it."""
    return int(stream(*identifiers, "compositor").integers(SEEDS))


def build_group(perturbation: ColourPerturbation, capacity: Mapping[str, float] | None = None) -> Graph:
    """Describe the node group of a perturbation of colour.

    capacity: for each parameter that the number of nodes depends on, the largest value to serve; by default that of
    the perturbation. Raises NoisyWorldError where the perturbation has no group.
    """
    if perturbation.build is None:
        raise NoisyWorldError(f"{perturbation.name}: has no node group; the backend reference carries it out")
    served = dict(perturbation.capacity) | dict(capacity or {})
    more = [f"{socket_name(name)} {value:g}" for name, value in served.items() if value != perturbation.capacity[name]]
    name = " ".join([f"NW {perturbation.label}", *([f"({', '.join(more)})"] if more else [])])
    text = " ".join((perturbation.parameters.__doc__ or "").split("\n\n")[0].split())
    graph = Graph(
        name,
        f"{text} Takes and gives scene-linear colour, or encoded colour where Encoded is on",
        category="" if more else perturbation.stage,
        tags=("noisy world", perturbation.stage, perturbation.name),
    )
    image = graph.input(IMAGE_INPUT)
    depth_m = None
    if perturbation.needs_depth:
        depth_m = graph.input(
            GroupInput("Depth", "float", 1.0, "Planar depth: the Depth pass", 0.0, subtype="DISTANCE")
        )
    given = _parameters(graph, perturbation, served)
    timing = _timing(graph, perturbation)
    camera = camera_sockets(graph) if perturbation.uses_motion else None
    reference = graph.input(REFERENCE_INPUT)
    enabled = graph.input(GroupInput("Enabled", "bool", True, "Off: the image passes unchanged"))
    encoded = graph.input(ENCODED_INPUT)
    source = to_linear(graph, image, encoded) if perturbation.linear else to_encoded(graph, image, encoded)
    with graph.section("Size"):
        canvas = replace(_canvas(source, reference, timing, depth_m), camera=camera)
        scaled = {
            key: value * canvas.scale if _unit(perturbation, key) == "px" else value for key, value in given.items()
        }
        scaled = {
            key: value * (180 / math.pi) if _unit(perturbation, key) == "deg" else value
            for key, value in scaled.items()
        }
    with graph.section(perturbation.label):
        result = perturbation.build(canvas, scaled, served)
    back = from_linear if perturbation.linear else from_encoded
    given_back = back(graph, result, image, encoded)
    with graph.section(BACK):
        graph.output("Image", graph.choose(enabled, given_back, image), description="The perturbed frame")
    return graph


def to_encoded(graph: Graph, image: Socket, encoded: Socket) -> Socket:
    """Return the image's encoded colour, clipped to [0, 1]; an image that is encoded already is not converted."""
    with graph.section("To encoded colour"):
        return graph.choose(encoded, image, graph.clamp(convert(graph, image, "Linear Rec.709", "sRGB")))


def from_encoded(graph: Graph, result: Socket, image: Socket, encoded: Socket) -> Socket:
    """Clip encoded colour to [0, 1] and return it as the image was given: linear light with its alpha, or encoded."""
    with graph.section(BACK):
        clamped = graph.clamp(result)
        back = convert(graph, clamped, "sRGB", "Linear Rec.709")
        return graph.choose(encoded, clamped, _with_alpha_of(graph, back, image))


def to_linear(graph: Graph, image: Socket, encoded: Socket) -> Socket:
    """Return the image's linear light; an image that is linear already is not converted, whatever its brightness."""
    with graph.section("To linear light"):
        return graph.choose(encoded, convert(graph, image, "sRGB", "Linear Rec.709"), image)


def from_linear(graph: Graph, result: Socket, image: Socket, encoded: Socket) -> Socket:
    """Return linear light as the image was given: with its alpha and brightness, or encoded and clipped to [0, 1]."""
    with graph.section(BACK):
        clamped = graph.clamp(convert(graph, result, "Linear Rec.709", "sRGB"))
        return graph.choose(encoded, clamped, _with_alpha_of(graph, result, image))


def _with_alpha_of(graph: Graph, result: Socket, image: Socket) -> Socket:
    alpha = graph.node("CompositorNodeSeparateColor", {"Image": image}, {"mode": "RGB"}).out("Alpha", "float")
    kept = graph.node("CompositorNodeSetAlpha", {"Image": result, "Alpha": alpha, "Type": "Replace Alpha"})
    return kept.out("Image", "color")


def _unit(perturbation: Perturbation, parameter: str) -> str:
    return next(item for item in fields(perturbation.parameters) if item.name == parameter).metadata["key"].unit


def _parameters(graph: Graph, perturbation: Perturbation, served: Mapping[str, float]) -> dict[str, Socket]:
    """Add a socket for each parameter; its default is the value at severity 3."""
    hints = get_type_hints(perturbation.parameters)
    kinds: dict[Any, Kind] = {float: "float", int: "int", bool: "bool"}
    sockets = {}
    for item in fields(perturbation.parameters):
        info = item.metadata["key"]
        kind = kinds[hints[item.name]]
        default = socket_value(perturbation, item.name, item.default)
        low = info.minimum if info.above is None else info.above
        high = min(info.maximum, served.get(item.name, info.maximum)) if info.maximum is not None else None
        subtype = _SUBTYPES.get(info.unit, "FACTOR" if kind == "float" and (low, high) == (0, 1) else "NONE")
        limits = [None if bound is None else socket_value(perturbation, item.name, bound) for bound in (low, high)]
        meaning = american(info.meaning[0].upper() + info.meaning[1:])
        sockets[item.name] = graph.input(
            GroupInput(socket_name(item.name), kind, default, meaning, limits[0], limits[1], subtype)
        )
    return sockets


def _timing(graph: Graph, perturbation: Perturbation) -> dict[str, Socket]:
    """Add the sockets that control randomness; none for a perturbation that draws nothing."""
    if not perturbation.temporals:
        return {}
    sockets = {
        "seed": graph.input(
            GroupInput("Seed", "int", 0, "Another seed, another pattern; the same one, the same", 0, SEEDS - 1)
        ),
        "offset": graph.input(
            GroupInput("Frame Offset", "int", 0, "Added to the scene's frame, which keys the pattern", -(2**19), 2**19)
        ),
        "redraw": graph.input(GroupInput("Redraw", "bool", True, "A new pattern for each frame; off: one for all")),
    }
    if "drift" in perturbation.temporals:
        sockets["drift"] = graph.input(
            GroupInput("Drift", "bool", False, "Where the pattern is one for all frames, it moves smoothly")
        )
    return sockets


def convert(graph: Graph, image: Socket, source: str, target: str) -> Socket:
    """Convert between colour spaces, named as Blender does."""
    properties = {"from_color_space": source, "to_color_space": target}
    return graph.node("CompositorNodeConvertColorSpace", {"Image": image}, properties).out("Image", "color")


def _canvas(image: Socket, reference: Socket, timing: Mapping[str, Socket], depth_m: Socket | None) -> Canvas:
    graph = image.graph
    size = graph.node("CompositorNodeImageInfo", {"Image": image}).out("Resolution", "vector")
    width, height = size.x, size.y
    scale = graph.math("DIVIDE", width, reference, label="Pixels for a reference pixel")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
    # From pixels of a small preview, counted from its lower left, to whole pixels of the full frame from its upper
    # left.
    flipped = graph.vector(0.5, height - 0.5)
    centre = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), flipped)
    position = graph.math("FLOOR", graph.math("DIVIDE", centre, graph.vector(scale, scale, 1.0)), label="Position")
    if not timing:
        return Canvas(graph, image, width, height, scale, position, depth_m=depth_m)
    now = graph.node("CompositorNodeSceneTime", {}).out("Frame", "float") + timing["offset"]
    key = now * timing["redraw"]
    drift: Value = now - key
    drift = drift * timing["drift"] if "drift" in timing else 0.0
    return Canvas(graph, image, width, height, scale, position, timing["seed"], key, drift, depth_m)
