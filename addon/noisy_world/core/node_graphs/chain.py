# SPDX-License-Identifier: GPL-3.0-or-later
"""A setting's perturbations of colour as one node group, in propagation order, and the sockets' values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from ..labels import title
from ..perturbing.by_frame import without_frames
from ..perturbing.contexts import Identifiers
from ..perturbing.execution import ColourWork, deciding
from ..perturbing.kinds import SEVERITIES, ColourPerturbation, FrameContext
from ..perturbing.steps import Step
from ..trajectories.camera_state import AT_REST, CameraState
from .camera import OVERRIDE_CAMERA, camera_values, looks_at_scene
from .flat import flat
from .graph import Graph, Socket
from .group_inputs import (
    CLIP_INPUT,
    DEPTH_INPUT,
    ENCODED_INPUT,
    IMAGE_INPUT,
    OVERRIDE,
    PATTERN,
    REFERENCE_INPUT,
    SEVERITY_INPUT,
    seed_of,
    socket_name,
    socket_value,
)
from .groups import ROUNDING, build_group
from .light import Light

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
            group = build_group(step.perturbation, capacity_of(step))
            result = graph.group(group, inputs, name=step_node(step)).out("Image", "color")
    end = result if lit else light.from_encoded(result)
    graph.output("Image", end, description="The perturbed frame")
    return graph


def build_written(steps: Sequence[Step[ColourPerturbation]], *, lit: bool = False, apart: bool = False) -> Graph:
    """Describe what the generator evaluates: the same chain for an encoded frame, without groups inside it.

    Inputs are Image, Depth where a step asks for it, Reference Width, and each step's, named by `socket_of`. Outputs
    are Image, and Bytes: the bytes of red, green and blue as one whole number, red the lowest. lit: for scene-linear
    light of any brightness, which has no bytes. apart: each of several steps stays a group, without groups inside:
    Blender makes them in far less time, as its own time for each change of a group grows with the group.

    A description is kept, as it takes tens of milliseconds: the same steps are given the same one.
    """
    parts = (_Part(step_node(step), tuple(capacity_of(step).items()), step.perturbation) for step in steps)
    return _written(tuple(parts), lit, apart)


@dataclass(frozen=True)
class _Part:
    """What a step's group hangs on. node: `step_node`. served: `capacity_of`."""

    node: str
    served: tuple[tuple[str, float], ...]
    perturbation: ColourPerturbation = field(hash=False)


@lru_cache(maxsize=128)
def _written(parts: tuple[_Part, ...], lit: bool, apart: bool) -> Graph:
    groups = [
        build_group(part.perturbation, dict(part.served), bare=True, lit=lit or passes)
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


def capacity_of(step: Step[ColourPerturbation]) -> dict[str, float]:
    """Return the largest values that a step's group has to serve, where these exceed the group's default capacity."""
    levels = (step.severity,) if step.levels is None else step.levels
    used = [step.parameters(level) for level in levels if level != 0]
    served = {}
    for name, default in step.perturbation.capacity.items():
        largest = max((getattr(item, name) for item in used), default=default)
        if largest > default:
            served[name] = largest
    return served


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
    perturbation = step.perturbation
    told = {} if severity == 0 else _told(step, severity, replace(decided or without_frames(context), lit=lit))
    if not perturbation.has_parameter_sockets:
        values |= {socket_name(perturbation, name): value for name, value in told.items()}
    elif severity != 0:
        parameters = replace(step.parameters(severity), **told)
        if intrinsics is not None and perturbation.by_camera is not None:
            parameters = replace(parameters, **perturbation.by_camera(intrinsics))
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


def group_note(step: Step[ColourPerturbation], context: FrameContext, severity: float | None) -> dict[str, Any]:
    """Return a record of what a step's group does to a frame, for frames.jsonl. context, severity: the step's own."""
    note, kind = step.note(context, severity), step.perturbation
    draws = kind.group_temporals and (severity == 0 or not kind.is_repeatable(step.parameters(severity)))
    return note | {"node_seed": seed_of(context.identifiers)} if draws else note


def _told(step: Step[ColourPerturbation], severity: float | None, context: FrameContext) -> dict[str, float]:
    """Return what a step's group is told for a frame, by name: values, or parameters."""
    by_frame = step.perturbation.by_frame
    if by_frame is None:
        return {}
    if step.perturbation.decides is not None and context.read_decided is None:
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
