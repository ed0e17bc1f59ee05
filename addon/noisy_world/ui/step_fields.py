# SPDX-License-Identifier: GPL-3.0-or-later
"""The fields of the selected perturbation: its severity and its parameters."""

from dataclasses import fields
from typing import Any

import bpy

from ..core.perturbing.kinds import SEQUENCE_KINDS, SEVERITIES, Perturbation
from .keyed import curve_of
from .properties import OVERRIDE, parameters_of, perturbation_of
from .typed_numbers import property_name


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
    for item in fields(perturbation.parameters):
        _draw_parameter(column, step, perturbation, item.name)


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
