# SPDX-License-Identifier: GPL-3.0-or-later
"""The fields of the selected perturbation: its severity and its parameters."""

from dataclasses import fields
from typing import Any

import bpy

from ..core.perturbing.kinds import SEQUENCE_KINDS, SEVERITIES, DepthPerturbation, Perturbation
from .keyed import curve_of
from .properties import OVERRIDE, parameters_of, perturbation_of
from .typed_numbers import property_name

LONG = 7  # parameters, beyond which a list has sub-panels; chosen: as many as are seen at a glance
LOOK, MOTION, CAMERA, SENSOR = "Look", "Motion", "Camera", "Sensor"
_OF_CAMERA = ("camera", "view", "aperture", "focus", "focal", "sensor", "f_number", "max_radius")
_OF_MOTION = ("_m_s", "_per_s", "_hz", "_ms")
_OF_MOTION_WORDS = ("fall", "flow", "creep", "run", "runs", "drying", "wind", "gusts", "shutter")


def draw_step(layout: bpy.types.UILayout, step: Any) -> None:
    """Draw the severity and the parameters of the selected perturbation."""
    perturbation = perturbation_of(step)
    column = layout.column()
    column.active = step.enabled
    if perturbation.severities:
        column.prop(step, "use_severity")
        if step.use_severity:
            row = column.row()
            row.use_property_decorate = not isinstance(perturbation, SEQUENCE_KINDS)
            row.prop(step, "severity", slider=True)
            if (curve := curve_of(step)) is not None:
                column.label(text=f"{len(curve.keyframe_points)} keys: each frame has its own", icon="KEYFRAME")
            elif not isinstance(perturbation, SEQUENCE_KINDS):
                column.row().prop(step, "mode", expand=True)
    if len(perturbation.temporals) > 1:
        label, buttons = _split_row(column)
        label.label(text="Pattern")
        for value in perturbation.temporals:
            buttons.prop_enum(step, "temporal", value)
    column.separator(factor=0.5)
    first, rest = parts_of(perturbation)
    for name in first:
        _draw_parameter(column, step, perturbation, name)
    for part, names in rest.items():
        header, body = layout.panel(f"noisy_world_{perturbation.name}_{part}", default_closed=part in (MOTION, CAMERA))
        header.label(text=part)
        if body is not None:
            body.active = step.enabled
            for name in names:
                _draw_parameter(body, step, perturbation, name)


def parts_of(perturbation: Perturbation) -> tuple[list[str], dict[str, list[str]]]:
    """Return the parameters that are shown at once, and those of each sub-panel, in the order of effect.

    Of a long list those that severity sets come first, then what else decides the look, motion and the camera.
    """
    names = [item.name for item in fields(perturbation.parameters)]
    if len(names) <= LONG:
        return names, {}
    first = [name for name in names if name in perturbation.severities or name == "device"] or names[:1]
    if isinstance(perturbation, DepthPerturbation):
        return first, {SENSOR: [name for name in names if name not in first]}
    rest: dict[str, list[str]] = {part: [] for part in (LOOK, MOTION, CAMERA)}
    for name in names:
        if name not in first:
            rest[_part_of(name)].append(name)
    return first, {part: found for part, found in rest.items() if found}


def _part_of(name: str) -> str:
    if name.startswith(_OF_CAMERA):
        return CAMERA
    moves = name.endswith(_OF_MOTION) or any(word in name.split("_") for word in _OF_MOTION_WORDS)
    return MOTION if moves else LOOK


def _split_row(layout: bpy.types.UILayout) -> tuple[bpy.types.UILayout, bpy.types.UILayout]:
    """Return the two parts of a row that property split does not lay out by itself."""
    split = layout.split(factor=0.4)
    split.use_property_split = False
    label = split.row()
    label.alignment = "RIGHT"
    return label, split.row(align=True)


def _draw_parameter(layout: bpy.types.UILayout, step: Any, perturbation: Perturbation, name: str) -> None:
    """Draw a parameter: its own value, or the severity's with the toggle that overrides it."""
    group = parameters_of(step)
    if name not in perturbation.severities or not step.use_severity:
        layout.prop(group, property_name(name))
        return
    label, row = _split_row(layout)
    label.label(text=group.bl_rna.properties[property_name(name)].name)
    if getattr(group, OVERRIDE + name):
        row.prop(group, property_name(name), text="")
    else:
        row.label(text=_severity_value(step, perturbation, name))
    row.prop(group, OVERRIDE + name, text="", icon="GREASEPENCIL")


def _severity_value(step: Any, perturbation: Perturbation, name: str) -> str:
    if step.severity < SEVERITIES[0]:
        return "No effect"
    value = getattr(perturbation.at_severity(step.severity), name)
    return f"{value:.4g}{_unit(perturbation, name)}"


def _unit(perturbation: Perturbation, name: str) -> str:
    unit = next(item for item in fields(perturbation.parameters) if item.name == name).metadata["key"].unit
    return f" {unit}" if unit not in ("", "deg", "frames") else ""
