# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of perturbations: its entries, their order, and what of them is keyed on the timeline."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..nodes.chain_scene import action_bag
from ..nodes.datablocks import action_of, fcurves_of, interpolation, new_action
from ..perturbations import registry
from ..perturbations.kinds import SEQUENCE_KINDS, SEVERITIES
from ..perturbations.shares import has_share
from .fields import notify_once

# Severities and mixes that are keyed on the timeline, by frames as presets hold them; and keys that nothing honours.


STEPS = "noisy_world.steps"
SEVERITY, SHARE_MIX, SHARE_MASK, SHARE_COLOUR = "severity", "share_mix", "share_mask", "share_colour"
DIGITS = 3  # of a value that a curve gives; chosen: finer than anyone sees


def may_key(step: Any, name: str = SEVERITY) -> bool:
    """Tell whether presets hold an entry's severity, or another value of that name, frame by frame."""
    perturbation = registry().get(step.perturbation)
    if perturbation is None or isinstance(perturbation, SEQUENCE_KINDS):
        return False
    return bool(perturbation.severities) if name == SEVERITY else has_share(perturbation)


def is_keyed(step: Any) -> bool:
    """Tell whether something of an entry is keyed that presets hold frame by frame."""
    return any(curve_of(step, name) is not None for name in (SEVERITY, SHARE_MIX))


def curve_of(step: Any, name: str = SEVERITY) -> bpy.types.FCurve | None:
    """Return the curve of an entry's severity, or of its mix; None where it is not keyed."""
    if not may_key(step, name):
        return None
    data = step.id_data.animation_data
    path = f"{step.path_from_id()}.{name}"
    curves = [] if data is None else fcurves_of(data)
    return next((curve for curve in curves if curve.data_path == path and not curve.mute and curve_ends(curve)), None)


def curve_ends(curve: bpy.types.FCurve) -> tuple[float, float] | None:
    """Return the frames of a curve's first and last key; None without keys."""
    points = curve.keyframe_points
    return (points[0].co.x, points[len(points) - 1].co.x) if len(points) else None


def levels_of(step: Any, shown: NDArray[np.int64] | None, name: str = SEVERITY) -> list[float] | None:
    """Return an entry's severity, or its mix, for each frame of the sequence; None where it is not keyed.

    The last one holds for all that follow. shown: (N,) the scene frames that the sequence shows; None for all from 0.
    """
    curve = curve_of(step, name)
    if curve is None:
        return None
    ends = curve_ends(curve)
    assert ends is not None
    endless = curve.extrapolation == "LINEAR" or len(curve.modifiers) > 0
    last = max(math.ceil(ends[1]), step.id_data.frame_end if endless else 0, 0)
    frames = range(last + 1) if shown is None else [int(frame) for frame in shown]
    levels: list[float] = []
    for frame in frames:
        value = curve.evaluate(frame)
        levels.append(_snapped(value) if name == SEVERITY else round(min(max(value, 0.0), 1.0), DIGITS))
        if frame >= last:
            break
    while len(levels) > 1 and levels[-1] == levels[-2]:
        levels.pop()
    return levels


def _snapped(severity: float) -> float:
    """Return the allowed severity that is nearest: 0, or 1 to 5."""
    lowest, highest = SEVERITIES[0], SEVERITIES[-1]
    inside = round(min(max(severity, 0.0), float(highest)), DIGITS)
    return inside if inside >= lowest else float(int(inside + 0.5))


def key_levels(step: Any, levels: Sequence[float], frames: NDArray[np.int64], name: str = SEVERITY) -> None:
    """Key an entry's severity, or its mix, (N,) as a preset lists it, at scene frames (N,)."""
    scene: bpy.types.Scene = step.id_data
    if scene.animation_data is None or scene.animation_data.action is None:
        new_action(scene, f"{scene.name} severity")
    curve = action_of(scene).fcurve_ensure_for_datablock(scene, f"{step.path_from_id()}.{name}")
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack([frames, levels], axis=1).astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(frames), interpolation("LINEAR"), dtype=np.int32))
    curve.update()


# --- the list's order ---


def reorder(scene: bpy.types.Scene, places: Sequence[int | None]) -> None:
    """Let curves follow their entries of the list. places: where each has gone, by where it was; None has gone."""
    moved: list[tuple[bpy.types.FCurve, str]] = []
    gone: list[bpy.types.FCurve] = []
    for curve, index, rest in list(_curves_of_steps(scene)):
        place = places[index] if index < len(places) else None
        if place is None:
            gone.append(curve)
        elif place != index:
            moved.append((curve, f"{STEPS}[{place}]{rest}"))
    for curve, path in moved:
        curve.data_path = path
    if gone:
        _remove(scene, gone)


def _remove(scene: bpy.types.Scene, curves: Sequence[bpy.types.FCurve]) -> None:
    bag = action_bag(scene)
    for curve in curves:
        bag.fcurves.remove(curve)


def _curves_of_steps(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.FCurve, int, str]]:
    """Yield the curves of entries of the list, the entry's index, and the path after it."""
    data = scene.animation_data
    for curve in [] if data is None else fcurves_of(data):
        head, bracket, rest = curve.data_path.removeprefix(f"{STEPS}[").partition("]")
        if curve.data_path.startswith(f"{STEPS}[") and bracket and head.isdigit():
            yield curve, int(head), rest


# --- what is not honoured ---


def without_effect(scene: bpy.types.Scene) -> list[str]:
    """Return the properties of the panel whose keys or drivers no preset can hold, as paths from the scene."""
    data = scene.animation_data
    if data is None:
        return []
    steps = scene.noisy_world.steps  # pyright: ignore[reportAttributeAccessIssue]  added by register
    curves = [curve_of(step, name) for step in steps for name in (SEVERITY, SHARE_MIX)]
    heard = {curve.data_path for curve in curves if curve is not None}
    strips = [strip for track in data.nla_tracks for strip in track.strips if strip.action is not None]
    in_strips = [curve for strip in strips for curve in _all_curves(strip.action)]
    paths = [curve.data_path for curve in fcurves_of(data) if not curve.mute and curve.data_path not in heard]
    paths += [curve.data_path for curve in (*data.drivers, *in_strips)]
    return sorted({path.removeprefix("noisy_world.") for path in paths if path.startswith("noisy_world.")})


def _all_curves(action: bpy.types.Action | None) -> Iterator[bpy.types.FCurve]:
    for layer in () if action is None else action.layers:
        for strip in layer.strips:
            if isinstance(strip, bpy.types.ActionKeyframeStrip):
                for bag in strip.channelbags:
                    yield from bag.fcurves


# --- its entries ---


def add_step(panel: Any, name: str) -> int:
    """Add a perturbation to the list in propagation order, after others of its name; return its index.

    Its pattern changes from frame to frame as it does in the world.
    """
    with notify_once():
        item = panel.steps.add()
        item.perturbation = name
        if registry()[name].temporals:
            item.temporal = registry()[name].natural
    places = list(registry())
    order = [places.index(step.perturbation) if step.perturbation in places else len(places) for step in panel.steps]
    place = sum(other <= order[-1] for other in order[:-1])
    move_entry(panel, len(order) - 1, place)
    panel.active_step = place
    return place


def move_entry(panel: Any, here: int, there: int) -> None:
    """Move an entry of the list, with its keys."""
    if here == there:
        return
    order = list(range(len(panel.steps)))
    order.insert(there, order.pop(here))
    panel.steps.move(here, there)
    reorder(panel.id_data, [order.index(index) for index in range(len(order))])


def remove_entry(panel: Any, index: int) -> None:
    """Remove an entry of the list, with its keys."""
    count = len(panel.steps)
    panel.steps.remove(index)
    reorder(panel.id_data, [None if k == index else k - (k > index) for k in range(count)])


def clear_entries(panel: Any) -> None:
    """Empty the list, with its keys."""
    panel.steps.clear()
    reorder(panel.id_data, [])


def may_move(panel: Any, by: int) -> bool:
    """Tell whether the selected entry may swap with its neighbour in this direction: only if their names are equal."""
    here, there = panel.active_step, panel.active_step + by
    if not (0 <= here < len(panel.steps) and 0 <= there < len(panel.steps)):
        return False
    return panel.steps[here].perturbation == panel.steps[there].perturbation
