# SPDX-License-Identifier: GPL-3.0-or-later
"""A setting's perturbations of colour as one node group of groups, in propagation order, and what its sockets say."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from ..perturbing.kinds import ColourPerturbation, FrameContext, Identifiers
from ..perturbing.steps import Step
from .graph import Graph
from .groups import (
    DEPTH_INPUT,
    ENCODED_INPUT,
    IMAGE_INPUT,
    REFERENCE_INPUT,
    build_group,
    from_encoded,
    seed_of,
    socket_name,
    socket_value,
    to_encoded,
)


def build_chain(name: str, steps: Sequence[Step[ColourPerturbation]]) -> Graph:
    """Describe a chain: linear light in and out, converted once at its edges, encoded values between the groups.

    steps: of colour, in propagation order. Each one's group node is called as `step_node` says.
    """
    graph = Graph(name, "Perturbations of colour in propagation order")
    image = graph.input(IMAGE_INPUT)
    depth_m = graph.input(DEPTH_INPUT) if any(step.perturbation.needs_depth for step in steps) else None
    reference, encoded = graph.input(REFERENCE_INPUT), graph.input(ENCODED_INPUT)
    result = to_encoded(graph, image, encoded)
    with graph.section("Perturbations"):
        for step in steps:
            inputs: dict[str, Any] = {"Image": result, "Reference Width": reference, "Encoded": True}
            if step.perturbation.needs_depth:
                inputs["Depth"] = depth_m
            group = build_group(step.perturbation, capacity_of(step))
            result = graph.group(group, inputs, name=step_node(step)).out("Image", "color")
    graph.output("Image", from_encoded(graph, result, image, encoded), description="The perturbed frame")
    return graph


def step_node(step: Step[ColourPerturbation]) -> str:
    """Return the name of a step's node in its chain."""
    return step.perturbation.label if step.occurrence == 0 else f"{step.perturbation.label} {step.occurrence + 1}"


def capacity_of(step: Step[ColourPerturbation]) -> dict[str, float]:
    """Return the largest values that a step's group has to serve, where they are more than it does by default."""
    levels = (step.severity,) if step.levels is None else step.levels
    used = [step.parameters(level) for level in levels if level != 0]
    served = {}
    for name, default in step.perturbation.capacity.items():
        largest = max((getattr(item, name) for item in used), default=default)
        if largest > default:
            served[name] = largest
    return served


def socket_values(
    step: Step[ColourPerturbation], index: int, identifiers: Identifiers, *, scene_frame: int = 0
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a step's sockets say for a frame of a sequence, by their names; and a note for the provenance.

    scene_frame: the frame that Blender's scene stands at while this one is evaluated.
    """
    context = step.context(FrameContext(index, identifiers))
    severity = step.severity_of(context)
    note = step.note(context, severity)
    values: dict[str, Any] = {"Enabled": severity != 0}
    perturbation = step.perturbation
    if severity != 0:
        parameters = step.parameters(severity)
        for item in fields(parameters):
            value = socket_value(perturbation, item.name, getattr(parameters, item.name))
            values[socket_name(item.name)] = value
    if perturbation.temporals:
        values["Seed"] = note["node_seed"] = seed_of(context.identifiers)
        values["Frame Offset"] = index - scene_frame
        values["Redraw"] = step.temporal == "fresh"
        if "drift" in perturbation.temporals:
            values["Drift"] = step.temporal == "drift"
    return values, note


def is_active(values: Mapping[str, Mapping[str, Any]]) -> bool:
    """Tell whether a chain's picture has to be made, from its socket values by node; without any it is the frame's."""
    return not values or any(item["Enabled"] for item in values.values())
