# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview Frame and Preview Depth: another Blender renders the frame, and its picture is shown and followed."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ..blender.still_process import read_frames
from ..blender.typed import layout_of, override
from ..core.errors import NoisyWorldError
from ..core.perturbing.kinds import DepthPerturbation, PairingPerturbation
from ..perturbations import registry
from . import excluded, footage, runs
from .following import Following, redraw
from .frame_preview import (
    Kind,
    count_of_changes,
    forget,
    forget_drawn,
    keep,
    outdated,
    sequence_of,
    show_frame,
    sources_of,
)
from .long_text import write
from .operators import CANCELLED, DONE, UNDOABLE, OnScene, guarded
from .properties import panel_of
from .stills import check_depth, request_of

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
        if context.scene.camera is None and not footage.is_shown(panel_of(context.scene)):
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Render and show at once, for scripts and for frames that are only read."""

        def work() -> str:
            scene = context.scene
            forget(scene)
            footage.forget()
            _, index = sequence_of(scene)
            return show_frame(context, scene, self.kind, index)

        return guarded(self, work)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Render while the windows stay usable; the picture that is there stays until the new one comes."""
        if footage.is_shown(panel_of(context.scene)):
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


def draw_preview_buttons(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons, that of depth only if a step acts on it, and whether the frames are the dataset's."""
    column = layout.column(align=True)
    draw_progress(column)
    column.operator(PreviewFrame.bl_idname, icon="IMAGE_DATA")
    if has_depth_steps(panel_of(context.scene)):
        column.operator(PreviewDepth.bl_idname, icon="IMAGE_ZDEPTH")
    if old := outdated(context.scene):
        buttons = " and ".join(BUTTONS[kind] for kind in sorted(old))
        write(layout, context, f"The picture is from before a change: {buttons} renders it anew", "INFO")
    excluded.draw_in_preview(layout, context)


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
