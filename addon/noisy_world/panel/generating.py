# SPDX-License-Identifier: GPL-3.0-or-later
"""Generate and Run SLAM: a Blender in the background makes the dataset, and the panel shows its progress."""

import atexit
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import Action, InputError, NoisyWorldError, american, offers
from ..core.file_access import utf8_name
from ..nodes.datablocks import layout_of
from . import drawn_paths, exclusions, loading
from .document import CLEAN, scene_name, setting_name
from .drawn_paths import read_tracked
from .open_scene import output_folder
from .operators import UNDOABLE, OnScene, guarded
from .properties import panel_of
from .runs import (
    BUSY,
    Following,
    SceneRun,
    active_run,
    command_line,
    redraw,
    run_of,
    start,
    start_tracking,
    stop_all,
    summary,
    tracking_of,
)
from .sidebar import write
from .wording import noted, spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

    _Mixin = bpy.types.Operator  # what _AskedGenerate is mixed into
else:
    _Mixin = object


DIALOG_WIDTH = 420  # pixels at a scale of 1; chosen: a sentence in two or three lines


class NoisyWorldGenerate(Following, bpy.types.Operator):
    """Make the dataset that the panel describes, in a Blender in the background; Esc stops it"""

    bl_idname = "noisy_world.generate"
    bl_label = "Generate"
    bl_options = {"REGISTER"}

    overwrite: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Replace Dataset",
        description="Replace the dataset that is in the folder instead of going on with it",
        options={"SKIP_SAVE"},
    )
    asked: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Asked",
        description="Whether the user was told what will not be in the dataset",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether a run may start: only one runs at a time."""
        if context.scene is None:
            return False
        if active_run() is not None:
            cls.poll_message_set(BUSY)
            return False
        panel = panel_of(context.scene)
        if not panel.output.modalities:
            cls.poll_message_set("Nothing is to be written: choose color or depth")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Generate and wait for the end, for scripts, which are told what will not be in the dataset."""
        if not self.started(context):
            return {"CANCELLED"}
        if text := exclusions.sentence(context.scene):
            self.report({"WARNING"}, text)
        self._say()
        return self.waited(context)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Generate while the windows stay usable; ask first where something will not be in the dataset."""
        if not self.asked and exclusions.excluded(context.scene):
            operators().generate_without("INVOKE_DEFAULT", overwrite=self.overwrite)
            return {"CANCELLED"}  # that operator starts this one again
        if not self.started(context):
            return {"CANCELLED"}
        self._say()
        return self.followed(context)

    def _say(self) -> None:
        """Report what was done before the run."""
        if self._run is not None and self._run.said:
            self.report({"INFO"}, american(self._run.said))

    def begin(self, scene: bpy.types.Scene) -> SceneRun:
        """Start the generator."""
        return start(scene, overwrite=self.overwrite)

    def take(self, run: SceneRun) -> str:
        """Say what was made."""
        return f"{run.out}: {run.background.result}"


class _AskedGenerate(_Mixin):
    """Generate after a question, which says what will not be in the dataset."""

    overwrite = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether a run may start."""
        return NoisyWorldGenerate.poll.__func__(cls, context)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_props_dialog(
            self, width=DIALOG_WIDTH, title=self.bl_label, confirm_text="Generate"
        )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the question."""
        if self.overwrite:
            text = "The dataset that is in the folder under Output is deleted and made anew"
            write(layout_of(self), context, text, "TRASH", dialog=DIALOG_WIDTH)
        if text := exclusions.sentence(context.scene):
            write(layout_of(self), context, text, "ERROR", dialog=DIALOG_WIDTH)

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Generate."""
        how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
        try:
            result = operators().generate(how, overwrite=self.overwrite, asked=True)
        except RuntimeError as error:  # Blender raises what the operator reported as an error
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return {"CANCELLED"} if result == {"CANCELLED"} else {"FINISHED"}


class NoisyWorldGenerateWithout(_AskedGenerate, bpy.types.Operator):
    """Make the dataset that the panel describes, without what the scene shows beside it; or of this scene itself"""

    bl_idname = "noisy_world.generate_without"
    bl_label = "What Shall the Dataset Show?"
    bl_options = {"REGISTER"}

    shows: bpy.props.EnumProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Shows",
        description="What the dataset shows",
        items=[
            ("PANEL", "Without These", "What the panel names under Scene, and nothing else of this file"),
            ("SCENE", "This Scene", "This scene as it is set up, through its own camera"),
        ],
        options={"SKIP_SAVE"},
    )

    overwrite: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Replace Dataset", options={"SKIP_SAVE", "HIDDEN"}
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the question."""
        super().draw(context)
        layout_of(self).row().prop(self, "shows", expand=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Generate."""
        if self.shows == "SCENE":
            panel_of(context.scene).mesh_source = "SCENE"
            panel_of(context.scene).trajectory_source = "CAMERA"
        return super().execute(context)


class NoisyWorldGenerateAnew(_AskedGenerate, bpy.types.Operator):
    """Delete the dataset that is in the folder and make the one that the panel describes"""

    bl_idname = "noisy_world.generate_anew"
    bl_label = "Replace Dataset"
    bl_options = {"REGISTER"}
    overwrite = True


class NoisyWorldGenerateCancel(bpy.types.Operator):
    """Stop after the current frame; pressed again, at once. Finished frames stay, and Generate continues from there"""

    bl_idname = "noisy_world.generate_cancel"
    bl_label = "Cancel"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether something runs."""
        return active_run() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop the run."""
        run = active_run()
        if run is None:
            return {"CANCELLED"}
        run.background.cancel()
        redraw(context)
        return {"FINISHED"}


class NoisyWorldCopyCommand(bpy.types.Operator):
    """Copy the command that generates the same without windows, from the saved preset"""

    bl_idname = "noisy_world.copy_command"
    bl_label = "Copy Command"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is a saved preset."""
        if context.scene is None:
            return False
        if not panel_of(context.scene).preset_path:
            cls.poll_message_set("Save the preset first: the command names its file")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Put the command on the clipboard."""

        def work() -> str:
            context.window_manager.clipboard = command_line(context.scene)
            return "Copied the command"

        return guarded(self, work)


class NoisyWorldOpenOutput(bpy.types.Operator):
    """Open the dataset's folder in the file manager"""

    bl_idname = "noisy_world.open_output"
    bl_label = "Open Output Folder"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is one."""
        if context.scene is None:
            return False
        try:
            there = output_folder(panel_of(context.scene)).is_dir()
        except InputError as error:
            cls.poll_message_set(spoken(error.message))
            return False
        if not there:
            cls.poll_message_set("The folder is not there yet: press Generate")
        return there

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        return {*bpy.ops.wm.path_open(filepath=utf8_name(output_folder(panel_of(context.scene))))}


def operators() -> Any:
    """Return the add-on's operators, which the stubs do not know."""
    return bpy.ops.noisy_world  # pyright: ignore[reportAttributeAccessIssue]  those above


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons, and the state of the scene's run."""
    column = layout.column()
    run = active_run()
    if run is None:
        exclusions.draw(column, context)
        row = column.row()
        row.scale_y = 1.4
        row.operator(NoisyWorldGenerate.bl_idname, icon="RENDER_ANIMATION")
    else:
        draw_progress(column, run)
        if run.scene_uid != context.scene.session_uid:
            column.label(text="Another scene's dataset", icon="SCENE_DATA")
    row = column.row(align=True)
    panel = panel_of(context.scene)
    if panel.preset_path:  # what has nothing to act on yet is not there
        row.operator(NoisyWorldCopyCommand.bl_idname, icon="COPYDOWN")
    if is_made(panel):
        row.operator(NoisyWorldOpenOutput.bl_idname, text="Open Folder", icon="FILE_FOLDER")
    own = run_of(context.scene)
    if own is None:
        return
    if not own.background.active:
        icons: dict[str, IconItems] = {"finished": "CHECKMARK", "failed": "ERROR"}
        write(layout, context, summary(own), icons.get(own.background.phase, "INFO"))
        if own.background.phase == "failed" and offers(own.background.error, Action.OVERWRITE):
            layout.operator(NoisyWorldGenerateAnew.bl_idname, icon="TRASH")
    if own.said:
        write(layout, context, own.said[:1].upper() + own.said[1:], "FILE_BLEND")
    for note in own.background.notes:
        write(layout, context, noted(note), "DOT")


def is_made(panel: Any) -> bool:
    """Tell whether the dataset's folder is there."""
    try:
        return output_folder(panel).is_dir()
    except InputError:
        return False


def draw_progress(layout: bpy.types.UILayout, run: SceneRun) -> None:
    """Draw a bar with a button that cancels."""
    row = layout.row(align=True)
    row.progress(factor=run.background.fraction, text=summary(run))
    row.operator(NoisyWorldGenerateCancel.bl_idname, text="", icon="X")


def draw_in_status_bar(header: bpy.types.Header, _: bpy.types.Context) -> None:
    """Draw the bar in the status bar, while something runs."""
    if (run := active_run()) is not None:
        row = layout_of(header).row()
        row.ui_units_x = 16
        draw_progress(row, run)


CLASSES = (
    NoisyWorldGenerate,
    NoisyWorldGenerateWithout,
    NoisyWorldGenerateAnew,
    NoisyWorldGenerateCancel,
    NoisyWorldCopyCommand,
    NoisyWorldOpenOutput,
)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)
DRAWS: Any = draw_in_status_bar  # the stubs give such functions no header
LEAVING = (bpy.app.handlers.load_pre, bpy.app.handlers.exit_pre)


@bpy.app.handlers.persistent
def _leave_file(*_: object) -> None:
    stop_all()


def _leave() -> None:
    """End a run, and take the handlers away: the bpy module calls them when Python has forgotten this module."""
    stop_all()
    for handlers in LEAVING:
        if _leave_file in handlers:  # Python's end has taken it away where Blender's follows
            handlers.remove(_leave_file)


def register() -> None:
    """Register the operators, the part in the status bar, and the handlers that end a run when its file is closed."""
    _register_classes()
    bpy.types.STATUSBAR_HT_header.append(DRAWS)
    for handlers in LEAVING:
        handlers.append(_leave_file)
    atexit.register(_leave)


def unregister() -> None:
    """Unregister all of it, and end a run."""
    _leave()
    atexit.unregister(_leave)
    bpy.types.STATUSBAR_HT_header.remove(DRAWS)
    _unregister_classes()


# Run SLAM: the embedded system on the frames that were generated, and its path drawn beside the true one.


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
        drawn_paths.show(scene, paths)
        return "; ".join(path.sentence for path in paths)


class NoisyWorldTrackRemove(OnScene, bpy.types.Operator):
    """Remove the paths that Run SLAM has drawn"""

    bl_idname = "noisy_world.track_remove"
    bl_label = "Remove Paths"
    bl_options = UNDOABLE

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove them."""
        drawn_paths.remove(context.scene)
        return {"FINISHED"}


def sequences_of(panel: Any, out: Path) -> tuple[str, ...]:
    """Return the names of the panel's sequences that its folder holds: that of the setting, and the clean one.

    Raises InputError where it holds none.
    """
    names = dict.fromkeys(f"{setting}/{scene_name(panel)}" for setting in (setting_name(panel), CLEAN))
    found = tuple(name for name in names if (out / name).is_dir())
    if not found:
        raise InputError(panel.output_folder, "holds no frames of this scene yet", remedy="press Generate")
    return found


def _problem(scene: bpy.types.Scene | None) -> str:
    """Return why nothing can be run; "" where it can."""
    if scene is None or not loading.is_editable(scene):
        return "The scene is linked from another file"
    if active_run() is not None:
        return BUSY
    panel = panel_of(scene)
    if not {"rgb", "depth"} <= panel.output.modalities:
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
    shown = drawn_paths.shown(context.scene)
    if not shown:
        return
    for collection in shown:
        row = layout.row()
        write(row, context, collection[drawn_paths.SENTENCE], "CON_FOLLOWPATH", taken=BUTTON_PX)
        row.prop(collection, "hide_viewport", text="", emboss=False)
    legend = layout.column(align=True)
    legend.scale_y = 0.8
    for part in drawn_paths.parts_of(shown):
        label, icon, _ = drawn_paths.PARTS[part]
        legend.label(text=label, icon=icon)
    layout.operator(NoisyWorldTrackRemove.bl_idname, icon="TRASH")


TRACKING_CLASSES = (NoisyWorldTrack, NoisyWorldTrackRemove)
register_tracking, unregister_tracking = bpy.utils.register_classes_factory(TRACKING_CLASSES)
