# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that links groups of weather in the scene's own compositor to its camera and frame rate."""

from typing import Any

import bpy

from ..blender.camera_links import has_several_cameras, link_camera, linkable
from ..blender.scene_camera import bound_cameras
from ..blender.typed import camera_of
from ..core.errors import NoisyWorldError
from .operators import UNDOABLE, OnScene, guarded


class NoisyWorldLinkCamera(OnScene, bpy.types.Operator):
    """Let this scene's own Noisy World groups follow its camera and frame rate, by drivers; press again when the camera's path has changed, for streaks"""  # noqa: E501 - a tooltip

    bl_idname = "noisy_world.link_camera"
    bl_label = "Link Groups to Camera"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a camera, and a group that looks at it."""
        if not super().poll(context):
            return False
        if context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        if not linkable(context.scene):
            cls.poll_message_set("The scene's compositor has no group that asks for camera or frame rate")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Link them."""

        def work() -> str:
            scene = context.scene
            if scene.camera is None or scene.camera.type != "CAMERA":
                raise NoisyWorldError("the scene's camera is no camera: choose one in Scene > Camera")
            bound = tuple(dict.fromkeys(item for _, item in bound_cameras(scene)))
            cameras = bound if has_several_cameras(scene) else (scene.camera,)
            for item in cameras:
                if camera_of(item).type != "PERSP":
                    raise NoisyWorldError(f"{item.name} is not perspective, as these groups expect: change its type")
            nodes = ", ".join(link_camera(scene))
            if len(cameras) == 1:
                return f"Linked to {scene.camera.name}: {nodes}"
            return f"Keyed along {', '.join(item.name for item in cameras)}, which markers bind: {nodes}"

        return guarded(self, work)


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button in the tab where there is something to link."""
    if context.scene.camera is not None and linkable(context.scene):
        layout.operator(NoisyWorldLinkCamera.bl_idname, icon="CON_CAMERASOLVER")


def _draw_in_menu(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry in the node editor's menu Node, for groups from the asset shelf."""
    space = context.space_data
    if isinstance(space, bpy.types.SpaceNodeEditor) and space.tree_type == "CompositorNodeTree":
        assert menu.layout is not None
        menu.layout.separator()
        menu.layout.operator(NoisyWorldLinkCamera.bl_idname, icon="CON_CAMERASOLVER")


_DRAWS: Any = _draw_in_menu  # the stubs give such functions no menu
_register_classes, _unregister_classes = bpy.utils.register_classes_factory((NoisyWorldLinkCamera,))


def register() -> None:
    """Register the button, in the tab and in the node editor's menu."""
    _register_classes()
    bpy.types.NODE_MT_node.append(_DRAWS)  # looked up anew: reloading scripts makes another class of it


def unregister() -> None:
    """Unregister it."""
    bpy.types.NODE_MT_node.remove(_DRAWS)
    _unregister_classes()
