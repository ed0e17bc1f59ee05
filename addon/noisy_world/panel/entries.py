# SPDX-License-Identifier: GPL-3.0-or-later
"""An entry of the list of perturbations: taken from a preset, put into one, and the fields of the selected one."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import bpy

from ..core.schema import ConfigPath, parse
from ..perturbations import registry
from ..perturbations.kinds import SEQUENCE_KINDS, SEVERITIES, DepthPerturbation, Perturbation, propagation_key
from ..perturbations.parsing import written_out
from ..perturbations.shares import COLOUR, MASK, MIX, WHITE, has_colour, has_share
from ..perturbations.steps import DEFAULT_SEVERITY
from .new_entries import begin
from .open_scene import follows, frame_range, is_shown, scene_frames
from .properties import colours_in, parameters_of, perturbation_of
from .step_list import SHARE_COLOUR, SHARE_MASK, SHARE_MIX, add_step, curve_of, key_levels, move_entry, remove_entry
from .tree import GIVEN, property_name, set_value, take, taking, to_line, value_of

RATE = "frame_rate_hz"  # the parameter of what counts time by frames
SAME_RATE = 1e-3  # of a rate: a difference that nobody sees


def in_order(items: Sequence[Any], place: ConfigPath) -> list[tuple[str, Mapping[str, Any]]]:
    """Return what a preset's `perturb` says of each perturbation, in propagation order, a device's written out."""
    found = [(name, values or {}) for item, _ in written_out(items, place) for name, values in item.items()]
    return sorted(found, key=lambda each: propagation_key(registry()[each[0]]))


def take_entry(item: Any, name: str, values: Mapping[str, Any], *, speed_factor: int = 1) -> None:
    """Fill an entry of the list from what a preset says. speed_factor: of the path, for what is keyed along it."""
    perturbation = registry()[name]
    known = [field.name for field in fields(perturbation.parameters)]
    given = {key: value for key, value in values.items() if key in known}
    place = ConfigPath(name)
    mode, levels = values.get("mode", "static"), values.get("levels")
    with taking():
        item.perturbation = name
        item.mode = "dynamic" if mode == "dynamic" else "static"
        item.levels = to_line(levels) if mode == "dynamic" and levels else ""
        item.use_severity = not perturbation.severities or "severity" in values or mode != "static" or not given
        set_value(item, "severity", values.get("severity", DEFAULT_SEVERITY))
        if perturbation.temporals:
            item.temporal = values.get("temporal", perturbation.temporals[0])
        take(parameters_of(item), parse(perturbation.parameters, given, place), given)
        if has_share(perturbation):
            mix = values.get(MIX, 1.0)
            set_value(item, SHARE_MIX, mix[0] if isinstance(mix, Sequence) else mix)
            item.share_mask = values.get(MASK) or ""
            set_value(item, SHARE_COLOUR, values.get(COLOUR) or WHITE)
    if mode == "keyed" and levels:
        item.severity = levels[0]
        frames = scene_frames(item.id_data, len(levels) * speed_factor)[::speed_factor]
        key_levels(item, levels, frames)
    if has_share(perturbation) and isinstance(mix := values.get(MIX, 1.0), Sequence):
        frames = scene_frames(item.id_data, len(mix) * speed_factor)[::speed_factor]
        key_levels(item, mix, frames, SHARE_MIX)


def put_entry(panel: Any, name: str, values: Mapping[str, Any], occurrence: int) -> bool:
    """Let the list hold a preset's step: in place of the entry of its name, else added; tell whether there was one.

    occurrence: its own place among those of its name; the entry with the same one is replaced.
    """
    same = [index for index, item in enumerate(panel.steps) if item.perturbation == name]
    place = same[occurrence] if occurrence < len(same) else None
    if place is not None:
        remove_entry(panel, place)
    made = add_step(panel, name)
    if place is not None:
        move_entry(panel, made, place)
        panel.active_step = made = place
    take_entry(panel.steps[made], name, values, speed_factor=panel.speed_factor)
    if RATE not in values:
        take_rate(panel, panel.steps[made])
    return place is not None


def add_own_step(panel: Any, name: str) -> tuple[str, ...]:
    """Add a perturbation as a new step begins, at the frame rate of the sequence where the open scene is its source.

    Returns what is to be said of what was chosen for the user.
    """
    index = add_step(panel, name)
    said = begin(panel, index)
    take_rate(panel, panel.steps[index])
    return said


def take_rate(panel: Any, item: Any) -> None:
    """Let an entry that counts time have the rate of the sequence's frames, where the open scene is its source."""
    rate_hz = own_rate_hz(panel)
    if rate_hz is not None and hasattr(parameters_of(item), RATE):
        set_value(parameters_of(item), RATE, rate_hz)


def own_rate_hz(panel: Any) -> float | None:
    """Return how many frames of the sequence the open scene shows in a second; None where it is not shown."""
    if not is_shown(panel):
        return None
    render = panel.id_data.render
    each = frame_range(panel.id_data).step if follows(panel) else 1
    return render.fps / render.fps_base / each


def other_rate(panel: Any, item: Any) -> str:
    """Return what is wrong with an entry's rate of frames, "" where nothing is: it drifts as fast as the scene runs."""
    rate_hz, group = own_rate_hz(panel), parameters_of(item)
    if rate_hz is None or item.temporal != "drift" or not hasattr(group, RATE):
        return ""
    given_hz = value_of(group, RATE)
    if abs(given_hz - rate_hz) <= SAME_RATE * rate_hz:
        return ""
    times = rate_hz / given_hz
    return (
        f"Moves {times:.2g} times as fast as in the scene, which has {rate_hz:g} frames a second here, not {given_hz:g}"
    )


# The fields of the selected perturbation: its severity and its parameters.


LONG = 7  # parameters, beyond which a list has sub-panels; chosen: as many as are seen at a glance
LOOK, MOTION, CAMERA, SENSOR = "Look", "Motion", "Camera", "Sensor"
TIME, SHARE, PARAMETERS = "Over Time", "Mix and Mask", "Parameters"
_OF_CAMERA = ("camera", "view", "aperture", "focus", "focal", "sensor", "f_number", "max_radius")
_OF_MOTION = ("_m_s", "_per_s", "_hz", "_ms")
_OF_MOTION_WORDS = ("fall", "flow", "creep", "run", "runs", "drying", "wind", "gusts", "shutter")


def draw_step(layout: bpy.types.UILayout, step: Any) -> None:
    """Draw the severity of the selected perturbation, and folded how it changes in time, and its parameters.

    What is set by hand for want of a severity is not folded.
    """
    perturbation = perturbation_of(step)
    column = layout.column()
    column.active = step.enabled
    if perturbation.severities:
        _draw_severity(column, step, perturbation)
    first, rest = parts_of(perturbation)
    if _changes_in_time(perturbation, step) and (body := _fold(layout, step, TIME)) is not None:
        _draw_time(body, step, perturbation)
    if has_share(perturbation) and (body := _fold(layout, step, SHARE)) is not None:
        _draw_share(body, step)
    body = layout
    if perturbation.severities and step.use_severity:
        body = _fold(layout, step, PARAMETERS)
    if body is None:
        return
    _draw_parameters(body, step, perturbation, first)
    for part, names in rest.items():
        if (inside := _fold(body, step, part)) is not None:
            _draw_parameters(inside, step, perturbation, names)


def _draw_severity(column: bpy.types.UILayout, step: Any, perturbation: Perturbation) -> None:
    if not step.use_severity:
        column.prop(step, "use_severity")
        return
    row = column.row(align=True)
    slider = row.row(align=True)
    slider.use_property_decorate = not isinstance(perturbation, SEQUENCE_KINDS)
    slider.prop(step, "severity", slider=True)
    row.prop(step, "use_severity", text="")
    if (curve := curve_of(step)) is not None:
        column.label(text=f"{len(curve.keyframe_points)} keys: each frame has its own", icon="KEYFRAME")


def _changes_in_time(perturbation: Perturbation, step: Any) -> bool:
    return len(perturbation.temporals) > 1 or _has_modes(perturbation, step)


def _has_modes(perturbation: Perturbation, step: Any) -> bool:
    by_severity = bool(perturbation.severities) and step.use_severity
    return by_severity and not isinstance(perturbation, SEQUENCE_KINDS) and curve_of(step) is None


def _draw_time(layout: bpy.types.UILayout, step: Any, perturbation: Perturbation) -> None:
    """Draw whether the severity changes from frame to frame, and how the pattern does."""
    if _has_modes(perturbation, step):
        label, buttons = _split_row(layout)
        label.label(text="Severity")
        buttons.prop(step, "mode", expand=True)
    if len(perturbation.temporals) > 1:
        label, buttons = _split_row(layout)
        label.label(text="Pattern")
        for value in perturbation.temporals:
            buttons.prop_enum(step, "temporal", value)


def _fold(layout: bpy.types.UILayout, step: Any, part: str) -> bpy.types.UILayout | None:
    """Return a sub-panel of the selected perturbation, which is closed at first; None while it is."""
    header, body = layout.panel(f"noisy_world_{step.perturbation}_{part}", default_closed=True)
    header.label(text=part)
    if body is not None:
        body.active = step.enabled
    return body


def _draw_parameters(layout: bpy.types.UILayout, step: Any, perturbation: Perturbation, names: Sequence[str]) -> None:
    """Draw parameters; three that are a colour as one."""
    for picker, channels in colours_in(perturbation.parameters).items():
        names = [picker if name == channels[0] else name for name in names if name not in channels[1:]]
    for name in names:
        _draw_parameter(layout, step, perturbation, name)


def _draw_share(column: bpy.types.UILayout, step: Any) -> None:
    """Draw how much of the effect shows, and where."""
    column.prop(step, SHARE_MIX, slider=True)
    if (curve := curve_of(step, SHARE_MIX)) is not None:
        column.label(text=f"{len(curve.keyframe_points)} keys: each frame has its own", icon="KEYFRAME")
    row = column.row()
    row.use_property_decorate = False
    row.prop(step, SHARE_MASK)
    if has_colour(perturbation_of(step)):
        row = column.row()
        row.use_property_decorate = False
        row.prop(step, SHARE_COLOUR)


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
    if getattr(group, GIVEN + name):
        row.prop(group, property_name(name), text="")
    else:
        row.label(text=_severity_value(step, perturbation, name))
    row.prop(group, GIVEN + name, text="", icon="GREASEPENCIL")


def _severity_value(step: Any, perturbation: Perturbation, name: str) -> str:
    if step.severity < SEVERITIES[0]:
        return "No effect"
    value = getattr(perturbation.at_severity(step.severity), name)
    return f"{value:.4g}{_unit(perturbation, name)}"


def _unit(perturbation: Perturbation, name: str) -> str:
    unit = next(item for item in fields(perturbation.parameters) if item.name == name).metadata["key"].unit
    return f" {unit}" if unit not in ("", "deg", "frames") else ""
