# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that keys how the camera moves in groups of weather in the scene's own compositor."""

from typing import Any

import bpy

from ..blender.camera_links import has_several_cameras, key_motion, keyable
from ..blender.scene_camera import bound_cameras
from ..blender.typed import camera_of
from ..core.errors import NoisyWorldError
from .operators import UNDOABLE, OnScene, guarded


class NoisyWorldKeyCameraMotion(OnScene, bpy.types.Operator):
    """Key how the camera moves in this scene's own Noisy World groups, which draws streaks; press again when its path has changed"""  # noqa: E501 - a tooltip

    bl_idname = "noisy_world.key_camera_motion"
    bl_label = "Key Camera Motion"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a camera, and a group that draws streaks."""
        if not super().poll(context):
            return False
        if context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        if not keyable(context.scene):
            cls.poll_message_set("The scene's compositor has no group that asks how the camera moves")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Key it."""

        def work() -> str:
            scene = context.scene
            if scene.camera is None or scene.camera.type != "CAMERA":
                raise NoisyWorldError("the scene's camera is no camera: choose one in Scene > Camera")
            bound = tuple(dict.fromkeys(item for _, item in bound_cameras(scene)))
            cameras = bound if has_several_cameras(scene) else (scene.camera,)
            for item in cameras:
                if camera_of(item).type != "PERSP":
                    raise NoisyWorldError(f"{item.name} is not perspective, as these groups expect: change its type")
            nodes = ", ".join(key_motion(scene))
            bound_by = ", which markers bind" if len(cameras) > 1 else ""
            return f"Keyed along {', '.join(item.name for item in cameras)}{bound_by}: {nodes}"

        return guarded(self, work)


def draw_camera_link(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button in the tab where there is something to key."""
    if context.scene.camera is not None and keyable(context.scene):
        layout.operator(NoisyWorldKeyCameraMotion.bl_idname, icon="CON_CAMERASOLVER")


def _draw_in_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry in the node editor's menu Node, for groups from the asset shelf."""
    space = context.space_data
    if isinstance(space, bpy.types.SpaceNodeEditor) and space.tree_type == "CompositorNodeTree":
        assert menu.layout is not None
        menu.layout.separator()
        menu.layout.operator(NoisyWorldKeyCameraMotion.bl_idname, icon="CON_CAMERASOLVER")


_DRAWS: Any = _draw_in_menu  # the stubs give such functions no menu
_register_classes, _unregister_classes = bpy.utils.register_classes_factory((NoisyWorldKeyCameraMotion,))


def register_camera_link() -> None:
    """Register the button, in the tab and in the node editor's menu."""
    _register_classes()
    bpy.types.NODE_MT_node.append(_DRAWS)  # looked up anew: reloading scripts makes another class of it


def unregister_camera_link() -> None:
    """Unregister it."""
    bpy.types.NODE_MT_node.remove(_DRAWS)
    _unregister_classes()
