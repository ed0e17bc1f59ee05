# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a scene by which its views differ from the images that are written, and a button to mend them."""

from typing import Any

import bpy

from ..blender.typed import get_value, inputs
from ..core.perturbing.kinds import ColourPerturbation
from ..perturbations import registry
from . import excluded, this_scene
from .operators import DONE, UNDOABLE, OnScene
from .own_objects import own_object
from .properties import panel_of

FORMER_WORLD = "noisy_world_former_world"


def falsified_by(scene: bpy.types.Scene) -> list[str]:
    """Return what in a scene's colour management makes the preview differ from the image that is written."""
    (display, view), found = _colour_management(scene), []
    if this_scene.is_shown(panel_of(scene)):
        return []  # written as the scene is shown; `shown_after` says what differs
    if display.display_device != "sRGB":
        found.append(f"the display is {display.display_device}, not sRGB")
    if view.view_transform != "Standard":
        found.append(f"the view transform is {view.view_transform}, not Standard")
    if view.look != "None":
        found.append(f"there is a look, {view.look}")
    if view.exposure != 0:
        found.append(f"exposure is {view.exposure:.2f}, not 0")
    if view.gamma != 1:
        found.append(f"gamma is {view.gamma:.2f}, not 1")
    if view.use_curve_mapping:
        found.append("curves are used")
    if view.use_white_balance:
        found.append("white balance is used")
    if is_void_shown(scene):
        found.append("the world is not black, as is what a dataset shows where there is no surface")
    return found


def shown_after(scene: bpy.types.Scene) -> str:
    """Return the view transform that comes after a sensor in the preview, and before it in the dataset; "" for none."""
    (_, view), panel = _colour_management(scene), panel_of(scene)
    steps = (registry().get(step.perturbation) for step in panel.steps if step.enabled)
    late = any(isinstance(item, ColourPerturbation) and not item.acts_on_light for item in steps)
    return view.view_transform if late and this_scene.is_shown(panel) and view.view_transform != "Standard" else ""


def is_void_shown(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene with our mesh has a world of one colour that is not black: in the dataset it is not seen."""
    tree = None if scene.world is None else scene.world.node_tree
    if tree is None or own_object(scene, "mesh") is None or excluded.is_pictured(scene.world):
        return False
    backgrounds = [node for node in tree.nodes if isinstance(node, bpy.types.ShaderNodeBackground)]
    strengths = [(inputs(node)["Strength"], inputs(node)["Color"]) for node in backgrounds]
    return any(get_value(strength) * max(get_value(colour)[:3]) > 0 for strength, colour in strengths)


def _colour_management(
    scene: bpy.types.Scene,
) -> tuple[bpy.types.ColorManagedDisplaySettings, bpy.types.ColorManagedViewSettings]:
    assert scene.display_settings is not None
    assert scene.view_settings is not None
    return scene.display_settings, scene.view_settings


def is_working_space_wrong() -> bool:
    """Tell whether the file's working colour space is not the one that the groups convert from."""
    return bpy.data.colorspace.working_space != "Linear Rec.709"


class UseStandardView(OnScene, bpy.types.Operator):
    """Show colors as they are written: the Standard view transform without look, exposure, gamma or curves, and \
black where there is no surface"""

    bl_idname = "noisy_world.use_standard_view"
    bl_label = "Use Standard View"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether something has to be changed."""
        if not super().poll(context):
            return False
        if not falsified_by(context.scene):
            cls.poll_message_set("The view is Standard already")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the view."""
        use_standard_view(context.scene)
        return DONE


def use_standard_view(scene: bpy.types.Scene) -> None:
    """Set a scene's colour management so that it shows colours as they are written, without a world of one colour.

    The world stays in the file, as a custom property of the scene.
    """
    if is_void_shown(scene):
        scene[FORMER_WORLD] = scene.world
        scene.world = None
    display, view = _colour_management(scene)
    # The names come from the OpenColorIO configuration; the stubs know none.
    names: dict[str, Any] = {"display": "sRGB", "view": "Standard", "look": "None"}
    display.display_device = names["display"]
    view.view_transform = names["view"]
    view.look = names["look"]
    view.exposure = 0.0
    view.gamma = 1.0
    view.use_curve_mapping = False
    view.use_white_balance = False
