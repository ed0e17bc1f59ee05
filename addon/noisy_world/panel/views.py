# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D views that show a scene: their compositor, the depth it gets, and the settings that falsify them."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy

from ..core.errors import title
from ..nodes.datablocks import get_value, inputs
from ..perturbations import registry
from ..perturbations.kinds import ColourPerturbation
from . import exclusions, open_scene
from .exclusions import enumerated
from .operators import DONE, UNDOABLE, OnScene
from .own_objects import own_object
from .properties import panel_of
from .sidebar import write

FORMER = "noisy_world_former_compositor"
SHADED = ("MATERIAL", "RENDERED")

_took_s: dict[int, float] = {}  # by scene: how long the last picture through the compositor took
_began_s: dict[int, float] = {}  # by region
_handles: list[Any] = []
_on_mismatch: list[Callable[[bpy.types.Scene], None]] = []


def sync_views() -> None:
    """Switch the compositor on in the 3D views of windows that show a scene in preview; restore it in the others.

    A view's former state is stored in its screen, since undo changes neither.
    """
    for window in bpy.context.window_manager.windows:
        if panel_of(window.scene).preview:
            switch_on(window.screen)
        else:
            give_back(window.screen)


def give_back_all() -> None:
    """Restore the former state of the views of all screens."""
    for screen in bpy.data.screens:
        give_back(screen)


def switch_on(screen: bpy.types.Screen) -> None:
    """Show the compositing in a screen's 3D views, only once: a user may then switch it off by hand."""
    if FORMER in screen:
        return
    screen[FORMER] = {view: space.shading.use_compositor for view, space in _views(screen)}
    for _, space in _views(screen):
        space.shading.use_compositor = "ALWAYS"


def give_back(screen: bpy.types.Screen) -> None:
    """Restore the former state of a screen's 3D views."""
    former = screen.pop(FORMER, None)
    if former is None:
        return
    for view, space in _views(screen):
        # A view without a stored state is newer: it was split off one that was switched on.
        space.shading.use_compositor = former.get(view, "DISABLED")


def redraw_sidebars() -> None:
    """Redraw the tab, as its text on the preview may change after the slider has moved."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def _views(screen: bpy.types.Screen) -> Iterator[tuple[str, bpy.types.SpaceView3D]]:
    for number, area in enumerate(screen.areas):
        for space in area.spaces:
            if isinstance(space, bpy.types.SpaceView3D):
                yield str(number), space


def shading_of(space: bpy.types.SpaceView3D) -> bpy.types.View3DShading:
    """Return how a view is shaded."""
    assert space.shading is not None
    return space.shading


def is_shaded(space: bpy.types.Space | None) -> bool:
    """Tell whether a view's shading shows the compositor's result."""
    return isinstance(space, bpy.types.SpaceView3D) and space.shading.type in SHADED


def seconds_taken(scene: bpy.types.Scene) -> float:
    """Return how long the last picture of a scene took in a view that composites; 0 if no view does now."""
    shown = any(
        is_shaded(area.spaces.active)
        for window in bpy.context.window_manager.windows
        if window.scene == scene
        for area in window.screen.areas
    )
    return _took_s.get(scene.session_uid, 0.0) if shown else 0.0


# --- how long a picture takes ---


def _begin() -> None:
    context = bpy.context
    if panel_of(context.scene).preview != (FORMER in context.screen):
        # The window shows another scene or workspace than before. Nothing may be changed while drawing.
        for listener in _on_mismatch:
            listener(context.scene)
    if is_shaded(context.space_data) and context.space_data.shading.use_compositor == "ALWAYS":
        _began_s[context.region.as_pointer()] = time.perf_counter()


def _end() -> None:
    context = bpy.context
    began_s = _began_s.pop(context.region.as_pointer(), None)
    if began_s is not None:
        _took_s[context.scene.session_uid] = time.perf_counter() - began_s


def register(on_mismatch: Callable[[bpy.types.Scene], None]) -> None:
    """Start measuring views. on_mismatch: called with a scene whose view has to be switched on or back."""
    _on_mismatch.append(on_mismatch)
    view = bpy.types.SpaceView3D
    _handles.append(view.draw_handler_add(_begin, (), "WINDOW", "PRE_VIEW"))
    _handles.append(view.draw_handler_add(_end, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Stop measuring."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _on_mismatch.clear()
    _took_s.clear()
    _began_s.clear()


# Views whose compositor is given no depth: those of Cycles and Workbench; and a button for one that has it.


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
    rendered = isinstance(space, bpy.types.SpaceView3D) and shading_of(space).type == "RENDERED"
    return rendered and context.scene.render.engine != "BLENDER_EEVEE"


def _stays_workbench(scene: bpy.types.Scene) -> bool:
    return scene.render.engine == WORKBENCH and open_scene.is_shown(panel_of(scene))


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


# Settings of a scene by which its views differ from the images that are written, and a button to mend them.


FORMER_WORLD = "noisy_world_former_world"


def falsified_by(scene: bpy.types.Scene) -> list[str]:
    """Return what in a scene's colour management makes the preview differ from the image that is written."""
    (display, view), found = _colour_management(scene), []
    if open_scene.is_shown(panel_of(scene)):
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
    return view.view_transform if late and open_scene.is_shown(panel) and view.view_transform != "Standard" else ""


def is_void_shown(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene with our mesh has a world of one colour that is not black: in the dataset it is not seen."""
    tree = None if scene.world is None else scene.world.node_tree
    if tree is None or own_object(scene, "mesh") is None or exclusions.is_pictured(scene.world):
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
