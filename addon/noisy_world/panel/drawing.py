# SPDX-License-Identifier: GPL-3.0-or-later
"""How groups of the tree are drawn: widgets, ticks beside what may be left out, lines of YAML."""

from collections.abc import Collection
from dataclasses import fields
from typing import Any

import bpy

from ..core.lens import MODELS
from ..preset.sensor_keys import OF_ANGLE
from .tree import GIVEN, field_of, hint_of, inside_of, is_line, property_name

COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


def draw_keys(
    layout: bpy.types.UILayout,
    group: Any,
    cls: type,
    *,
    leave: Collection[str] = (),
    only: Collection[str] = (),
    ticked: bool = False,
) -> None:
    """Draw the fields of a dataclass. leave: those that are drawn elsewhere. only: those that are drawn, if not all.

    ticked: whether each has a tick, as without it something else holds than it shows.
    """
    for item in fields(cls):
        if item.name in leave or (only and item.name not in only):
            continue
        if (inside := inside_of(cls, item.name)) is not None:
            draw_keys(layout.box(), getattr(group, item.name), inside)
        else:
            draw_key(layout, group, cls, item.name, ticked=ticked)


def draw_key(layout: bpy.types.UILayout, group: Any, cls: type, name: str, *, ticked: bool = False) -> None:
    """Draw a field; with a tick where something else holds without it than it shows."""
    if not ticked and field_of(cls, name).default is not None and not is_line(cls, name):
        layout.prop(group, property_name(name))
        return
    row = layout.row(align=True)
    field = row.row(align=True)
    field.active = getattr(group, GIVEN + name)
    field.prop(group, property_name(name))
    if hint_of(cls, name) is not bool:
        row.prop(group, GIVEN + name, text="")


def draw_given(layout: bpy.types.UILayout, group: Any, cls: type, *, leave: Collection[str] = ()) -> None:
    """Draw what a preset has given beside the fields that are always there, each with its tick. leave: those fields."""
    for item in fields(cls):
        if item.name in leave:
            continue
        if (inside := inside_of(cls, item.name)) is not None:
            if getattr(group, GIVEN + item.name):
                layout.prop(group, GIVEN + item.name)
                draw_given(layout, getattr(group, item.name), inside)
        elif getattr(group, GIVEN + item.name):
            draw_key(layout, group, cls, item.name, ticked=True)


def draw_lines(layout: bpy.types.UILayout, panel: Any, name: str) -> None:
    """Draw the other scenes or settings of a preset, a line each, with what takes it out. name: of the panel's list."""
    lines = getattr(panel, name)
    if not len(lines):
        return
    header, body = layout.panel(f"noisy_world_{name}", default_closed=True)
    header.label(text=f"{panel.bl_rna.properties[name].name} ({len(lines)})")
    if body is None:
        return
    column = body.column(align=True)
    for place, line in enumerate(lines):
        row = column.row(align=True)
        row.prop(line, "line", text=line.name)
        button: Any = row.operator("noisy_world.remove_line", text="", icon="X")
        button.of, button.place = name, place


def draw_body(layout: bpy.types.UILayout, path: Any) -> None:
    """Draw what carries the camera along a path."""
    layout.prop(path, "use_body", text="Body")
    if path.use_body:
        layout.prop(path.body, "kind", text="Kind")
        layout.prop(path.body, "motion")


def draw_distortion(layout: bpy.types.UILayout, owner: Any, *, rendered: bool) -> None:
    """Draw the lens of a camera or of a recording that distorts. rendered: not laid over a recording."""
    layout.prop(owner, "use_distortion")
    if not owner.use_distortion:
        return
    group = owner.distortion
    layout.prop(group, "model")
    column = layout.column(align=True)
    for name in OF_ANGLE if group.model == MODELS[1] else COEFFICIENTS:
        column.prop(group, name)
    if rendered:
        layout.prop(group, "undistort")


def draw_imu(layout: bpy.types.UILayout, rig: Any) -> None:
    """Draw an IMU: a device, where it sits, its rate and its clock."""
    layout.prop(rig, "use_imu")
    if not rig.use_imu:
        return
    column = layout.column(align=True)
    for name in ("device", "translation_m", "rate_hz", "gravity_m_s2", "time_offset_s", "clock_drift_ppm"):
        column.prop(rig.imu, name)
