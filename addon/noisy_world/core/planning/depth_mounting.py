# SPDX-License-Identifier: GPL-3.0-or-later
"""Putting a rig's depth sensor on the scenes of a preset, and refusing what it cannot do there."""

from collections.abc import Sequence as Many
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..messages import Message, PresetKey
from ..perturbing.kinds import MotionPerturbation
from ..perturbing.steps import Setting, Step
from ..presets.preset import Preset
from ..trajectories.rig import Rig
from .depth_unit import DepthUnit, MountedSource, depth_unit
from .scene import Scene


def mounted(scene: Scene, rig: Rig, preset: Preset) -> Scene:
    """Return a scene as the rig sees it: as it is, unless its depth sensor is a device of its own.

    Raises InputError where the scene's source or the layout does not go with it.
    """
    spec = preset.spec.rig
    assert spec is not None, "there is a rig"
    colour = scene.camera(preset)
    unit = depth_unit(spec.depth, rig, colour)
    if unit is None:
        return scene
    place = preset.place("rig").at("depth")
    if unit.camera is not None and unit.camera.intrinsics != colour and not scene.source.capabilities.depth_cameras:
        problem = f"{scene.name}: its source renders colour and depth through one camera"
        raise place.error(problem, "leave out the size and the focal length, or use a mesh without light: scene")
    if unit.clock is not None and (why := scene.source.capabilities.instants_only):
        raise place.error(f"{scene.name}: depth is exposed between the frames, but {why}", "leave out its clock")
    found = MountedSource(scene.source, unit)
    layout = preset.spec.output.format.layout
    if problem := layout.stamps_problem(found.frame_stamps):
        where = Message("choose another ", PresetKey("output.layout"), ", such as replica, or other times")
        raise place.error(problem, where)
    if found.repeats is not None and layout.lists_depth:
        row = int(np.flatnonzero(found.repeats != np.arange(len(found.repeats)))[0])
        problem = f"is so slow that frames {found.repeats[row]} and {row} show one exposure of depth"
        why = f"{problem}, which the {layout.label} layout lists by time stamps of their own"
        other = Message("use a higher one, or ", PresetKey("output.layout"), " replica")
        raise place.at("rate_hz").error(why, other)
    return replace(scene, source=found)


def unit_of(scene: Scene) -> DepthUnit | None:
    """Return the depth sensor that a scene is seen by, where that is a device of its own."""
    return scene.source.unit if isinstance(scene.source, MountedSource) else None


def repeats_of(scene: Scene) -> NDArray[np.int64] | None:
    """Return (N,) the first frame that shows the exposure of depth which each shows; None where each has its own."""
    return scene.source.repeats if isinstance(scene.source, MountedSource) else None


def check_clock(setting: Setting, moving: Many[Step[MotionPerturbation]], preset: Preset) -> None:
    """Refuse a depth sensor's own clock beside motion that has nothing between its poses. Raises InputError."""
    apart = [step.perturbation for step in moving if step.perturbation.apply is not None]
    if lone := next((item.name for item in apart if not item.continuous), ""):
        problem = f"{setting.name}: rig.depth looks between the poses, but {lone} moves each pose by itself"
        raise preset.place("settings").error(problem, "take one of them out")
