# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's list of perturbations, kept in propagation order, and its entries from a preset's steps."""

from typing import Any

from ..core.perturbing.steps import Step
from ..perturbations import registry
from .described import notify_once
from .keyed import key_severity, reorder
from .properties import OVERRIDE, parameters_of
from .this_scene import follows, frame_range, is_shown, scene_frames
from .typed_numbers import set_value, value_of

RATE = "frame_rate_hz"  # the parameter of what counts time by frames
SAME_RATE = 1e-3  # of a rate: a difference that nobody sees


def take_step(item: Any, step: Step, *, speed_factor: int = 1) -> None:
    """Fill an entry of the list from a preset's step. speed_factor: of the path, for what is keyed along it."""
    item.perturbation = step.perturbation.name
    group = parameters_of(item)
    item.mode = "static" if step.levels is None or step.keyed else "dynamic"
    item.use_severity = step.severity is not None or step.keyed or not step.perturbation.severities
    if step.severity is not None:
        set_value(item, "severity", step.severity)
    if step.perturbation.temporals:
        item.temporal = step.temporal
    for name, value in step.given.items():
        if name in step.perturbation.severities:
            setattr(group, OVERRIDE + name, True)  # first, as this sets the parameter to the severity's value
        set_value(group, name, value)
    if step.keyed and step.levels is not None:
        item.severity = step.levels[0]
        frames = scene_frames(item.id_data, len(step.levels) * speed_factor)[::speed_factor]
        key_severity(item, step.levels, frames)


def put_step(panel: Any, step: Step) -> bool:
    """Let the list hold a preset's step: in place of the entry of its name, else added; tell whether there was one.

    Of several entries of this name, the one with the step's own place among them is replaced.
    """
    same = [index for index, item in enumerate(panel.steps) if item.perturbation == step.perturbation.name]
    place = same[step.occurrence] if step.occurrence < len(same) else None
    if place is not None:
        remove_entry(panel, place)
    made = add_step(panel, step.perturbation.name)
    if place is not None:
        move_entry(panel, made, place)
        panel.active_step = made = place
    take_step(panel.steps[made], step, speed_factor=panel.speed_factor)
    if RATE not in step.given:
        take_rate(panel, panel.steps[made])
    return place is not None


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


def add_own_step(panel: Any, name: str) -> int:
    """Add a perturbation as `add_step` does, at the frame rate of the sequence where the open scene is its source."""
    index = add_step(panel, name)
    take_rate(panel, panel.steps[index])
    return index


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
