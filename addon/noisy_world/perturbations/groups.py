# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation as a node group: sockets, conversions and the camera that all groups share.

A perturbation as a node group: the sockets and conversions that all groups share, around each group's own nodes.

A group's own nodes work on sRGB-encoded values in [0, 1], as the definitions do, or on linear light of any brightness,
as the perturbation says. A group takes and gives scene-linear light and converts where it has to; with `Encoded` on, it
takes and gives encoded values.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ..core.camera_motion import CameraState
from ..core.errors import NoisyWorldError, american, parameter_label, title
from ..core.machine import batched
from ..core.node_graph import Graph, GroupInput, Kind, Panel, Socket, Value
from ..core.schema import label_of
from ..core.streams import stream
from .kinds import QUICK, SEVERITIES, ColourPerturbation, Nodes, Perturbation, Temporal
from .shares import has_colour, has_share

# The camera in node groups: the scene's own, by drivers, or sockets in its place; and how it moves, by sockets.
#
# Groups as people see them look at the camera of the scene that is composited. What the generator and the panel's chain
# evaluate is told by sockets, as it need not be that of a scene.


OVERRIDE_CAMERA = "Override Camera"
CAMERA_PANEL = Panel(
    OVERRIDE_CAMERA,
    "What the scene's camera and frame rate decide; switched on, these values are used",
    closed=True,
)
MOTION_PANEL = Panel("Camera Motion", "How the camera moves, which draws streaks", closed=True)
OVERRIDE_CAMERA_INPUT = GroupInput(
    OVERRIDE_CAMERA,
    "bool",
    False,
    "Use the values below instead of the scene's camera and frame rate",
    panel=CAMERA_PANEL,
    toggles=True,
)
FRAME_RATE, VIEW, AXIS_ACROSS, AXIS_DOWN = "frame_rate_hz", "view_deg", "axis_across", "axis_down"
SENSOR_MM = 36.0  # of a camera that is not there, which sees 90 degrees
VERTICAL_FIT, HORIZONTAL_FIT = 2, 1  # of a camera's sensor, as Blender numbers them; 0 is automatic

LOCATION_INPUT = GroupInput(
    "Camera Location", "vector", (0.0, 0.0, 0.0), "Where the camera is, in meters; z is up", panel=CAMERA_PANEL
)
ROTATION_INPUT = GroupInput(
    "Camera Rotation",
    "vector",
    (math.pi / 2, 0.0, 0.0),
    "The camera's rotation, XYZ Euler angles in radians",
    panel=CAMERA_PANEL,
)
VELOCITY_INPUT = GroupInput(
    "Camera Velocity",
    "vector",
    (0.0, 0.0, 0.0),
    "Meters a second along the world's axes; it draws streaks",
    panel=MOTION_PANEL,
)
TURNING_INPUT = GroupInput(
    "Camera Turning",
    "vector",
    (0.0, 0.0, 0.0),
    "Radians a second about the camera's own axes; it draws streaks",
    panel=MOTION_PANEL,
)
CAMERA_INPUTS = (LOCATION_INPUT, ROTATION_INPUT, VELOCITY_INPUT, TURNING_INPUT)


@dataclass(frozen=True)
class CameraSockets:
    """The camera in a group: location, velocity, in the world; turning, about its own axes right, up and back.

    right, up, back: its own axes in the world.
    """

    location: Socket
    velocity: Socket
    turning: Socket
    right: Socket
    up: Socket
    back: Socket

    def to_own(self, vector: Socket) -> Socket:
        """Return a vector of the world in the camera's axes: right, down, forward."""
        graph = vector.graph
        right, up, back = (graph.math("DOT_PRODUCT", vector, axis) for axis in (self.right, self.up, self.back))
        return graph.vector(right, up * -1.0, back * -1.0)


def looks_at_scene(perturbation: ColourPerturbation) -> bool:
    """Tell whether a perturbation's group, as people see it, looks at the scene's camera or frame rate."""
    return perturbation.uses_motion or bool(of_scene(perturbation))


def of_scene(perturbation: ColourPerturbation) -> tuple[str, ...]:
    """Return the parameters of a perturbation that the scene decides, in a group as people see it."""
    names = [item.name for item in fields(perturbation.parameters)] if perturbation.has_parameter_sockets else []
    by_camera = (
        (VIEW, AXIS_ACROSS, AXIS_DOWN)
        if perturbation.nodes is not None and perturbation.nodes.by_camera is not None
        else ()
    )
    return tuple(name for name in names if name == FRAME_RATE or name in by_camera)


def scene_values(graph: Graph, width_px: Socket, height_px: Socket) -> dict[str, Socket]:
    """Return each of these parameters as the scene has it: an angle in radians, shares, frames a second.

    width_px, height_px: of the image. By Blender's rule, as in `camera_parameters`.
    """
    fit, lens = graph.of_scene("camera.data.sensor_fit", 0.0), graph.of_scene("camera.data.lens", SENSOR_MM / 2)
    width_mm, height_mm = (graph.of_scene(f"camera.data.sensor_{name}", SENSOR_MM) for name in ("width", "height"))
    shift_x, shift_y = (graph.of_scene(f"camera.data.shift_{axis}", 0.0) for axis in "xy")
    wide, tall = (graph.of_scene(f"render.pixel_aspect_{axis}", 1.0) for axis in "xy")
    high = height_px * (tall / wide)  # in pixels as wide as the image's
    vertical = graph.math("GREATER_THAN", fit, VERTICAL_FIT - 0.5)
    automatic = graph.math("LESS_THAN", fit, HORIZONTAL_FIT - 0.5)
    side_px = graph.mix(width_px, high, graph.math("MAXIMUM", vertical, automatic * (high > width_px)))
    half = graph.mix(width_mm, height_mm, vertical) * width_px / (lens * side_px * 2.0)
    return {
        VIEW: graph.math("ARCTANGENT", half) * 2.0,
        AXIS_ACROSS: 0.5 - shift_x * side_px / width_px,
        AXIS_DOWN: 0.5 + shift_y * side_px / high,
        FRAME_RATE: graph.of_scene("render.fps", 24.0) / graph.of_scene("render.fps_base", 1.0),
    }


def camera_sockets(graph: Graph, override: Socket | None) -> CameraSockets:
    """Add the inputs to a group. override: whether they count instead of the scene's camera; None for always."""
    location, rotation, velocity, turning = (graph.input(item) for item in CAMERA_INPUTS)
    with graph.section("Camera's axes"):
        sines, cosines = graph.math("SINE", rotation), graph.math("COSINE", rotation)
        (sx, sy, sz), (cx, cy, cz) = ((of.x, of.y, of.z) for of in (sines, cosines))
        right = graph.vector(cz * cy, sz * cy, sy * -1.0)
        up = graph.vector(cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx)
        back = graph.vector(cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx)
    if override is not None:
        with graph.section("The scene's camera"):
            axes = [_column(graph, place) for place in range(4)]
            *turned, stands = (graph.math("NORMALIZE", axis) if place < 3 else axis for place, axis in enumerate(axes))
            by_hand = (right, up, back, location)
            right, up, back, location = (
                graph.choose(override, hand, own, "vector")
                for hand, own in zip(by_hand, (*turned, stands), strict=True)
            )
    return CameraSockets(location, velocity, turning, right, up, back)


def _column(graph: Graph, place: int) -> Socket:
    """Return a column of the camera's matrix in the world: one of its axes, or its location."""
    level = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, 0.0))[place]
    x, y, z = (graph.of_scene(f"camera.matrix_world[{place}][{row}]", level[row]) for row in range(3))
    return graph.vector(x, y, z)


def camera_values(camera_state: CameraState) -> Mapping[str, Any]:
    """Return the values of the sockets, by name."""
    return dict(zip((item.name for item in CAMERA_INPUTS), camera_state.as_blender(), strict=True))


# The sockets of a perturbation's node group: what all groups have, and what its parameters and patterns ask for.


REFERENCE_WIDTH_PX = 1200  # of Replica's sequences, whose severities these are
SEEDS = 2**24  # float32 holds the whole numbers below this exactly
MOST_SEVERE = 5.0

OVERRIDE, PATTERN = "Override Severity", "Pattern"
OVERRIDE_PANEL = Panel(OVERRIDE, "What Severity decides; switched on, these values are used instead")
PATTERN_PANEL = Panel("Random Pattern", "Which random pattern, and how it changes from frame to frame")
IMAGE_PANEL = Panel("Image Options", "How the image is given and is to be given", closed=True)

IMAGE_INPUT = GroupInput("Image", "color", (0.5, 0.5, 0.5, 1.0), "The frame")
DEPTH_INPUT = GroupInput("Depth", "float", 1.0, "Planar depth: the Depth pass", 0.0, subtype="DISTANCE")
MASK_INPUT = GroupInput("Mask", "float", 1.0, "Where the effect shows: 0 nowhere, 1 wholly", 0.0, 1.0, "FACTOR")
MIX_INPUT = GroupInput("Mix", "float", 1.0, "How much of the effect shows: 0 nothing, 1 all", 0.0, 1.0, "FACTOR")
COLOUR_INPUT = GroupInput(
    "Color", "color", (1.0, 1.0, 1.0, 1.0), "How much of the effect shows in red, green and blue; white: all"
)
SEVERITY_INPUT = GroupInput(
    "Severity", "float", 3.0, "How strong: 1 to 5 as in presets, less than 1 fades it out, 0 is off", 0.0, MOST_SEVERE
)
OVERRIDE_INPUT = GroupInput(
    OVERRIDE, "bool", False, "Use the values below instead of those of Severity", panel=OVERRIDE_PANEL, toggles=True
)
ENABLED_INPUT = GroupInput("Enabled", "bool", True, "Off: the image passes unchanged")
SEED_INPUT = GroupInput(
    "Seed", "int", 0, "Another seed, another pattern; the same one, the same", 0, SEEDS - 1, panel=PATTERN_PANEL
)
OFFSET_INPUT = GroupInput(
    "Frame Offset",
    "int",
    0,
    "Added to the scene's frame, which keys the pattern",
    -(2**19),
    2**19,
    panel=PATTERN_PANEL,
)
REFERENCE_INPUT = GroupInput(
    "Reference Width",
    "int",
    REFERENCE_WIDTH_PX,
    "The frame's full width: sizes in pixels are meant at it, and follow the image where that is smaller",
    minimum=1,
    maximum=65500,
    subtype="PIXEL",
    panel=IMAGE_PANEL,
)
ENCODED_INPUT = GroupInput(
    "Encoded", "bool", False, "The image is sRGB-encoded already, and is to be given so", panel=IMAGE_PANEL
)
CLIP_INPUT = GroupInput(
    "Clip", "bool", False, "Cut off what is brighter than white, as an image file does", panel=IMAGE_PANEL
)

_MEANINGS: Mapping[Temporal, str] = {
    "fresh": "Fresh: a new random pattern for each frame",
    "fixed": "Fixed: one for all",
    "drift": "Drift: one that moves smoothly",
}
_SUBTYPES = {"px": "PIXEL", "deg": "ANGLE", "m": "DISTANCE"}


def socket_name(perturbation: Perturbation, name: str) -> str:
    """Return the name of the socket of a parameter, or of a value told for a frame: its label, without the unit.

    The socket's subtype gives that.
    """
    parameters = perturbation.parameters
    return label_of(parameters, name) if name in parameters.__dataclass_fields__ else parameter_label(name)


def socket_value(perturbation: Perturbation, parameter: str, value: Any) -> Any:
    """Return a parameter's value as its socket has it: angles are radians there, and texts items of a menu."""
    if isinstance(value, str):
        return title(value)
    return math.radians(value) if unit_of(perturbation, parameter) == "deg" else value


def unit_of(perturbation: Perturbation, parameter: str) -> str:
    """Return a parameter's unit."""
    return next(item for item in fields(perturbation.parameters) if item.name == parameter).metadata["key"].unit


def seed_of(identifiers: tuple[str | int, ...]) -> int:
    """Return the value of the Seed socket for a stream: a random number drawn from it."""
    return int(stream(*identifiers, "compositor").integers(SEEDS))


def parameter_inputs(perturbation: Perturbation, served: Mapping[str, float]) -> dict[str, GroupInput]:
    """Return an input for each parameter; its default is that of a new step, at severity 3.

    served: largest values, by name.
    """
    return {
        item.name: _parameter_input(perturbation, item.name, served.get(item.name))
        for item in fields(perturbation.parameters)
    }


def frame_inputs(perturbation: ColourPerturbation) -> dict[str, GroupInput]:
    """Return an input for each value that a group is told for a frame."""
    values = {} if perturbation.nodes is None else perturbation.nodes.values
    return {
        name: GroupInput(
            socket_name(perturbation, name), "float", item.default, american(item.meaning), item.minimum, item.maximum
        )
        for name, item in values.items()
    }


def _parameter_input(perturbation: Perturbation, name: str, served: float | None) -> GroupInput:
    item = next(item for item in fields(perturbation.parameters) if item.name == name)
    info, hint = item.metadata["key"], get_type_hints(perturbation.parameters)[name]
    begins = item.default if hint is int else perturbation.newly.get(name, item.default)
    default = socket_value(perturbation, name, begins)
    meaning = american(info.meaning[0].upper() + info.meaning[1:])
    panel = OVERRIDE_PANEL if name in perturbation.severities else None
    if get_origin(hint) is Literal:
        items = tuple(title(value) for value in get_args(hint))
        return GroupInput(socket_name(perturbation, name), "menu", default, meaning, panel=panel, items=items)
    kinds: dict[Any, Kind] = {float: "float", int: "int", bool: "bool"}
    kind = kinds[hint]
    low = info.minimum if info.above is None else info.above
    high = info.maximum if served is None or info.maximum is None else min(info.maximum, served)
    subtype = _SUBTYPES.get(info.unit, "FACTOR" if kind == "float" and (low, high) == (0, 1) else "NONE")
    limits = [None if bound is None else socket_value(perturbation, name, bound) for bound in (low, high)]
    return GroupInput(socket_name(perturbation, name), kind, default, meaning, limits[0], limits[1], subtype, panel)


def timing_sockets(graph: Graph, perturbation: ColourPerturbation) -> dict[str, Socket]:
    """Add the sockets that control randomness: pattern, seed, offset; none where nothing is drawn."""
    if not perturbation.group_temporals:
        return {}
    inputs = {"pattern": _pattern_input(perturbation)} if len(perturbation.temporals) > 1 else {}
    inputs |= {"seed": SEED_INPUT, "offset": OFFSET_INPUT}
    return {name: graph.input(item) for name, item in inputs.items()}


def _pattern_input(perturbation: ColourPerturbation) -> GroupInput:
    return GroupInput(
        PATTERN,
        "menu",
        title(perturbation.natural),
        ". ".join(_MEANINGS[item] for item in perturbation.temporals),
        panel=PATTERN_PANEL,
        items=tuple(title(item) for item in perturbation.temporals),
    )


# A group's image at its input and output: scene-linear or encoded, clipped or not.
#
# The encoding is sRGB's. Above 1 its power goes on, so light comes back as it was; what a group gives is never
# negative.


BACK = "From encoded colour"
DARK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Light:
    """A group's image and how it is given.

    encoded: whether it is encoded already. clip: whether what is brighter than white is cut off; what is darker than
    black always is.
    """

    image: Socket
    encoded: Socket
    clip: Socket | bool = True

    def to_encoded(self) -> Socket:
        """Return the image's encoded colour; an image that is encoded already is not converted."""
        graph = self.image.graph
        with graph.section("To encoded colour"):
            colour = self.clipped(convert(graph, self.image, "Linear Rec.709", "sRGB"))
            return graph.choose(self.encoded, self.image, colour)

    def to_linear(self) -> Socket:
        """Return the image's linear light; an image that is linear already is not converted."""
        graph = self.image.graph
        with graph.section("To linear light"):
            return graph.choose(self.encoded, convert(graph, self.image, "sRGB", "Linear Rec.709"), self.image)

    def to_average(self) -> Socket:
        """Return the image as it is where light is not clipped, else encoded: for what only averages."""
        if self.clip is False:
            return self.image
        if self.clip is True:
            return self.to_encoded()
        graph, coded = self.image.graph, self.to_encoded()
        with graph.section("To light or encoded colour"):
            return graph.choose(self.clip, coded, self.image)

    def from_average(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return averages of what `to_average` gives as the image was given. share: as in `from_encoded`."""
        if self.clip is True:
            return self.from_encoded(result, share)
        graph = self.image.graph
        with graph.section(BACK):
            light = self._with_alpha(graph, self._mixed(graph.math("MAXIMUM", result, DARK), share))
        if self.clip is False:
            return light
        coded = self.from_encoded(result, share)
        with graph.section(BACK):
            return graph.choose(self.clip, coded, light)

    def from_encoded(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return encoded colour as the image was given: linear light with its alpha, or encoded.

        share: of the result, the rest being the image; None: all of it.
        """
        graph = self.image.graph
        with graph.section(BACK):
            clipped = self.clipped(result)
            back = self._mixed(convert(graph, clipped, "sRGB", "Linear Rec.709"), share)
            return graph.choose(self.encoded, self._mixed(clipped, share), self._with_alpha(graph, back))

    def from_linear(self, result: Socket, share: Socket | None = None) -> Socket:
        """Return linear light as the image was given: with its alpha, or encoded. share: as in `from_encoded`."""
        graph = self.image.graph
        with graph.section(BACK):
            back = self._mixed(self.clipped(convert(graph, result, "Linear Rec.709", "sRGB")), share)
            light = result if self.clip is True else self.clipped(result)
            return graph.choose(self.encoded, back, self._with_alpha(graph, self._mixed(light, share)))

    def clipped(self, value: Socket) -> Socket:
        """Return values clipped to [0, 1], if they are to be; else those below 0 alone."""
        graph = value.graph
        if self.clip is True:
            return graph.clamp(value)
        lit = graph.math("MAXIMUM", value, DARK)
        return lit if self.clip is False else graph.choose(self.clip, graph.clamp(value), lit)

    def _mixed(self, result: Socket, share: Socket | None) -> Socket:
        return result if share is None else result.graph.blend(self.image, result, share)

    def _with_alpha(self, graph: Graph, result: Socket) -> Socket:
        alpha = graph.node("CompositorNodeSeparateColor", {"Image": self.image}, {"mode": "RGB"}).out("Alpha", "float")
        inputs = {"Image": result, "Alpha": alpha, "Type": "Replace Alpha"}
        return graph.node("CompositorNodeSetAlpha", inputs).out("Image", "color")


def convert(graph: Graph, image: Socket, source: str, target: str) -> Socket:
    """Convert between colour spaces, named as Blender does."""
    properties = {"from_color_space": source, "to_color_space": target}
    return graph.node("CompositorNodeConvertColorSpace", {"Image": image}, properties).out("Image", "color")


# A perturbation's table of severities as nodes: one socket decides all parameters that the table has.


def by_severity(
    perturbation: Perturbation, severity: Socket, override: Socket, own: Mapping[str, Socket]
) -> dict[str, Socket]:
    """Return each parameter of the table at a severity, or `own` where `override` is on.

    Between levels it is interpolated linearly, as Perturbation.at_severity does; at whole levels it is the table's
    value to the bit, and below 1 that of level 1.
    """
    graph = severity.graph
    inputs = {"Value": severity, "Min": float(SEVERITIES[0]), "Max": float(SEVERITIES[-1])}
    level = graph.node("ShaderNodeClamp", inputs, label="Level").out("Result", "float")
    ends = graph.math("FLOOR", level), graph.math("CEIL", level)
    between = graph.math("FRACT", level)
    found: dict[str, Socket] = {}
    for names in batched(perturbation.severities, 3):
        tables = {None: perturbation.severities, **perturbation.other_severities}
        at: dict[str | None, Socket] = {}
        for switch, table in tables.items():
            lower, upper = (_looked_up(perturbation, table, names, end) for end in ends)
            at[switch] = graph.blend(lower, upper, between)
        value = at[None]
        for switch in perturbation.other_severities:
            value = graph.choose(own[switch], at[switch], value, value.kind)
        for name, at_level in zip(names, (value,) if len(names) == 1 else (value.x, value.y, value.z), strict=False):
            whole = graph.math("FLOOR", at_level + 0.5) if name in perturbation.counts else at_level
            if name in perturbation.stretched:
                whole = whole * own[perturbation.stretched[name]]
            found[name] = graph.choose(override, own[name], whole, own[name].kind)
    return found


def _looked_up(
    perturbation: Perturbation, table: Mapping[str, Sequence[float]], names: Sequence[str], level: Socket
) -> Socket:
    """Return the values of up to three parameters at a whole level: one number, or a vector."""
    rows = [
        [socket_value(perturbation, name, float(table[name][place])) for name in names]
        for place in range(len(SEVERITIES))
    ]
    items: list[Value] = [row[0] if len(names) == 1 else tuple((*row, 0.0, 0.0)[:3]) for row in rows]
    inputs: dict[str, Any] = {"Index": level, "Item_0": items[0]}  # there is no level 0
    inputs |= {f"Item_{place}": item for place, item in zip(SEVERITIES, items, strict=True)}
    kind = "FLOAT" if len(names) == 1 else "VECTOR"
    label = ", ".join(socket_name(perturbation, name) for name in names)
    properties = {"data_type": kind, "items": len(items) + 1}
    made = level.graph.node("GeometryNodeIndexSwitch", inputs, properties, label=label)
    return made.out("Output", "float" if len(names) == 1 else "vector")


def strength(severity: Socket, override: Socket, share: Socket) -> Socket:
    """Return the share of the effect that shows, faded out below severity 1 unless `override` is on."""
    graph = severity.graph
    fade = graph.math("MINIMUM", severity, 1.0)
    return share * graph.choose(override, 1.0, fade, "float")


__all__ = ["PURPOSES", "Canvas", "build_group", "convert", "group_name", "socket_name"]

PURPOSES = 32  # fields of random numbers that a group may draw for a frame; chosen
LARGEST_FRAME = 2**24 // PURPOSES  # frame x PURPOSES + purpose keys the noise and has to be exact in float32
# Added to a number of less than 2^22 and subtracted again, it rounds as the processor does, ties to the even number: of
# float32's numbers from 2^23 on, only whole ones are left.
ROUNDING = 1.5 * 2.0**23
HALF = 0.5 - 2**-6  # subtracted before rounding instead of rounding down: whole numbers stay, clear of a tie
_FOUR = {"noise_dimensions": "4D"}
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
    camera: how it stands and moves, in a group that asks for motion. quick: of a group whose perturbation has such a
    parameter, the switch by which its pixels' random numbers take half the time.
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
    quick: Socket | None = None

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
        of_frame = graph.vector(0.0, 0.0, self.seed)
        where = graph.math("ADD", position, of_frame) if isinstance(position, Socket) else of_frame
        drawn = graph.node("ShaderNodeTexWhiteNoise", {"Vector": where, "W": w}, _FOUR).out(output, kind)
        if self.quick is None or not isinstance(position, Socket):
            return drawn
        # A hash of two numbers: the position, stretched by the frame's own. A product is the same on all processors.
        own = graph.node("ShaderNodeTexWhiteNoise", {"Vector": of_frame, "W": w}, _FOUR).out("Color", "vector")
        stretched = (position + 0.5) * (own + 1.0)
        node = graph.node("ShaderNodeTexWhiteNoise", {"Vector": stretched}, {"noise_dimensions": "2D"})
        return graph.choose(self.quick, node.out(output, kind), drawn, kind)


def build_group(
    perturbation: ColourPerturbation,
    capacity: Mapping[str, float] | None = None,
    *,
    bare: bool = False,
    lit: bool = False,
    shared: bool = False,
) -> Graph:
    """Describe the node group of a perturbation of colour.

    capacity: for each parameter that the number of nodes depends on, the largest value to serve; by default that of
    the perturbation. bare: as the generator uses it, with the definition's own sockets only: without severity and mask,
    and always clipped. lit: for linear light, so never clipped, where it is bare. shared: with mask and mix where it is
    bare. Raises NoisyWorldError where the
    perturbation has no group.
    """
    nodes = perturbation.nodes
    if nodes is None:
        raise NoisyWorldError(f"{perturbation.name}: has no node group; the backend reference carries it out")
    served = dict(nodes.capacity) | dict(capacity or {})
    larger = {name: value for name, value in served.items() if value != nodes.capacity[name]}
    more = [f"{socket_name(perturbation, name)} {value:g}" for name, value in larger.items()]
    more += ["Mask, Mix"] if bare and shared else []
    text = " ".join((perturbation.parameters.__doc__ or "").split("\n\n")[0].split())
    graph = Graph(
        group_name(perturbation) + (f" ({', '.join(more)})" if more else ""),
        f"{text} Takes and gives scene-linear colour, or encoded colour where Encoded is on",
        category="" if more else perturbation.stage,
        tags=("noisy world", perturbation.stage, perturbation.name),
    )
    image = graph.input(IMAGE_INPUT)
    depth_m = graph.input(DEPTH_INPUT) if perturbation.needs_depth else None
    share = _share(graph, perturbation) if shared or not bare else None
    severity = graph.input(SEVERITY_INPUT) if perturbation.group_severities and not bare else None
    enabled = graph.input(ENABLED_INPUT)
    given, override, own_camera = _parameters(graph, perturbation, served, severity, bare=bare)
    timing = timing_sockets(graph, perturbation)
    camera = camera_sockets(graph, own_camera) if perturbation.uses_motion else None
    reference, encoded = graph.input(REFERENCE_INPUT), graph.input(ENCODED_INPUT)
    light = Light(image, encoded, not lit if bare else graph.input(CLIP_INPUT))
    if severity is not None and override is not None and share is not None:
        with graph.section("Severity"):
            given |= by_severity(perturbation, severity, override, given)
            share = strength(severity, override, share)
    source = _given(light, nodes, averages=perturbation.averages)
    scenes = () if own_camera is None else of_scene(perturbation)
    with graph.section("Size"):
        canvas = _timed(_canvas(source, reference, depth_m, light.clip), perturbation, timing)
        canvas = replace(
            canvas, camera=camera, quick=given.get(QUICK) if perturbation.newly.get(QUICK) is True else None
        )
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
        result = nodes.build(canvas, scaled, served)
    given_back = _given_back(light, nodes, averages=perturbation.averages)(result, share)
    with graph.section(BACK):
        if depth_m is not None and not bare:
            given_back = graph.choose(_is_there(depth_m), given_back, image)
        graph.output("Image", graph.choose(enabled, given_back, image), description="The perturbed frame")
    return graph


def _share(graph: Graph, perturbation: ColourPerturbation) -> Socket:
    """Add the inputs that say how much of the effect shows, and where; return the share of each pixel."""
    mask = graph.input(MASK_INPUT)
    if not has_share(perturbation):
        return mask
    mix = graph.input(MIX_INPUT)
    colour = graph.input(COLOUR_INPUT) if has_colour(perturbation) else None
    with graph.section("Share"):
        return mask * mix if colour is None else colour * (mask * mix)


def _is_there(depth_m: Socket) -> Socket:
    """Return 1 where a frame has depth at all, else 0: Blender gives 0 everywhere where an engine's view has none.

    Of a render, what has no surface is far away, so a whole frame of zeros is none.
    """
    found = depth_m.graph.node("CompositorNodeLevels", {"Image": depth_m, "Channel": "Red"}, label="Is there depth?")
    return found.out("Maximum", "float") > 0.0


def group_name(perturbation: ColourPerturbation) -> str:
    """Return the name of a perturbation's group."""
    return title(perturbation.label)


def _given(light: Light, nodes: Nodes, *, averages: bool) -> Socket:
    """Return the image as a perturbation works on it."""
    if nodes.linear:
        return light.to_linear()
    return light.to_average() if averages else light.to_encoded()


def _given_back(light: Light, nodes: Nodes, *, averages: bool) -> Callable[[Socket, Socket | None], Socket]:
    """Return what gives a perturbation's result back as the image was given."""
    if nodes.linear:
        return light.from_linear
    return light.from_average if averages else light.from_encoded


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
