# SPDX-License-Identifier: GPL-3.0-or-later
"""A setting's perturbations of colour as one node group, in propagation order, and the sockets' values."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.camera_motion import AT_REST, CameraState
from ..core.errors import title
from ..core.geometry import Intrinsics
from ..core.node_graph import INTERFACE, BroughtImage, Graph, GroupInput, Socket, flat
from ..perturbations.execution import ColourWork, deciding
from ..perturbations.groups import (
    CLIP_INPUT,
    COLOUR_INPUT,
    DEPTH_INPUT,
    ENCODED_INPUT,
    IMAGE_INPUT,
    MASK_INPUT,
    MIX_INPUT,
    OFFSET_INPUT,
    OVERRIDE,
    OVERRIDE_CAMERA,
    PATTERN,
    REFERENCE_INPUT,
    ROUNDING,
    SEED_INPUT,
    SEVERITY_INPUT,
    Light,
    build_group,
    camera_values,
    looks_at_scene,
    seed_of,
    socket_name,
    socket_value,
)
from ..perturbations.kinds import SEVERITIES, ColourPerturbation, FrameContext, Identifiers, Nodes, without_frames
from ..perturbations.shares import WHOLE, has_colour, has_share, sha256_of, whole_mask
from ..perturbations.steps import Step

SLIDER_REACH = 1.5  # where a parameter's slider ends, as a multiple of its strongest severity; chosen
BYTE_PLACES = (1.0, 2.0**8, 2.0**16)

Decided: TypeAlias = Mapping[str, Mapping[str, FrameContext]]
"""By chain and by `step_node`: a step's context of a frame, with what automatics decided for it."""


def build_chain(name: str, steps: Sequence[Step[ColourPerturbation]], *, lit: bool = False) -> Graph:
    """Describe a chain: it takes and gives linear light, converts once at each end, and passes encoded values inside.

    It clips, as what the generator writes is clipped, unless its input Clip is switched off. lit: it is for a lit
    scene, so it clips nothing and passes light inside.

    steps: of colour, in propagation order. `step_node` gives the name of each one's group node.
    """
    graph = Graph(name, "Perturbations of colour in propagation order")
    image = graph.input(IMAGE_INPUT)
    depth_m = graph.input(DEPTH_INPUT) if any(step.perturbation.needs_depth for step in steps) else None
    reference, encoded = graph.input(REFERENCE_INPUT), graph.input(ENCODED_INPUT)
    clip = graph.input(replace(CLIP_INPUT, default=not lit))
    light = Light(image, encoded, clip)
    result = image if lit else light.to_encoded()
    with graph.section("Perturbations"):
        for step, passes in zip(steps, _pass_bright(steps), strict=True):
            given = encoded if lit else True
            cut: Any = False if passes else clip
            inputs: dict[str, Any] = {"Image": result, "Reference Width": reference, "Encoded": given, "Clip": cut}
            if step.perturbation.needs_depth:
                inputs["Depth"] = depth_m
            if step.share is not None and step.share.masks:
                inputs[MASK_INPUT.name] = _over(image, step.share.masks[0])
            group = build_group(step.perturbation, roomy_capacity_of(step))
            result = graph.group(group, inputs, name=step_node(step)).out("Image", "color")
    end = result if lit else light.from_encoded(result)
    graph.output("Image", end, description="The perturbed frame")
    return graph


def _over(image: Socket, mask: Path) -> Socket:
    """Return a mask laid over an image of any size; it goes with the chain into the file."""
    graph = image.graph
    place = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
    where = graph.vector(place.x, place.y, 1.0)  # z is Map UV's weight
    brought = graph.picture(BroughtImage(f"Mask {mask.name}", sha256_of(mask), partial(whole_mask, mask)))
    inputs = {"Image": brought, "UV": where, "Interpolation": "Bilinear"}
    extension = {"Extension X": "Extend", "Extension Y": "Extend"}
    return graph.node("CompositorNodeMapUV", inputs | extension).out("Image", "float")


def build_written(steps: Sequence[Step[ColourPerturbation]], *, lit: bool = False, apart: bool = False) -> Graph:
    """Describe what the generator evaluates: the same chain for an encoded frame, without groups inside it.

    Inputs are Image, Depth where a step asks for it, Reference Width, and each step's, named by `socket_of`. Outputs
    are Image, and Bytes: the bytes of red, green and blue as one whole number, red the lowest. lit: for scene-linear
    light of any brightness, which has no bytes. apart: each of several steps stays a group, without groups inside:
    Blender makes them in far less time, as its own time for each change of a group grows with the group.

    A description is kept, as it takes tens of milliseconds: the same steps are given the same one.
    """
    parts = (
        _Part(step_node(step), tuple(capacity_of(step).items()), step.perturbation, step.share is not None)
        for step in steps
    )
    return _written(tuple(parts), lit, apart)


@dataclass(frozen=True)
class _Part:
    """What a step's group hangs on. node: `step_node`. served: `capacity_of`. shared: whether it has mask and mix."""

    node: str
    served: tuple[tuple[str, float], ...]
    perturbation: ColourPerturbation = field(hash=False)
    shared: bool = False


@lru_cache(maxsize=128)
def _written(parts: tuple[_Part, ...], lit: bool, apart: bool) -> Graph:
    groups = [
        build_group(part.perturbation, dict(part.served), bare=True, lit=lit or passes, shared=part.shared)
        for part, passes in zip(parts, _pass_bright(parts), strict=True)
    ]
    if apart and len(groups) > 1:
        groups = [_apart(group) for group in groups]
    names = ", ".join(group.name for group in groups)
    graph = Graph(f"{'Lit' if lit else 'Written'}: {names}", "Perturbations of colour as the generator evaluates them")
    image = graph.input(IMAGE_INPUT)
    depth_m = graph.input(DEPTH_INPUT) if any(part.perturbation.needs_depth for part in parts) else None
    shared: dict[str, Any] = {"Reference Width": graph.input(REFERENCE_INPUT), "Encoded": not lit, "Depth": depth_m}
    result = image if parts else graph.clamp(image)
    for part, group in zip(parts, groups, strict=True):
        inputs: dict[str, Any] = {"Image": result}
        for item in group.inputs:
            if item.name in shared:
                inputs[item.name] = shared[item.name]
            elif item.name not in inputs:
                inputs[item.name] = graph.input(replace(item, name=_socket_name(part.node, item.name)))
        result = graph.group(group, inputs).out("Image", "color")
    graph.output("Image", result, description=f"The perturbed frame, {'linear' if lit else 'encoded'}")
    if not lit:
        graph.output("Bytes", _one_number(result), "float", "Its bytes in one number")
    return flat(graph)


def _apart(group: Graph) -> Graph:
    """Return a step's group without groups inside, which stays one; its name tells it from others of its kind."""
    found = flat(group)
    found.name, found.alone = f"{group.name} {group.stamp[:12]}", True
    return found


def _pass_bright(steps: Sequence[Step[ColourPerturbation] | _Part]) -> list[bool]:
    """Return for each step whether the next one is given what is brighter than white, as only a sensor clips it."""
    acting = [step.perturbation.on_light for step in steps]
    return [one and other for one, other in zip(acting, [*acting, False][1:], strict=True)]


def _one_number(image: Socket) -> Socket:
    """Round a frame in [0, 1] to bytes, and put a pixel's three into one number, which float32 holds exactly."""
    graph = image.graph
    levels = (image * 255.0 + ROUNDING) - ROUNDING
    return graph.math("DOT_PRODUCT", levels, BYTE_PLACES)


def bytes_of(number: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the bytes (H, W, 3) that `build_written` put into one number (H, W) each."""
    import cv2

    four = number.astype("<i4").view(np.uint8).reshape(*number.shape, 4)
    return np.asarray(cv2.cvtColor(four, cv2.COLOR_RGBA2RGB), np.uint8).reshape(*number.shape, 3)


def socket_of(step: Step[ColourPerturbation], name: str) -> str:
    """Return the name that an input of a step's group has in what `build_written` describes."""
    return _socket_name(step_node(step), name)


def _socket_name(node: str, name: str) -> str:
    return f"{node}: {name}"


def step_node(step: Step[ColourPerturbation]) -> str:
    """Return the name of a step's node in its chain."""
    name = title(step.perturbation.label)
    return name if step.occurrence == 0 else f"{name} {step.occurrence + 1}"


def nodes_of(step: Step[ColourPerturbation]) -> Nodes:
    """Return how nodes carry out a step of a chain, which has none that they cannot."""
    assert step.perturbation.nodes is not None, f"{step.perturbation.name} has no node group"
    return step.perturbation.nodes


def capacity_of(step: Step[ColourPerturbation]) -> dict[str, float]:
    """Return the largest values that a step's group has to serve, where these exceed the group's default capacity."""
    levels = (step.severity,) if step.levels is None else step.levels
    used = [step.parameters(level) for level in levels if level != 0]
    served = {}
    for name, default in nodes_of(step).capacity.items():
        largest = max((getattr(item, name) for item in used), default=default)
        if largest > default:
            served[name] = largest
    return served


def roomy_capacity_of(step: Step[ColourPerturbation]) -> dict[str, float]:
    """Return `capacity_of` with room, for a group that people see: a slider that moves on meets few groups to build."""
    kind = nodes_of(step).capacity
    return {name: room_for(largest, kind[name]) for name, largest in capacity_of(step).items()}


def slider_capacities(perturbation: ColourPerturbation) -> list[dict[str, float]]:
    """Return the capacities above the default that a perturbation's sliders meet, whose groups are shipped, too."""
    kind = {} if perturbation.nodes is None else perturbation.nodes.capacity
    ends = {name: SLIDER_REACH * max(perturbation.severities[name]) for name in kind}
    return [{name: room_for(end, kind[name])} for name, end in ends.items() if end > kind[name]]


def room_for(largest: float, default: float) -> float:
    """Return the first capacity that serves so much, of those that begin with the default and grow by half."""
    capacity = default
    while capacity < largest:
        capacity = math.ceil(capacity * 1.5)
    return capacity


def socket_values(
    step: Step[ColourPerturbation],
    index: int,
    identifiers: Identifiers,
    *,
    scene_frame: int = 0,
    intrinsics: Intrinsics | None = None,
    camera_state: CameraState | None = None,
    decided: FrameContext | None = None,
    lit: bool = False,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the values of a bare group's sockets for a frame of a sequence, by name, and a note for the provenance.

    scene_frame: the frame of Blender's scene while this frame is evaluated. intrinsics: of the camera, if
    known. camera_state: how it stands and moves; None leaves its sockets alone. decided: the step's context of the
    frame with what automatics decided; None where no earlier frames are known, as `without_frames` says. lit: the chain
    is of a lit scene.
    """
    context = step.context(FrameContext(index, identifiers))
    severity = step.severity_of(context)
    note = group_note(step, context, severity)
    values: dict[str, Any] = {"Enabled": severity != 0}
    if step.share is not None:
        values |= _share_values(step, index)
    perturbation = step.perturbation
    of_frame = {} if severity == 0 else _told(step, severity, replace(decided or without_frames(context), lit=lit))
    if not perturbation.has_parameter_sockets:
        values |= {socket_name(perturbation, name): value for name, value in of_frame.items()}
    elif severity != 0:
        parameters = replace(step.parameters(severity), **of_frame)
        if intrinsics is not None and (by_camera := nodes_of(step).by_camera) is not None:
            parameters = replace(parameters, **by_camera(intrinsics))
        for item in fields(parameters):
            value = socket_value(perturbation, item.name, getattr(parameters, item.name))
            values[socket_name(perturbation, item.name)] = value
    if severity != 0 and perturbation.is_repeatable(step.parameters(severity)):
        return values, note
    if camera_state is not None:
        values |= camera_state_values(step, severity, camera_state)
    if perturbation.group_temporals:
        values["Seed"] = note["node_seed"]
        values["Frame Offset"] = index - scene_frame
        if len(perturbation.group_temporals) > 1:
            values[PATTERN] = title(step.temporal)
    return values, note


def _share_values(step: Step[ColourPerturbation], index: int) -> dict[str, Any]:
    """Return the values of the sockets that say how much of a step's effect shows in a frame, but for its mask."""
    share = step.share or WHOLE
    colour = {COLOUR_INPUT.name: (*share.colour, 1.0)} if has_colour(step.perturbation) else {}
    return {MIX_INPUT.name: share.mix_of(index)} | colour


def mask_values(steps: Sequence[Step[ColourPerturbation]], index: int) -> dict[str, Path]:
    """Return the masks of a frame of a sequence, by the names of their inputs in what `build_written` describes."""
    masks = {socket_of(step, MASK_INPUT.name): step.share.mask_of(index) for step in steps if step.share is not None}
    return {name: mask for name, mask in masks.items() if mask is not None}


def group_note(step: Step[ColourPerturbation], context: FrameContext, severity: float | None) -> dict[str, Any]:
    """Return a record of what a step's group does to a frame, for frames.jsonl. context, severity: the step's own."""
    note, kind = step.note(context, severity), step.perturbation
    draws = kind.group_temporals and (severity == 0 or not kind.is_repeatable(step.parameters(severity)))
    return note | {"node_seed": seed_of(context.identifiers)} if draws else note


def _told(step: Step[ColourPerturbation], severity: float | None, context: FrameContext) -> dict[str, float]:
    """Return what a step's group is told for a frame, by name: values, or parameters."""
    by_frame = nodes_of(step).by_frame
    if by_frame is None:
        return {}
    if step.perturbation.automatic is not None and context.read_decided is None:
        ((_, context, _),) = deciding(((step, context, severity),))
    made = by_frame.of(step.parameters(severity), context)
    return dict(made) if not by_frame.values else {name: float(made[name]) for name in by_frame.values}


def camera_state_values(
    step: Step[ColourPerturbation], severity: float | None, camera_state: CameraState
) -> dict[str, Any]:
    """Return the values of the camera's sockets, by name; none where a step does not ask for them.

    severity: of the frame. camera_state: how the camera stands and moves.
    """
    perturbation = step.perturbation
    if severity == 0 or not perturbation.uses_motion or perturbation.is_repeatable(step.parameters(severity)):
        return {}
    held = perturbation.goes_with_camera and step.temporal == "fixed"
    return dict(camera_values(AT_REST if held else camera_state))


def shown_values(
    step: Step[ColourPerturbation],
    index: int,
    identifiers: Identifiers,
    *,
    scene_frame: int = 0,
    intrinsics: Intrinsics | None = None,
    decided: FrameContext | None = None,
    lit: bool = False,
) -> dict[str, Any]:
    """Return what `socket_values` does for a group that people see: by its Severity, where that decides all the same.

    Only whole levels go by the severity, as the table's values are exact there. The camera is the sequence's, not that
    of the scene which shows the group.
    """
    values, note = socket_values(
        step, index, identifiers, scene_frame=scene_frame, intrinsics=intrinsics, decided=decided, lit=lit
    )
    if has_share(step.perturbation):
        values |= _share_values(step, index)
    if looks_at_scene(step.perturbation):
        values[OVERRIDE_CAMERA] = True
    table = step.perturbation.group_severities
    if not table or not values["Enabled"]:
        return values
    severity = note.get("severity")
    if severity not in SEVERITIES or not _is_by_table(step.perturbation, severity, values):
        return values | {OVERRIDE: True}
    names = [socket_name(step.perturbation, name) for name in table]
    kept = {name: value for name, value in values.items() if name not in names}
    return kept | {OVERRIDE: False, SEVERITY_INPUT.name: float(severity)}


def _is_by_table(perturbation: ColourPerturbation, severity: float, values: Mapping[str, Any]) -> bool:
    """Tell whether all parameters of the table are as at this severity."""
    wanted = perturbation.at_severity(severity)
    return all(
        values[socket_name(perturbation, name)] == socket_value(perturbation, name, getattr(wanted, name))
        for name in perturbation.severities
    )


def decided_by(work: ColourWork) -> Mapping[str, FrameContext]:
    """Return the contexts of a frame's steps, with what automatics decided, by `step_node`."""
    return {step_node(step): context for step, context, _ in work.active}


def is_active(values: Mapping[str, Mapping[str, Any]]) -> bool:
    """Tell whether a chain has to be evaluated: one of its nodes is enabled, or it has none and gives the frame."""
    return not values or any(item["Enabled"] for item in values.values())


# A written group in two: the random images that it draws, and the rest, which is given them.
#
# Several severities of a perturbation that draw from one stream draw the same images, so these are made once for all.


_NOISE, _POSITION = "ShaderNodeTexWhiteNoise", "CompositorNodeImageCoordinates"
_FRAME = (IMAGE_INPUT.name, REFERENCE_INPUT.name)
_TIMING = (SEED_INPUT.name, OFFSET_INPUT.name, PATTERN)


@dataclass(frozen=True)
class Divided:
    """A group in two. draws: makes the random images. rest: has an input of the same name for each of them."""

    draws: Graph
    rest: Graph


def divided(graph: Graph) -> Divided | None:
    """Divide what `build_written` describes; None where no random image depends on frame, seed and pattern alone."""
    alike = _alike(graph)
    spread = _reached_from(graph, {number for number, node in enumerate(graph.nodes) if node.idname == _POSITION})
    noise = {number for number in alike & spread if graph.nodes[number].idname == _NOISE}
    drawn = _reached_from(graph, noise) & alike
    handed = [socket for socket in _used_by_others(graph, drawn) if socket.node in drawn]
    if not handed:
        return None
    names = {(socket.node, socket.output): f"Draw {place}" for place, socket in enumerate(handed, start=1)}
    draws, rest = Graph(f"{graph.name}: draws", graph.description), Graph(f"{graph.name}: rest", graph.description)
    made = _copied(graph, draws, handed, {})
    for socket in made:
        draws.output(f"Draw {len(draws.outputs) + 1}", socket, socket.kind, "A random image")
    given = {
        place: GroupInput(names[place], socket.kind, _ZERO[socket.kind], "A random image")
        for place, socket in zip(names, handed, strict=True)
    }
    ends = _copied(graph, rest, [item.socket for item in graph.outputs], given)
    for item, socket in zip(graph.outputs, ends, strict=True):
        rest.output(item.name, socket, item.kind, item.description)
    return Divided(draws, rest)


def pooled(
    chains: Mapping[str, Sequence[Step[ColourPerturbation]]], *, lit: bool = False
) -> Iterator[tuple[tuple[str, ...], Graph | Divided]]:
    """Return chains of equal groups together, each time with the group. lit: as `build_written` says.

    It is divided where several chains name one stream: they draw the same random images, which are then made once.
    """
    equal: dict[tuple[Any, ...], list[str]] = {}
    for name, steps in chains.items():
        what = tuple(
            (step_node(step), step.perturbation.name, tuple(capacity_of(step).items()), _shared(step)) for step in steps
        )
        streams = tuple(step.stream for step in steps)
        equal.setdefault((what, None if None in streams else streams), []).append(name)
    for (_, streams), names in equal.items():
        steps = chains[names[0]]
        parted = divided(build_written(steps, lit=lit)) if streams and len(names) > 1 else None
        yield tuple(names), parted or build_written(steps, lit=lit, apart=True)


def _shared(step: Step[ColourPerturbation]) -> bool | None:
    """Return whether a step has a mask; None where it shows all of its effect."""
    return None if step.share is None else bool(step.share.masks)


_ZERO: Mapping[str, Any] = {"float": 0.0, "vector": (0.0, 0.0, 0.0), "color": (0.0, 0.0, 0.0, 1.0)}


def _is_alike(item: str) -> bool:
    """Tell whether an input of a written group is that of all chains of one stream."""
    return item in _FRAME or item.startswith("Constant ") or item.rpartition(": ")[2] in _TIMING


def _sockets(graph: Graph, number: int) -> list[Socket]:
    return [value for value in graph.nodes[number].inputs.values() if isinstance(value, Socket)]


def _alike(graph: Graph) -> set[int]:
    """Return the nodes whose results are those of all chains of one stream."""
    found: set[int] = set()
    for number in graph.reachable():
        if all(
            _is_alike(item.output) if item.node == INTERFACE else item.node in found for item in _sockets(graph, number)
        ):
            found.add(number)
    return found


def _reached_from(graph: Graph, start: set[int]) -> set[int]:
    """Return these nodes and all that depend on them."""
    found = set(start)
    for number in graph.reachable():
        if any(item.node in found for item in _sockets(graph, number)):
            found.add(number)
    return found


def _used_by_others(graph: Graph, numbers: set[int]) -> list[Socket]:
    """Return what the group's outputs and the nodes that are not among these take, each once."""
    others = [item for number in graph.reachable() if number not in numbers for item in _sockets(graph, number)]
    taken = {(item.node, item.output): item for item in [*others, *(end.socket for end in graph.outputs)]}
    return list(taken.values())


def _copied(
    graph: Graph, target: Graph, ends: list[Socket], given: Mapping[tuple[int, str], GroupInput]
) -> list[Socket]:
    """Copy what these sockets depend on into another description; return them there.

    given: what is an input there, by node and output.
    """
    inputs = {item.name: item for item in graph.inputs}
    made: dict[tuple[int, str], Socket] = {}
    numbers: dict[int, int] = {}

    def socket_of(item: Socket) -> Socket:
        place = item.node, item.output
        if place not in made and item.node == INTERFACE:
            made[place] = target.input(inputs[item.output])
        elif place not in made and place in given:
            made[place] = target.input(given[place])
        elif place not in made:
            made[place] = Socket(target, number_of(item.node), item.output, item.kind)
        return made[place]

    def number_of(number: int) -> int:
        if number not in numbers:
            node = graph.nodes[number]
            values = {name: socket_of(item) if isinstance(item, Socket) else item for name, item in node.inputs.items()}
            copy = target.node(node.idname, values, node.properties, picture=node.picture, group=node.group)
            numbers[number] = copy.number
        return numbers[number]

    return [socket_of(item) for item in ends]
