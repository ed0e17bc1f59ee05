# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview: the panel's perturbations on the view and on the last render, following every slider."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import gpu
from bpy.app.handlers import persistent

from ..blender.chain_scene import hide_chain, refresh_chain
from ..core.errors import NoisyWorldError
from . import frame_preview, properties, views
from .document import intrinsics_of
from .long_text import write
from .operators import DONE, UNDOABLE, OnScene
from .properties import panel_of

DEVICE_CHANGED = "noisy_world_composites_on_processor"
# Chosen by trying: slower pictures make a slider stick, so they wait for a pause.
COSTLY_S = 0.5  # pictures that take longer wait for a pause
PAUSE_S = 0.3  # without a change counts as a pause
POLL_S = 0.05  # between looks for a pause
RENDERED_BY = {
    "seed", "scene_name", "setting_name", "deviation_rotation_deg", "deviation_translation_m",
    "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "near_m", "far_m",
}  # fmt: skip
"""Properties that move or change the camera, by the names that listeners get."""
SHOWN_BY = {"preview", "preview_split", "steps", "speed_factor", "backend"} | RENDERED_BY
"""What a preview depends on."""

_changed_s: dict[int, float] = {}  # by scene: the time of its last change that is not shown yet
_errors: dict[int, str] = {}  # by scene


# --- following ---


def touch(scene: bpy.types.Scene, what: str = "steps") -> None:
    """Update a scene's preview after a change: its chain at once, its pictures in the next pause if they are slow.

    Blender redraws all views on any change, so delaying the chain would only have them drawn twice.
    """
    if not isinstance(scene, bpy.types.Scene) or what not in SHOWN_BY:
        return
    if what in RENDERED_BY:
        frame_preview.forget(scene)
    if what == "preview":
        _changed_s[scene.session_uid] = 0.0
    elif panel_of(scene).preview:
        apply(scene)
        if not frame_preview.watching(scene):
            return
        if not is_costly(scene):
            draw_pictures(scene)
            return
        _changed_s[scene.session_uid] = time.perf_counter()
    else:
        return
    if not bpy.app.timers.is_registered(_follow):
        bpy.app.timers.register(_follow, first_interval=0.0)


def _follow() -> float | None:
    """Draw what is due; return the seconds to the next call while something waits."""
    now_s = time.perf_counter()
    for scene in bpy.data.scenes:
        changed_s = _changed_s.get(scene.session_uid)
        if changed_s is not None and now_s - changed_s >= PAUSE_S:
            del _changed_s[scene.session_uid]
            apply(scene)
            draw_pictures(scene)
    known = {scene.session_uid for scene in bpy.data.scenes}
    for gone in _changed_s.keys() - known:
        del _changed_s[gone]
    return POLL_S if _changed_s else None


def flush() -> None:
    """Draw at once everything that waits."""
    for scene in bpy.data.scenes:
        if _changed_s.pop(scene.session_uid, None) is not None:
            apply(scene)
            draw_pictures(scene)


def is_costly(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene's pictures take so long that they wait for a pause."""
    return frame_preview.seconds_taken(scene) > COSTLY_S


def apply(scene: bpy.types.Scene) -> None:
    """Show or hide a scene's chain as the panel says; keep the message on what is wrong for the panel."""
    if scene.library is not None:
        return
    with _errors_kept(scene):
        if panel_of(scene).preview:
            _prefer_processor(scene)
            show(scene)
        else:
            hide(scene)
    views.sync_views()


def draw_pictures(scene: bpy.types.Scene) -> None:
    """Redraw a scene's pictures that an image editor shows, while it is in preview."""
    if scene.library is None and panel_of(scene).preview and scene.session_uid not in _errors:
        with _errors_kept(scene):
            frame_preview.follow(scene)
    views.redraw_sidebars()


@contextmanager
def _errors_kept(scene: bpy.types.Scene) -> Iterator[None]:
    _errors.pop(scene.session_uid, None)
    try:
        yield
    except NoisyWorldError as error:
        _errors[scene.session_uid] = str(error)


def show(scene: bpy.types.Scene) -> None:
    """Show the panel's perturbations of colour on a scene's render. Raises NoisyWorldError for wrong values."""
    panel = panel_of(scene)
    sequence, _ = frame_preview.sequence_of(scene)
    refresh_chain(
        scene,
        sequence.setting.rgb,
        sequence.identifiers,
        index_of=sequence.frame_at if sequence.skips else None,
        reference_width_px=panel.width_px,
        split=panel.preview_split,
        intrinsics=intrinsics_of(panel),
    )


def hide(scene: bpy.types.Scene) -> None:
    """Restore what a scene had before the preview."""
    hide_chain(scene)
    if scene.pop(DEVICE_CHANGED, False):
        scene.render.compositor_device = "GPU"


def _prefer_processor(scene: bpy.types.Scene) -> None:
    """Composite the last render on the processor where there is no graphics card: it takes a third of the time."""
    if scene.render.compositor_device == "GPU" and DEVICE_CHANGED not in scene and is_software_gl():
        scene.render.compositor_device = "CPU"
        scene[DEVICE_CHANGED] = True


def is_software_gl() -> bool:
    """Tell whether Blender draws without a graphics card."""
    return not bpy.app.background and gpu.platform.device_type_get() == "SOFTWARE"


@persistent
def _touch_all(*_: Any) -> None:
    """Update all scenes: after undo or loading a file, their previews may not match their properties."""
    for scene in bpy.data.scenes:
        touch(scene, "preview")


def _touch_view(scene: bpy.types.Scene) -> None:
    touch(scene, "preview")


def _resume() -> None:
    _touch_all()


# --- what would falsify the preview ---


def falsified_by(scene: bpy.types.Scene) -> list[str]:
    """Return what in a scene's colour management makes the preview differ from the image that is written."""
    (display, view), found = _colour_management(scene), []
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
    return found


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
    """Show colours as they are written: the Standard view transform without look, exposure, gamma or curves"""

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
    """Set a scene's colour management so that it shows colours as they are written."""
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


# --- the panel's part ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the section: the switch, the split, and what would falsify the preview."""
    scene = context.scene
    panel = panel_of(scene)
    layout.prop(panel, "preview", toggle=True, icon="HIDE_OFF" if panel.preview else "HIDE_ON")
    row = layout.row()
    row.active = panel.preview
    row.prop(panel, "preview_split", slider=True)
    if panel.preview:
        _draw_state(layout, context)
    frame_preview.draw(layout, context)


def _draw_state(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    scene = context.scene
    if error := _errors.get(scene.session_uid):
        write(layout, context, error, "ERROR")
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and not views.is_shaded(space):
        write(layout, context, "This view shows it in Material Preview and Rendered shading", "INFO")
        row = layout.row(align=True)
        if scene.render.engine != "BLENDER_WORKBENCH":  # which has no such shading
            row.prop_enum(space.shading, "type", "MATERIAL", text="Material")
        row.prop_enum(space.shading, "type", "RENDERED")
    if problems := falsified_by(scene):
        write(layout, context, f"Not what is written: {'; '.join(problems)}", "ERROR")
        layout.operator(UseStandardView.bl_idname)
    if is_working_space_wrong():
        text = f"Not what is written: the file's working space is {bpy.data.colorspace.working_space}"
        write(layout, context, text, "ERROR")
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("wm.set_working_color_space", text="Use Linear Rec.709").working_space = "Linear Rec.709"
    if (view_s := views.seconds_taken(scene)) > COSTLY_S:
        write(layout, context, f"This view takes {view_s:.1f} s: Solid shading and Preview Frame are quicker", "TIME")
    if frame_preview.watching(scene) and is_costly(scene):
        waits = ", waiting" if scene.session_uid in _changed_s else ""
        took_s = frame_preview.seconds_taken(scene)
        write(layout, context, f"The picture takes {took_s:.1f} s: it follows when the slider rests{waits}", "TIME")


# --- registration ---

_HANDLERS = ("undo_post", "redo_post", "load_post")


def register() -> None:
    """Register the listeners to properties, undo and the opening of files."""
    bpy.utils.register_class(UseStandardView)
    views.register(_touch_view)
    frame_preview.register()
    properties.LISTENERS.append(touch)
    for name in _HANDLERS:
        getattr(bpy.app.handlers, name).append(_touch_all)
    # Later, as Blender's data cannot be accessed while add-ons are registered.
    bpy.app.timers.register(_resume, first_interval=0.0)


def unregister() -> None:
    """Remove timer and handlers, and hide all chains, which could not be switched off any more."""
    for timer in (_follow, _resume):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    for name in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(_touch_all)
    if touch in properties.LISTENERS:
        properties.LISTENERS.remove(touch)
    for scene in bpy.data.scenes:
        if scene.library is None:
            hide(scene)
    views.give_back_all()
    frame_preview.unregister()
    views.unregister()
    bpy.utils.unregister_class(UseStandardView)
    for cache in (_changed_s, _errors):
        cache.clear()
