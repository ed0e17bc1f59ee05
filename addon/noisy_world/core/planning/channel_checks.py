# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that the scenes of a preset can give the channels that it asks for."""

from collections.abc import Sequence

from ..channels import pair_channels, surface_channels
from ..messages import Message, PresetKey, either
from ..optics import Optics
from ..perturbing.steps import Setting
from ..presets.preset import Preset
from .depth_unit import DepthUnit
from .scene import Scene

SURFACE_ENGINES = ("cycles", "embree")  # that tell which surface a pixel sees


def check_surface(scene: Scene, preset: Preset) -> None:
    """Refuse channels of a mesh's surface where frames are not of one, or are rendered by an engine without them.

    Raises InputError.
    """
    asked = [item.name for item in surface_channels(preset.spec.output.modalities)]
    if not asked:
        return
    place, what, engine = preset.place("output.modalities"), " and ".join(asked), preset.spec.render.engine
    capabilities = scene.source.capabilities
    stored = capabilities.own is None and scene.source.mesh is not None  # shown as it is
    for item in surface_channels(asked):
        if not item.needs <= capabilities.surface:
            problem = f"{item.name}: {scene.name} has none: its source does not tell it"
            raise place.error(f"{problem} as it is rendered here", "take it out, or leave that scene out")
        if stored and (problem := item.problem(scene.source.location)):
            raise scene.error(f"has no {item.name}: {problem}", "name such a mesh", "take it out")
    if capabilities.own is None and engine not in SURFACE_ENGINES:
        problem = Message(f"{what}: ", PresetKey("render.engine"), f" {engine} cannot tell it")
        raise place.error(problem, f"use {' or '.join(SURFACE_ENGINES)}")


def check_light(scene: Scene, settings: Sequence[Setting], preset: Preset) -> None:
    """Refuse light as output where a scene has none, and what acts on the image that a view transform makes of it.

    Raises InputError.
    """
    if not preset.spec.output.format.of_light:
        return
    instead = Message("set ", PresetKey("output.image", "png"))
    if not scene.source.capabilities.lit:
        raise scene.error("has no light of its own, and output.image exr is scene-linear light", instead)
    for setting in settings:
        if late := [step.perturbation for step in setting.rgb if not step.perturbation.acts_on_light]:
            problem = f"{setting.name}: {late[0].name} ({late[0].stage}) acts on what the view transform shows"
            message = f"{problem}, and output.image exr is the light before it"
            raise preset.place("settings").error(message, either("take it out", instead))


def check_pairs(scene: Scene, optics: Optics, preset: Preset, unit: DepthUnit | None = None) -> None:
    """Refuse channels that lead from a frame to the next where depth and poses do not tell them. optics: the scene's.

    unit: the rig's depth sensor, where it is a device of its own.

    Raises InputError.
    """
    asked = pair_channels(preset.spec.output.modalities)
    if not asked:
        return
    capabilities, name = scene.source.capabilities, asked[0].name
    problem, lacks = "", None
    if not capabilities.depth:
        problem, lacks = "without depth nothing tells where its pixels go", "depth"
    elif optics.distortion is not None:
        problem, lacks = "its lens distorts", "pinhole"
    elif unit is not None:
        problem = "rig.depth has a camera or a clock of its own, which does not see what colour sees"
    elif not capabilities.any_pose and not scene.path.known.all():
        problem, lacks = "the poses of some frames are not known", "poses"
    if problem:
        without = Message(f"take {name} out of ", PresetKey("output.modalities"))
        raise scene.error(f"has no {name}: {problem}", without, "leave that scene out", lacks=lacks)


def check_exposed(exposing: str, preset: Preset) -> None:
    """Refuse channels of one moment beside a perturbation of exposure. exposing: what exposes, for the message.

    Raises InputError.
    """
    modalities = preset.spec.output.modalities
    if asked := (*surface_channels(modalities), *pair_channels(modalities)):
        problem = f"{exposing} makes colour and depth of several moments, and no {asked[0].name}"
        raise preset.place("output.modalities").error(problem, "take one of them out")


def check_distorts(scene: Scene, preset: Preset) -> None:
    """Refuse a lens of the preset's camera that a scene's frames do not pass, and channels that are not undistorted.

    Raises InputError.
    """
    camera = preset.spec.camera
    if camera is None or (spec := camera.distortion) is None:
        return
    place = preset.place("camera").at("distortion")
    if not scene.source.capabilities.distorts:
        problem = f"{scene.name} is not seen through it: its source makes frames of a pinhole"
        raise place.error(problem, "leave it out, or take that scene out")
    if spec.undistort and (asked := surface_channels(preset.spec.output.modalities)):
        problem = f"{asked[0].name} is not interpolated"
        raise place.at("undistort").error(problem, Message("take it out of ", PresetKey("output.modalities")))
