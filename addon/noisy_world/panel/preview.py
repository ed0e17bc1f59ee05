# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview: the panel's perturbations on the view and on the last render, following every slider."""

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..core.errors import NoisyWorldError
from ..dataset.sequence import PlannedSequence
from ..nodes.chain_scene import (
    hide_chain,
    hides_compositing,
    is_edited,
    own_compositing,
    refresh_chain,
    set_split,
    shown_chain,
)
from ..nodes.datablocks import layout_of, override
from ..perturbations import registry
from ..perturbations.kinds import DepthPerturbation, PairingPerturbation
from ..render.own_stills import read_frames
from . import exclusions, frame_preview, open_scene, properties, runs, source_views, views
from .document import intrinsics_of
from .fields import Handlers
from .frame_preview import (
    Kind,
    camera_states,
    check_depth,
    count_of_changes,
    forget,
    forget_drawn,
    is_unknown,
    keep,
    outdated,
    path_frames,
    request_of,
    sequence_of,
    show_frame,
    sources_of,
)
from .open_scene import keeps_compositing
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded, push_undo
from .properties import panel_of
from .runs import Following, redraw
from .sidebar import write
from .views import UseStandardView, falsified_by, is_working_space_wrong, shown_after
from .wording import spoken

# Preview Frame and Preview Depth: another Blender renders the frame, and its picture is shown and followed.


BUTTONS: dict[Kind, str] = {"COLOUR": "Preview Frame", "DEPTH": "Preview Depth"}


class _Preview(Following, OnScene):
    """Render the scene's frame in the background, and show it perturbed."""

    bl_options = UNDOABLE
    kind: Kind
    _index = 0
    _began_at = 0  # the count of changes when it was started
    _area = 0  # the area that it was started from

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is a camera to render from, and nothing is rendered yet."""
        if not super().poll(context):
            return False
        if runs.active_still() is not None:
            cls.poll_message_set("A frame is being rendered: Esc stops that")
            return False
        if context.scene.camera is None and not source_views.shows_footage(panel_of(context.scene)):
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Render and show at once, for scripts and for frames that are only read."""

        def work() -> str:
            scene = context.scene
            forget(scene)
            source_views.forget()
            _, index = sequence_of(scene)
            return show_frame(context, scene, self.kind, index)

        return guarded(self, work)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Render while the windows stay usable; the picture that is there stays until the new one comes."""
        if source_views.shows_footage(panel_of(context.scene)):
            return self.execute(context)
        self._area = 0 if context.area is None else context.area.as_pointer()
        return self.followed(context) if self.started(context) else CANCELLED

    def begin(self, scene: bpy.types.Scene) -> runs.SceneRun:
        """Start rendering."""
        _, self._index = sequence_of(scene)
        if self.kind == "DEPTH":
            check_depth(scene)
        request = request_of(scene, sources_of(scene, self.kind, self._index))
        run = runs.start_still(scene, request)
        self._began_at = count_of_changes(scene)
        return run

    def take(self, run: runs.SceneRun) -> str:
        """Show what was rendered, perturbed as the panel says by now."""
        scene = next((item for item in bpy.data.scenes if item.session_uid == run.scene_uid), None)
        if scene is None:
            raise NoisyWorldError("the scene that the frame belongs to is gone")
        changed = count_of_changes(scene) != self._began_at
        for index, still in read_frames(run.folder).items():
            keep(scene, index, still)
        forget_drawn(scene)
        with _over_area(self._area):
            about = show_frame(bpy.context, scene, self.kind, self._index)
        if changed:
            forget(scene)
        return about


@contextmanager
def _over_area(pointer: int) -> Iterator[None]:
    """Let the context be that of an area, where it is still there."""
    windows = bpy.context.window_manager.windows
    places = ((window, area) for window in windows for area in window.screen.areas if area.as_pointer() == pointer)
    window, area = next(places, (None, None))
    if window is None or area is None:
        yield
        return
    region = next(item for item in area.regions if item.type == "WINDOW")
    with override(window=window, screen=window.screen, area=area, region=region):
        yield


class CancelPreview(bpy.types.Operator):
    """Stop rendering; the picture that is there stays"""

    bl_idname = "noisy_world.preview_cancel"
    bl_label = "Cancel"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether a frame is being rendered."""
        return runs.active_still() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop it."""
        run = runs.active_still()
        if run is None:
            return CANCELLED
        run.background.cancel()
        redraw(context)
        return DONE


class PreviewFrame(_Preview, bpy.types.Operator):
    """Render this frame in the background and show it in an image editor, perturbed; where the panel's mesh and path \
are loaded and nothing else is shown, it is as it is written. While Preview is on it follows sliders; Esc stops it"""

    bl_idname = "noisy_world.preview_frame"
    bl_label = "Preview Frame"
    kind: Kind = "COLOUR"


class PreviewDepth(_Preview, bpy.types.Operator):
    """Render this frame's depth in the background and show it in an image editor, in colors, as the generator \
perturbs it; while Preview is on it follows the sliders. Esc stops it"""

    bl_idname = "noisy_world.preview_depth"
    bl_label = "Preview Depth"
    kind: Kind = "DEPTH"


def has_depth_steps(panel: Any) -> bool:
    """Tell whether a step acts on depth or on its pairing."""
    kinds = (DepthPerturbation, PairingPerturbation)
    return any(step.enabled and isinstance(registry().get(step.perturbation), kinds) for step in panel.steps)


def draw_preview_buttons(layout: bpy.types.UILayout, context: bpy.types.Context, *, loaded: bool) -> None:
    """Draw the buttons, that of depth only if a step acts on it, and whether the frames are the dataset's.

    loaded: whether what the panel names is; where it is not, the button that loads it says so.
    """
    column = layout.column(align=True)
    draw_progress(column)
    column.operator(PreviewFrame.bl_idname, icon="IMAGE_DATA")
    if has_depth_steps(panel_of(context.scene)):
        column.operator(PreviewDepth.bl_idname, icon="IMAGE_ZDEPTH")
    if old := outdated(context.scene):
        buttons = " and ".join(BUTTONS[kind] for kind in sorted(old))
        write(layout, context, f"The picture is from before a change: {buttons} renders it anew", "INFO")
    if loaded:
        exclusions.draw_in_preview(layout, context)


def draw_progress(layout: bpy.types.UILayout) -> None:
    """Draw a bar with a button that stops, while a frame is being rendered."""
    run = runs.active_still()
    if run is None:
        return
    row = layout.row(align=True)
    state = run.background
    said = "Stopping" if state.phase == "stopping" else f"Rendering {state.label or 'frame'}"
    row.progress(factor=state.fraction, text=said)
    row.operator(CancelPreview.bl_idname, text="", icon="X")


def draw_in_status_bar(header: bpy.types.Header, _: bpy.types.Context) -> None:
    """Draw the bar in the status bar, too."""
    if runs.active_still() is not None:
        row = layout_of(header).row()
        row.ui_units_x = 10
        draw_progress(row)


STATUS_BAR: Any = draw_in_status_bar  # the stubs give such functions no header
_register_classes, _unregister_classes = bpy.utils.register_classes_factory((PreviewFrame, PreviewDepth, CancelPreview))


def register_preview_buttons() -> None:
    """Register the operators and the bar in the status bar."""
    _register_classes()
    bpy.types.STATUSBAR_HT_header.append(STATUS_BAR)


def unregister_preview_buttons() -> None:
    """Unregister them."""
    bpy.types.STATUSBAR_HT_header.remove(STATUS_BAR)
    _unregister_classes()


DEVICE_CHANGED = "noisy_world_composites_on_processor"
# Chosen by trying: slower pictures make a slider stick, so they wait for a pause.
COSTLY_S = 0.3  # pictures that take longer wait for a pause
PAUSE_S = 0.3  # without a change counts as a pause
POLL_S = 0.05  # between looks for a pause
RENDERED_BY = (
    "seed", "scene.", "setting.name", "of_", "mesh_source", "room_seed", "trajectory_source", "use_camera", "camera.",
    "compositing", "render.use_", "motion",
)  # fmt: skip
"""Properties that move or change the camera, as names that listeners get begin."""
SHOWN_BY = ("preview", "steps", "setting.stream", "render.backend", *RENDERED_BY)
"""What a preview depends on."""

_changed_s: dict[int, float] = {}  # by scene: the time of its last change that is not shown yet
_errors: dict[int, str] = {}  # by scene
_unmade: set[int] = set()  # scenes whose chain is not as the panel says, and has to be made in a step of undo
_at_rest: set[int] = set()  # scenes whose weather is shown as for a camera that stands still


# --- following ---


def touch(scene: bpy.types.Scene, names: Collection[str] = ("steps",)) -> None:
    """Update a scene's preview after changes: its chain at once, its pictures in the next pause if they are slow.

    Blender redraws all views on any change, so delaying the chain would only have them drawn twice.
    """
    if not isinstance(scene, bpy.types.Scene):
        return
    split_alone = set(names) == {"preview_split"}
    if not split_alone:
        frame_preview.forget_drawn(scene)
    if not any(name.startswith(SHOWN_BY) for name in names):
        return
    if any(name.startswith(RENDERED_BY) for name in names):
        frame_preview.forget(scene)
    if "preview" in names:
        apply(scene)  # at once, so that the switch's step of undo has the chain, or has it no more
        _touch_later(scene)
        return
    if panel_of(scene).preview and split_alone and _move_split(scene):
        draw_pictures(scene)
        return
    if panel_of(scene).preview:
        apply(scene)
        if not frame_preview.watching(scene):
            return
        if not is_costly(scene):
            draw_pictures(scene)
            return
        draw_pictures(scene, coarsely=True)
        _changed_s[scene.session_uid] = time.perf_counter()
        _wake()


def _touch_later(scene: bpy.types.Scene) -> None:
    """Update a scene's preview once Blender is idle: its data cannot be changed in handlers and while drawing.

    That is no step of undo, so no data-block is made or removed then.
    """
    frame_preview.forget_drawn(scene)
    _changed_s[scene.session_uid] = 0.0
    _wake()


def _wake() -> None:
    if not bpy.app.timers.is_registered(_follow):
        bpy.app.timers.register(_follow, first_interval=0.0)


def _move_split(scene: bpy.types.Scene) -> bool:
    """Move the edge between before and after in a scene's chain, and nothing else; False where it shows none."""
    tree = scene.compositing_node_group
    if tree is None or shown_chain(scene) is None:
        return False
    set_split(tree, panel_of(scene).preview_split)
    return True


def _follow() -> float | None:
    """Draw what is due; return the seconds to the next call while something waits."""
    now_s = time.perf_counter()
    for scene in bpy.data.scenes:
        changed_s = _changed_s.get(scene.session_uid)
        if changed_s is not None and now_s - changed_s >= PAUSE_S:
            del _changed_s[scene.session_uid]
            frame_preview.forget_drawn(scene)  # it may be coarse
            apply(scene, in_place=True)
            draw_pictures(scene)
    known = {scene.session_uid for scene in bpy.data.scenes}
    for gone in _changed_s.keys() - known:
        del _changed_s[gone]
    return POLL_S if _changed_s else None


def flush() -> None:
    """Draw at once everything that waits."""
    for scene in bpy.data.scenes:
        if _changed_s.pop(scene.session_uid, None) is not None:
            frame_preview.forget_drawn(scene)
            apply(scene, in_place=True)
            draw_pictures(scene)


def is_costly(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene's pictures take so long that they wait for a pause."""
    return frame_preview.seconds_taken(scene) > COSTLY_S


def apply(scene: bpy.types.Scene, *, in_place: bool = False) -> None:
    """Show or hide a scene's chain as the panel says; keep the message on what is wrong for the panel.

    in_place: outside a step of undo, where no data-block may be made or removed: Blender keeps on undo what looks the
    same in two steps, and crashes where that points to what is in neither. What would have to be made is kept for the
    panel, too.
    """
    if scene.library is not None:
        return
    _unmade.discard(scene.session_uid)
    with _errors_kept(scene):
        if panel_of(scene).preview:
            _prefer_processor(scene)
            made = show(scene, in_place=in_place)
        else:
            made = not (in_place and hides_compositing(scene))
            if made:
                hide(scene)
        if not made:
            _unmade.add(scene.session_uid)
    views.sync_views()


def draw_pictures(scene: bpy.types.Scene, *, coarsely: bool = False) -> None:
    """Redraw a scene's pictures that an image editor shows, while it is in preview.

    coarsely: at half their size, as far as that is quick.
    """
    if scene.library is None and panel_of(scene).preview and scene.session_uid not in _errors:
        with _errors_kept(scene):
            frame_preview.follow_coarsely(scene, COSTLY_S) if coarsely else frame_preview.follow(scene)
    views.redraw_sidebars()


@contextmanager
def _errors_kept(scene: bpy.types.Scene) -> Iterator[None]:
    _errors.pop(scene.session_uid, None)
    try:
        yield
    except NoisyWorldError as error:
        _errors[scene.session_uid] = spoken(error.message)


def show(scene: bpy.types.Scene, *, in_place: bool = False) -> bool:
    """Show the panel's perturbations of colour on a scene's render; tell whether that could be.

    in_place: as `apply` has it. Raises NoisyWorldError for wrong values.
    """
    panel = panel_of(scene)
    sequence, _ = frame_preview.sequence_of(scene)
    chain = refresh_chain(
        scene,
        sequence.setting.rgb,
        sequence.identifiers,
        index_of=index_of(scene, sequence),
        reference_width_px=intrinsics_of(panel).width_px,
        split=panel.preview_split,
        intrinsics=intrinsics_of(panel),
        camera_state_at=camera_states(scene, sequence),
        decided_at=frame_preview.decided_at(scene, sequence),
        lit=open_scene.is_shown(panel),
        after_own=not leaves_compositing_out(scene),
        in_place=in_place,
    )
    (_at_rest.add if is_unknown(scene, sequence) else _at_rest.discard)(scene.session_uid)
    return chain is not None


def leaves_compositing_out(scene: bpy.types.Scene) -> bool:
    """Tell whether a dataset of the scene itself is without its compositing, so that previews are without it, too."""
    return open_scene.is_shown(panel_of(scene)) and not keeps_compositing(scene)


def index_of(scene: bpy.types.Scene, sequence: PlannedSequence) -> Callable[[int], int] | None:
    """Return what gives the sequence's frame that a scene frame shows; None where the numbers are equal."""
    if not open_scene.is_shown(panel_of(scene)):
        return sequence.frame_at if sequence.skips else None
    frames = path_frames(scene)
    return lambda frame: sequence.frame_at(int(np.abs(frames - frame).argmin()))


def hide(scene: bpy.types.Scene) -> None:
    """Restore what a scene had before the preview."""
    hide_chain(scene)
    if scene.pop(DEVICE_CHANGED, False):
        scene.render.compositor_device = "GPU"


def _prefer_processor(scene: bpy.types.Scene) -> None:
    """Composite the last render on the processor where there is no graphics card: it takes a third of the time."""
    if scene.render.compositor_device == "GPU" and DEVICE_CHANGED not in scene and frame_preview.is_software_gl():
        scene.render.compositor_device = "CPU"
        scene[DEVICE_CHANGED] = True


@persistent
def _touch_all(*_: Any) -> None:
    """Update all scenes: after undo, their previews may not match their properties."""
    for scene in bpy.data.scenes:
        _touch_later(scene)


@persistent
def _make_all(*_: Any) -> None:
    """Make the previews of a file that was opened as its panels say, before Blender's first step of undo."""
    for scene in bpy.data.scenes:
        apply(scene)
        _touch_later(scene)


@persistent
def _on_keys(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Update a scene whose own keys were changed: a severity may be keyed."""
    action = None if scene.animation_data is None else scene.animation_data.action
    if action is None or not panel_of(scene).preview:
        return
    if any(update.id is not None and update.id.original == action for update in depsgraph.updates):
        _touch_later(scene)


def _resume() -> None:
    """Make the previews of the file that is open as its panels say: a step of undo, where one has to be made."""
    for scene in bpy.data.scenes:
        apply(scene, in_place=True)
        _touch_later(scene)
    if _unmade:
        _make_all()
        push_undo("Noisy World")


# --- the chain, as a user changes it ---


class ResetChain(OnScene, bpy.types.Operator):
    """Make the preview's chain anew, without what was changed in it in the compositor"""

    bl_idname = "noisy_world.reset_chain"
    bl_label = "Reset Chain"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether something was changed."""
        if not super().poll(context):
            return False
        if not is_chain_edited(context.scene):
            cls.poll_message_set("The chain is as the preview made it")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make it anew."""
        hide(context.scene)
        apply(context.scene)
        return DONE


class UpdatePreview(OnScene, bpy.types.Operator):
    """Make the preview as the list says: undo leads to a state in which it was not"""

    bl_idname = "noisy_world.update_preview"
    bl_label = "Update Preview"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether it is otherwise."""
        if not super().poll(context):
            return False
        if context.scene.session_uid not in _unmade:
            cls.poll_message_set("The preview is as the list says")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make it."""
        apply(context.scene)
        draw_pictures(context.scene)
        return DONE


def is_chain_edited(scene: bpy.types.Scene) -> bool:
    """Tell whether a user has changed something inside a scene's chain, which no preset holds."""
    chain = shown_chain(scene)
    return chain is not None and is_edited(chain)


# --- the panel's part ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context, *, loaded: bool = True) -> None:
    """Draw the section: the switch, the split, and what would falsify the preview. loaded: as the buttons have it."""
    scene = context.scene
    panel = panel_of(scene)
    layout.prop(panel, "preview", toggle=True, icon="HIDE_OFF" if panel.preview else "HIDE_ON")
    if scene.session_uid in _unmade:
        write(layout, context, "After undo the preview is not as the list says", "INFO")
        layout.operator(UpdatePreview.bl_idname, icon="FILE_REFRESH")
    if panel.preview:
        layout.prop(panel, "preview_split", slider=True)
        _draw_state(layout, context, loaded=loaded)
    draw_preview_buttons(layout, context, loaded=loaded)


def _draw_state(layout: bpy.types.UILayout, context: bpy.types.Context, *, loaded: bool) -> None:
    scene = context.scene
    if error := _errors.get(scene.session_uid):
        write(layout, context, error, "ERROR")
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and not views.is_shaded(space):
        has_material = scene.render.engine != views.WORKBENCH  # which has no such shading
        shadings = "Material Preview and Rendered" if has_material else "Rendered"
        write(layout, context, f"This view shows it in {shadings} shading", "INFO")
        row = layout.row(align=True)
        if has_material:
            row.prop_enum(space.shading, "type", "MATERIAL", text="Material")
        row.prop_enum(space.shading, "type", "RENDERED")
    views.draw(layout, context)
    if leaves_compositing_out(scene) and own_compositing(scene) is not None:
        text = "The scene's own compositing is left out, as in the dataset: see Compositing, under Scene"
        write(layout, context, text, "INFO")
    if is_chain_edited(scene):
        write(layout, context, "Edited in the compositor: Generate takes the values of this list instead", "ERROR")
        layout.operator(ResetChain.bl_idname, icon="LOOP_BACK")
    if scene.session_uid in _at_rest:
        write(layout, context, "Weather is shown as for a camera at rest: the path is not loaded", "INFO")
        if loaded:
            layout.operator("noisy_world.load_trajectory", icon="CON_FOLLOWPATH")
    _draw_falsified(layout, context)
    if (view_s := views.seconds_taken(scene)) > COSTLY_S:
        write(layout, context, f"This view takes {view_s:.1f} s: Solid shading and Preview Frame are quicker", "TIME")
    if frame_preview.watching(scene) and is_costly(scene):
        waits = ", waiting" if scene.session_uid in _changed_s else ""
        took_s = frame_preview.seconds_taken(scene)
        write(layout, context, f"The picture takes {took_s:.1f} s: it is coarse until the slider rests{waits}", "TIME")


def _draw_falsified(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what makes colours differ from those that are written, each with the button that mends it."""
    scene = context.scene
    if problems := falsified_by(scene):
        write(layout, context, f"Not what is written: {'; '.join(problems)}", "ERROR")
        layout.operator(UseStandardView.bl_idname)
    if view := shown_after(scene):
        text = f"{view} comes after sensor and post-processing here, and before them in the dataset: see Preview Frame"
        write(layout, context, text, "INFO")
    if is_working_space_wrong():
        text = f"Not what is written: the file's working space is {bpy.data.colorspace.working_space}"
        write(layout, context, text, "ERROR")
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("wm.set_working_color_space", text="Use Linear Rec.709").working_space = "Linear Rec.709"


# --- registration ---

CLASSES = (ResetChain, UpdatePreview, views.ShowByEevee, UseStandardView)
_preview_register_classes, _preview_unregister_classes = bpy.utils.register_classes_factory(CLASSES)
_HANDLERS = Handlers(undo_post=_touch_all, redo_post=_touch_all, load_post=_make_all, depsgraph_update_post=_on_keys)


def register() -> None:
    """Register the listeners to properties, undo and the opening of files."""
    _preview_register_classes()
    views.register(_touch_later)
    frame_preview.register()
    register_preview_buttons()
    properties.LISTENERS.append(touch)
    _HANDLERS.add()
    # Later, as Blender's data cannot be accessed while add-ons are registered.
    bpy.app.timers.register(_resume, first_interval=0.0)


def unregister() -> None:
    """Remove timer and handlers, and hide all chains, which could not be switched off any more."""
    for timer in (_follow, _resume):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    _HANDLERS.remove()
    if touch in properties.LISTENERS:
        properties.LISTENERS.remove(touch)
    shown = [scene for scene in bpy.data.scenes if scene.library is None and hides_compositing(scene)]
    for scene in shown:
        hide(scene)
    if shown:
        push_undo("Noisy World")
    views.give_back_all()
    unregister_preview_buttons()
    frame_preview.unregister()
    views.unregister()
    _preview_unregister_classes()
    for cache in (_changed_s, _errors, _unmade):
        cache.clear()
