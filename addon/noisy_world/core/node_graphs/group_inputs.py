# SPDX-License-Identifier: GPL-3.0-or-later
"""The sockets of a perturbation's node group: what all groups have, and what its parameters and patterns ask for."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ..labels import american, parameter_label, title
from ..perturbing.contexts import Temporal
from ..perturbing.kinds import ColourPerturbation, Perturbation
from ..schema import label_of
from ..streams import stream
from .graph import Graph, GroupInput, Kind, Panel, Socket

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
    """Return an input for each parameter; its default is the value at severity 3. served: largest values, by name."""
    return {
        item.name: _parameter_input(perturbation, item.name, served.get(item.name))
        for item in fields(perturbation.parameters)
    }


def frame_inputs(perturbation: ColourPerturbation) -> dict[str, GroupInput]:
    """Return an input for each value that a group is told for a frame."""
    values = {} if perturbation.by_frame is None else perturbation.by_frame.values
    return {
        name: GroupInput(
            socket_name(perturbation, name), "float", item.default, american(item.meaning), item.minimum, item.maximum
        )
        for name, item in values.items()
    }


def _parameter_input(perturbation: Perturbation, name: str, served: float | None) -> GroupInput:
    item = next(item for item in fields(perturbation.parameters) if item.name == name)
    info, hint = item.metadata["key"], get_type_hints(perturbation.parameters)[name]
    default = socket_value(perturbation, name, item.default)
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
