# SPDX-License-Identifier: GPL-3.0-or-later
"""Views whose compositor is given no depth: those of Cycles and Workbench; and a button for one that has it."""

from typing import Any

import bpy

from ..core.labels import title
from ..core.perturbing.kinds import ColourPerturbation
from ..perturbations import registry
from . import this_scene, views
from .excluded import enumerated
from .long_text import write
from .operators import DONE, OnScene
from .properties import panel_of

WORKBENCH = "BLENDER_WORKBENCH"


class ShowByEevee(OnScene, bpy.types.Operator):
    """Show this view by EEVEE, with the scene's own lights and world: of Cycles and Workbench Blender's compositor \
is given no depth in a view. What is rendered and written stays as it is"""

    bl_idname = "noisy_world.show_by_eevee"
    bl_label = "Show by EEVEE"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether this view has no depth, and EEVEE can draw it."""
        if not super().poll(context):
            return False
        if not lacks_depth(context):
            cls.poll_message_set("This view has depth, or shows no compositing")
            return False
        if _stays_workbench(context.scene):
            cls.poll_message_set("The scene is rendered by Workbench, whose views EEVEE cannot draw: use Preview Frame")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show it."""
        show_by_eevee(context.scene, context.space_data.shading)
        return DONE


def show_by_eevee(scene: bpy.types.Scene, shading: bpy.types.View3DShading) -> None:
    """Let a view be drawn by EEVEE, lit as the scene is. A dataset of the panel's mesh does not ask for the engine."""
    if scene.render.engine == WORKBENCH:
        scene.render.engine = "BLENDER_EEVEE"
        shading.type = "RENDERED"
        return
    shading.type = "MATERIAL"
    shading.use_scene_lights = shading.use_scene_world = True


def lacks_depth(context: bpy.types.Context) -> bool:
    """Tell whether the view in use composites, and is drawn by an engine that gives its compositor no depth."""
    space = context.space_data
    rendered = isinstance(space, bpy.types.SpaceView3D) and views.shading_of(space).type == "RENDERED"
    return rendered and context.scene.render.engine != "BLENDER_EEVEE"


def _stays_workbench(scene: bpy.types.Scene) -> bool:
    return scene.render.engine == WORKBENCH and this_scene.is_shown(panel_of(scene))


def reading_depth(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Return the names of the panel's perturbations that read depth."""
    found = (registry()[step.perturbation] for step in panel_of(scene).steps if step.enabled and _reads_depth(step))
    return tuple(dict.fromkeys(title(item.label) for item in found))


def _reads_depth(step: Any) -> bool:
    known = registry().get(step.perturbation)
    return isinstance(known, ColourPerturbation) and known.needs_depth


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what the view in use does not show as it is written, and the button."""
    if not lacks_depth(context) or not (names := reading_depth(context.scene)):
        return
    text = f"This view has no depth, so {enumerated(names)} pass{'es' if len(names) == 1 else ''} the picture unchanged"
    if _stays_workbench(context.scene):
        write(layout, context, f"{text}; Preview Frame does", "ERROR")
        return
    write(layout, context, f"{text}; EEVEE's has one", "ERROR")
    layout.operator(ShowByEevee.bl_idname, icon="SHADING_RENDERED")


def draw_beside(layout: bpy.types.UILayout, context: bpy.types.Context, step: Any) -> None:
    """Draw it in short beside the selected step: a long list hides the section of the preview."""
    shown = panel_of(context.scene).preview and step.enabled and _reads_depth(step)
    if not shown or not lacks_depth(context):
        return
    if _stays_workbench(context.scene):
        write(layout, context, "This view has no depth, so it is not shown: see Preview Frame", "ERROR")
        return
    write(layout, context, "This view has no depth, so it is not shown", "ERROR")
    layout.operator(ShowByEevee.bl_idname, icon="SHADING_RENDERED")
