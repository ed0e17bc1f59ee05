# SPDX-License-Identifier: GPL-3.0-or-later
"""Run SLAM: the embedded system on the frames that were generated, and its path drawn beside the true one."""

from pathlib import Path
from typing import Any

import bpy

from ..core.errors import InputError, NoisyWorldError
from . import drawn_tracks, world
from .document import CLEAN
from .following import Following
from .generate import draw_progress
from .long_text import write
from .operators import UNDOABLE, OnScene
from .output_place import output_folder
from .properties import panel_of
from .runs import BUSY, SceneRun, active_run, start_tracking, summary, tracking_of
from .tracked import read_tracked
from .wording import noted, spoken

BUTTON_PX = 24  # of a button that is a symbol, beside a text


class NoisyWorldTrack(Following, bpy.types.Operator):
    """Run the embedded SLAM system on the generated frames, and draw its path beside the true one; Esc stops it"""

    bl_idname = "noisy_world.track"
    bl_label = "Run SLAM"
    bl_options = UNDOABLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is something to run it on."""
        if problem := _problem(context.scene):
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run it and wait for the end, for scripts."""
        return self.waited(context) if self.started(context) else {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Run it while the windows stay usable."""
        return self.followed(context) if self.started(context) else {"CANCELLED"}

    def begin(self, scene: bpy.types.Scene) -> SceneRun:
        """Start it."""
        out = output_folder(panel_of(scene))
        return start_tracking(scene, out, sequences_of(panel_of(scene), out))

    def take(self, run: SceneRun) -> str:
        """Draw the paths."""
        scene = next((item for item in bpy.data.scenes if item.session_uid == run.scene_uid), None)
        if scene is None:
            raise NoisyWorldError("the scene that the paths belong to is gone")
        paths = [read_tracked(run.out, run.folder, name) for name in run.sequences]
        drawn_tracks.show(scene, paths)
        return "; ".join(path.sentence for path in paths)


class NoisyWorldTrackRemove(OnScene, bpy.types.Operator):
    """Remove the paths that Run SLAM has drawn"""

    bl_idname = "noisy_world.track_remove"
    bl_label = "Remove Paths"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove them."""
        drawn_tracks.remove(context.scene)
        return {"FINISHED"}


def sequences_of(panel: Any, out: Path) -> tuple[str, ...]:
    """Return the names of the panel's sequences that its folder holds: that of the setting, and the clean one.

    Raises InputError where it holds none.
    """
    names = dict.fromkeys(f"{setting}/{panel.scene_name}" for setting in (panel.setting_name, CLEAN))
    found = tuple(name for name in names if (out / name).is_dir())
    if not found:
        raise InputError(panel.output_folder, "holds no frames of this scene yet", remedy="press Generate")
    return found


def _problem(scene: bpy.types.Scene | None) -> str:
    """Return why nothing can be run; "" where it can."""
    if scene is None or not world.is_editable(scene):
        return "The scene is linked from another file"
    if active_run() is not None:
        return BUSY
    panel = panel_of(scene)
    if not (panel.use_rgb and panel.use_depth):
        return "The embedded system needs color and depth"
    try:
        sequences_of(panel, output_folder(panel))
    except InputError as error:
        return spoken(error.message)
    return ""


def draw_tracking(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button, and what came of the last run."""
    scene, run = context.scene, tracking_of(context.scene)
    column = layout.column()
    if run is not None and run.background.active:
        draw_progress(column, run)
    else:
        column.operator(NoisyWorldTrack.bl_idname, icon="TRACKING")
        if not active_run() and (problem := _problem(scene)):
            write(layout, context, problem, "INFO")
        if run is not None and run.background.phase in ("failed", "stopped"):
            write(layout, context, summary(run), "ERROR" if run.background.phase == "failed" else "INFO")
    for note in run.background.notes if run is not None else ():
        write(layout, context, noted(note), "DOT")
    _draw_shown(layout, context)


def _draw_shown(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a line for each sequence whose paths the scene holds, with what hides them, and a legend."""
    shown = drawn_tracks.shown(context.scene)
    if not shown:
        return
    for collection in shown:
        row = layout.row()
        write(row, context, collection[drawn_tracks.SENTENCE], "CON_FOLLOWPATH", taken=BUTTON_PX)
        row.prop(collection, "hide_viewport", text="", emboss=False)
    legend = layout.column(align=True)
    legend.scale_y = 0.8
    for part in drawn_tracks.parts_of(shown):
        label, icon, _ = drawn_tracks.PARTS[part]
        legend.label(text=label, icon=icon)
    layout.operator(NoisyWorldTrackRemove.bl_idname, icon="TRASH")


TRACKING_CLASSES = (NoisyWorldTrack, NoisyWorldTrackRemove)
register_tracking, unregister_tracking = bpy.utils.register_classes_factory(TRACKING_CLASSES)
