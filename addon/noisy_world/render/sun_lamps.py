# SPDX-License-Identifier: GPL-3.0-or-later
"""The sun lamps of a scene of one's own, softened for a while as by heavy air."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..nodes.datablocks import curves_in
from ..scenes.blend_scene import Problem
from ..scenes.sun_air import SunAir

CHANGED = ("angle", "exposure")
"""What is changed of a lamp: its strength stays as it is, keyed or not, and is multiplied by its exposure."""


def suns_of(blocks: Iterable[bpy.types.ID]) -> list[bpy.types.SunLight]:
    """Return the sun lamps among the data-blocks of a scene."""
    return [block for block in blocks if isinstance(block, bpy.types.SunLight)]


def not_softened(scene: bpy.types.Scene, blocks: Iterable[bpy.types.ID]) -> Problem | None:
    """Return why the sun of a scene cannot be softened; None where it can."""
    suns = suns_of(blocks)
    if not suns:
        problem = f"the scene {scene.name} has no sun lamp that air could soften"
        return Problem("air", problem, "add one, or leave air out")
    moving = [f"{sun.name} {path}" for sun in suns for path in CHANGED if path in _animated(sun)]
    if moving:
        problem = f"the air decides what is keyed or driven in the .blend: {', '.join(moving)}"
        return Problem("air", problem, "take the keys out of the lamp, or leave air out")
    return None


def _animated(sun: bpy.types.SunLight) -> set[str]:
    """Return the paths of a lamp's properties that keys, drivers or strips of its own set."""
    data = sun.animation_data
    if data is None:
        return set()
    strips = [strip for track in data.nla_tracks for strip in track.strips]
    actions = [(strip.action, strip.action_slot) for strip in strips] + [(data.action, data.action_slot)]
    curves = [*data.drivers, *(curve for action, slot in actions for curve in curves_in(action, slot))]
    return {curve.data_path for curve in curves}


@contextmanager
def softened(suns: Sequence[bpy.types.SunLight], air: SunAir) -> Iterator[None]:
    """Let lamps shine as through air, in memory alone; they have their own light again afterwards."""
    own = [(sun, sun.angle, sun.exposure) for sun in suns]
    try:
        for sun, angle_rad, stops in own:
            sun.angle, sun.exposure = air.angle_rad(angle_rad), stops + air.stops
        yield
    finally:
        for sun, angle_rad, stops in own:
            sun.angle, sun.exposure = angle_rad, stops
