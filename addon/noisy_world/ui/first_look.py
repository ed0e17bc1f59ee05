# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel begins with in a file that it has not been used in: an artist's own scene is what it is about."""

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ..core.presets.names import safe_name
from .excluded import RENDERED
from .properties import panel_of

STARTUP = {"Cube", "Light"}  # what Blender's default scene renders


def begin(scene: bpy.types.Scene) -> None:
    """Let a scene's panel begin with This Scene, where it was never used and there is more than the default scene.

    The dataset's scene has the file's name, where a folder can have it.
    """
    if scene.library is None and scene.is_editable and not is_used(scene) and has_own_content(scene):
        panel_of(scene).mesh_source = "SCENE"
        name = Path(bpy.data.filepath).stem
        if name and not safe_name(name):
            panel_of(scene).scene_name = name


def is_used(scene: bpy.types.Scene) -> bool:
    """Tell whether a file holds any value of a scene's panel."""
    stored = scene.bl_system_properties_get()
    return stored is not None and "noisy_world" in stored and len(stored["noisy_world"].keys()) > 0


def has_own_content(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene renders anything but what Blender's default scene does."""
    return any(item.type in RENDERED and item.name not in STARTUP for item in scene.objects)


@persistent
def _on_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        begin(scene)


def _on_start() -> None:
    _on_load()


def register_first_look() -> None:
    """Register the handler of files that are opened, and look at the one that is open."""
    bpy.app.handlers.load_post.append(_on_load)
    # Later, as Blender's data cannot be accessed while add-ons are registered.
    bpy.app.timers.register(_on_start, first_interval=0.0)


def unregister_first_look() -> None:
    """Unregister both."""
    if bpy.app.timers.is_registered(_on_start):
        bpy.app.timers.unregister(_on_start)
    bpy.app.handlers.load_post.remove(_on_load)
