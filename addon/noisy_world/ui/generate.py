# SPDX-License-Identifier: GPL-3.0-or-later
"""Generate: a Blender in the background makes the dataset that the panel describes; the panel shows its progress."""

import atexit
from typing import TYPE_CHECKING, Any

import bpy

from ..blender.typed import layout_of
from ..core.channels import CHANNELS
from ..core.errors import InputError
from ..core.labels import american
from ..core.messages import Action, offers
from ..core.utf8_names import utf8_name
from . import excluded
from .following import Following, redraw
from .long_text import write
from .operators import guarded
from .output_place import output_folder
from .properties import panel_of
from .runs import BUSY, SceneRun, active_run, command_line, run_of, start, stop_all, summary
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
        if not any(getattr(panel, f"use_{name}") for name in CHANNELS):
            cls.poll_message_set("Nothing is to be written: choose color or depth")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Generate and wait for the end, for scripts, which are told what will not be in the dataset."""
        if not self.started(context):
            return {"CANCELLED"}
        if text := excluded.sentence(context.scene):
            self.report({"WARNING"}, text)
        self._say()
        return self.waited(context)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Generate while the windows stay usable; ask first where something will not be in the dataset."""
        if not self.asked and excluded.excluded(context.scene):
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
        if text := excluded.sentence(context.scene):
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
        excluded.draw(column, context)
        row = column.row()
        row.scale_y = 1.4
        row.operator(NoisyWorldGenerate.bl_idname, icon="RENDER_ANIMATION")
    else:
        draw_progress(column, run)
        if run.scene_uid != context.scene.session_uid:
            column.label(text="Another scene's dataset", icon="SCENE_DATA")
    column.operator(NoisyWorldOpenOutput.bl_idname, icon="FILE_FOLDER")
    column.operator(NoisyWorldCopyCommand.bl_idname, icon="COPYDOWN")
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
