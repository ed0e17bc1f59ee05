# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of Noisy World's own in the user's file, so that what it loads and what the user made are in no way of
one another.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ..nodes.datablocks import override
from .exclusions import RENDERED
from .own_objects import OURS, own_object
from .properties import panel_of
from .views import WORKBENCH, shading_of, use_standard_view

NAME = "Noisy World"
MADE_FROM = "noisy_world_made_from"  # of a scene of ours: the user's scene that its window showed before
VIEW_BEFORE = "noisy_world_view_before"  # of a scene of ours: how the view showed the user's scene, as JSON
STORED = "noisy_world"  # where a scene holds the panel, as system property


def is_apart(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene was made by Noisy World, to load into."""
    return MADE_FROM in scene


def is_clear(scene: bpy.types.Scene) -> bool:
    """Tell whether what is loaded into a scene stands alone there, or beside what was loaded before."""
    if is_apart(scene) or own_object(scene, "mesh") is not None or own_object(scene, "camera") is not None:
        return True
    return not any(item.type in RENDERED and OURS not in item for item in scene.objects)


def origin_of(scene: bpy.types.Scene) -> bpy.types.Scene | None:
    """Return the user's scene that a scene of ours was made from; None where it is gone, and of any other scene."""
    origin = scene.get(MADE_FROM)
    return origin if isinstance(origin, bpy.types.Scene) and origin in set(bpy.data.scenes) else None


@contextmanager
def entered(context: bpy.types.Context, *, apart: bool = True) -> Iterator[bpy.types.Scene]:
    """Let the window show a scene of ours with the panel of the one that it shows; give that scene.

    It is the one that was made from it before, where there is one: with the panel as it is now. After an error the
    window shows the user's again, and a scene that was made for this is gone. apart: False for the scene as it is.
    """
    origin = context.scene
    if not apart or is_apart(origin):
        yield origin
        return
    known = next((item for item in bpy.data.scenes if item.library is None and origin_of(item) == origin), None)
    made = known or _emptied_copy(origin)
    if known is not None:
        _copy_panel(origin, known)
    _remember_view(context, made)
    _show(context, made)
    try:
        yield made
    except BaseException:
        leave(context)
        if known is None:
            bpy.data.scenes.remove(made)
        raise


def leave(context: bpy.types.Context) -> None:
    """Let the window show the user's scene again, and the view as it was."""
    scene, space = context.scene, _space_of(context)
    origin = origin_of(scene)
    if origin is None:
        return
    _show(context, origin)
    before = json.loads(scene.get(VIEW_BEFORE, "null"))
    if space is None or before is None:
        return
    shading = shading_of(space)
    shading.type, shading.light, shading.color_type = before["shading"]
    assert space.region_3d is not None
    space.region_3d.view_perspective = before["perspective"]


def look_through_camera(context: bpy.types.Context) -> None:
    """Let the view look through the scene's camera, at all of its picture."""
    space, area = _space_of(context), view_of(context)
    if space is None or area is None or space.region_3d is None:
        return
    space.region_3d.view_perspective = "CAMERA"
    region = next(item for item in area.regions if item.type == "WINDOW")
    with override(window=context.window, area=area, region=region):
        bpy.ops.view3d.view_center_camera()


def show_unlit(scene: bpy.types.Scene, context: bpy.types.Context, colours: Any) -> None:
    """Let the scene's renders and the view show the mesh's own colours, by the engine that begins at once.

    colours: "VERTEX" or "TEXTURE".
    """
    engine: Any = WORKBENCH  # the stubs know EEVEE alone
    scene.render.engine = engine
    assert scene.display is not None
    scene.display.viewport_aa = "OFF"
    space = _space_of(context)
    for shading in (scene.display.shading, *([] if space is None else [shading_of(space)])):
        assert shading is not None
        shading.light, shading.color_type = "FLAT", colours
    if space is not None:
        shading_of(space).type = "RENDERED"


def view_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """Return the 3D view in use: the one that the button stands in, else the window's largest."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = [] if context.window is None else [item for item in context.window.screen.areas if item.type == "VIEW_3D"]
    return max(areas, key=lambda item: item.width * item.height, default=None)


def _space_of(context: bpy.types.Context) -> bpy.types.SpaceView3D | None:
    area = view_of(context)
    space = None if area is None else area.spaces.active
    return space if isinstance(space, bpy.types.SpaceView3D) else None


def _show(context: bpy.types.Context, scene: bpy.types.Scene) -> None:
    assert context.window is not None, "buttons stand in one"
    context.window.scene = scene


def _remember_view(context: bpy.types.Context, made: bpy.types.Scene) -> None:
    space = _space_of(context)
    if space is None or space.region_3d is None or context.scene == made:
        return
    shading = shading_of(space)
    shown = [shading.type, shading.light, shading.color_type]
    made[VIEW_BEFORE] = json.dumps({"shading": shown, "perspective": space.region_3d.view_perspective})


def _emptied_copy(origin: bpy.types.Scene) -> bpy.types.Scene:
    """Return a copy of a scene without anything in it: its settings and its panel, which shows no preview."""
    made = origin.copy()
    assert isinstance(made, bpy.types.Scene)
    assert made.collection is not None
    made.name = NAME
    for child in list(made.collection.children):
        made.collection.children.unlink(child)
    for item in list(made.collection.objects):
        made.collection.objects.unlink(item)
    made.world = made.background_set = made.camera = made.compositing_node_group = None
    made.timeline_markers.clear()
    if made.animation_data is not None and made.animation_data.action is not None:
        made.animation_data.action = made.animation_data.action.copy()  # severities are keyed in it
    for name in [name for name in made.keys() if name.startswith("noisy_world_")]:  # noqa: SIM118  an ID is no mapping
        del made[name]
    made[MADE_FROM] = origin
    panel_of(made).preview = False
    use_standard_view(made)
    return made


def _copy_panel(origin: bpy.types.Scene, made: bpy.types.Scene) -> None:
    """Let our scene's panel hold what the origin's holds."""
    held = origin.bl_system_properties_get()
    holding = made.bl_system_properties_get(do_create=True)
    made.property_unset(STORED)
    if held is not None and holding is not None and STORED in held:
        holding[STORED] = held[STORED].to_dict()
