# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the scenes of a preset can give the channels that tell of the surface of a mesh."""

from ..channels import surface_channels
from ..presets.preset import Preset
from .source import Scene

SURFACE_ENGINES = ("cycles", "embree")  # that tell which surface a pixel sees


def check_surface(scene: Scene, preset: Preset) -> None:
    """Refuse channels of a mesh's surface where frames are not of one, or are rendered by an engine without them.

    Raises InputError.
    """
    asked = [item.name for item in surface_channels(preset.spec.output.modalities)]
    if not asked:
        return
    place, what, engine = preset.place("output.modalities"), " and ".join(asked), preset.spec.render.engine
    if not scene.source.gives.surface:
        problem = f"{what}: {scene.name} has none: it comes from meshes that are shown as they are stored"
        raise place.error(problem, "take it out, or leave that scene out")
    for item in surface_channels(asked):
        if problem := item.problem(scene.source.location):
            raise scene.place.at(scene.source.gives.key).error(
                f"has no {item.name}: {problem}", "name such a mesh, or take it out"
            )
    if engine not in SURFACE_ENGINES:
        raise place.error(f"{what}: render.engine {engine} cannot tell it", f"use {' or '.join(SURFACE_ENGINES)}")
