# SPDX-License-Identifier: GPL-3.0-or-later
"""Generate: a Blender in the background makes what the panel describes, and the panel follows it."""

import contextlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import InputError, NoisyWorldError, StorageError
from ..core.preset import read_preset
from .background_run import BackgroundRun
from .document import preset_of, to_document
from .preview import write

LOOK_EVERY_S = 0.2
STOPPED = "Stopped; what is finished stays, and Generate goes on from there"


@dataclass
class SceneRun:
    """A scene's run, its dataset and the temporary folder of its preset."""

    scene_uid: int
    out: Path
    background: BackgroundRun
    folder: Path

    def tidy(self) -> None:
        """Remove the temporary preset: the dataset's manifest holds it."""
        shutil.rmtree(self.folder, ignore_errors=True)


_RUNS: dict[int, SceneRun] = {}  # the last run of each scene, by the scene's uid in this session


# --- without windows ---


def generator_script() -> Path:
    """Return the generator: in the installed extension, or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package, package.parents[1]):
        script = folder / "headless" / "generate.py"
        if script.is_file():
            return script
    raise StorageError(f"{package / 'headless' / 'generate.py'}: not there; install the extension again")


def generator_command(preset: Path, out: Path, *options: str) -> list[str]:
    """Return the command that makes a preset's dataset: with this Blender, or with this Python where it is the wheel's.

    The Blender starts with the user's preferences, because the extension's packages come with them.
    """
    words = [str(preset), "--out", str(out), *options]
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", "-P", str(generator_script()), "--", *words]
    return [sys.executable, str(generator_script()), *words]


def output_folder(settings: Any) -> Path:
    """Return the dataset's folder. Raises InputError where it cannot be told."""
    text = settings.output_folder.strip()
    if not text:
        raise InputError("Output", "no folder is named", remedy="choose one")
    if text.startswith("//") and not bpy.data.filepath:
        raise InputError("Output", f"{text} is beside this file, which has no place yet", remedy="save it")
    return Path(bpy.path.abspath(text)).resolve()


def start(scene: bpy.types.Scene, *, overwrite: bool = False) -> SceneRun:
    """Start the generator on what a scene's panel describes. Raises NoisyWorldError where that cannot be made."""
    settings = scene.noisy_world
    out = output_folder(settings)
    preset_of(settings)  # what is wrong is told now, not when another Blender has started
    folder = Path(tempfile.mkdtemp(prefix="noisy-world-preset-"))
    try:
        preset = saved_preset(settings) or temporary_preset(settings, folder)
        options = ("--progress", "json", *(["--overwrite"] if overwrite else []))
        background = BackgroundRun(generator_command(preset, out, *options))
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise StorageError(f"the generator cannot be started: {error}") from error
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    run = _RUNS[scene.session_uid] = SceneRun(scene.session_uid, out, background, folder)
    return run


def saved_preset(settings: Any) -> Path | None:
    """Return the preset's file where it says what the panel says: with it the command line goes on with the dataset."""
    if not settings.preset_path:
        return None
    path = Path(bpy.path.abspath(settings.preset_path)).resolve()
    try:
        return path if read_preset(path).spec == preset_of(settings, path).spec else None
    except InputError:  # it was moved or spoilt since
        return None


def temporary_preset(settings: Any, folder: Path) -> Path:
    """Write what the panel describes into a folder; return the file."""
    path = folder / "noisy_world.yaml"
    # JSON is YAML, and numbers are as they were.
    path.write_text(json.dumps(to_document(settings), indent=1, ensure_ascii=False), encoding="utf-8")
    return path


def run_of(scene: bpy.types.Scene) -> SceneRun | None:
    """Return a scene's last run."""
    return _RUNS.get(scene.session_uid)


def active_run() -> SceneRun | None:
    """Return the run that is at work; there is one at most."""
    return next((run for run in _RUNS.values() if run.background.active), None)


def stop_all(*_: object) -> None:
    """End what runs, for good: the file or Blender goes."""
    for run in _RUNS.values():
        run.background.close()
        run.tidy()
    _RUNS.clear()


def command_line(scene: bpy.types.Scene) -> str:
    """Return the command that generates the same without windows, to be pasted into a shell.

    Raises InputError where no preset's file says what the panel says.
    """
    settings = scene.noisy_world
    out = output_folder(settings)
    preset = saved_preset(settings)
    if preset is None:
        raise InputError("Preset", "no file says what the panel says", remedy="save the preset first")
    words = generator_command(preset, out)
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def summary(run: SceneRun) -> str:
    """Say how a run stands, in a few words."""
    state = run.background
    rate = f", {state.frames_per_s:.2f} frames/s" if state.frames_per_s else ""
    match state.phase:
        case "starting":
            return "Starting"
        case "running" | "stopping":
            counted = f"{state.done} of {state.total} frames{rate}" if state.total else "Starting"
            return f"Stopping, {counted}" if state.phase == "stopping" else counted
        case "finished":
            return state.result[:1].upper() + state.result[1:]
        case "stopped":
            return STOPPED
        case _:
            return state.error


# --- windows ---


class NoisyWorldGenerate(bpy.types.Operator):
    """Make the dataset that the panel describes, in a Blender in the background; Esc stops it"""

    bl_idname = "noisy_world.generate"
    bl_label = "Generate"
    bl_options = {"REGISTER"}

    overwrite: bpy.props.BoolProperty(
        name="Replace Dataset",
        description="Replace the dataset that is in the folder instead of going on with it",
        options={"SKIP_SAVE"},
    )

    _timer: bpy.types.Timer | None = None
    _run: SceneRun | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether a run may start: one at a time."""
        if context.scene is None:
            return False
        if active_run() is not None:
            cls.poll_message_set("A dataset is being generated already")
            return False
        settings = context.scene.noisy_world
        if not (settings.use_rgb or settings.use_depth):
            cls.poll_message_set("Neither colour nor depth is to be written")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Generate and wait for it, for scripts."""
        if not self._start(context):
            return {"CANCELLED"}
        assert self._run is not None
        self._run.background.wait()
        return self._conclude(context)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Generate while the windows stay usable."""
        if not self._start(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(LOOK_EVERY_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the run."""
        assert self._run is not None
        playing = context.screen is not None and context.screen.is_animation_playing
        if event.type == "ESC" and event.value == "PRESS" and not playing:
            self._run.background.cancel()
            redraw(context)
            return {"RUNNING_MODAL"}
        if event.type == "TIMER" and self._run.background.poll():
            redraw(context)
        if not self._run.background.active:
            return self._conclude(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """End the run with the window that it was started from."""
        if self._run is not None:
            self._run.background.close()
            self._leave(context)

    def _start(self, context: bpy.types.Context) -> bool:
        try:
            self._run = start(context.scene, overwrite=self.overwrite)
        except NoisyWorldError as error:
            self.report({"ERROR"}, str(error))
            return False
        return True

    def _conclude(self, context: bpy.types.Context) -> set[str]:
        assert self._run is not None
        self._leave(context)
        state = self._run.background
        if state.phase == "failed":
            self.report({"ERROR"}, state.error)
            return {"CANCELLED"}
        if state.phase == "stopped":
            self.report({"WARNING"}, STOPPED)
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self._run.out}: {state.result}")
        return {"FINISHED"}

    def _leave(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._run is not None:
            self._run.tidy()
        redraw(context)


class NoisyWorldGenerateAnew(bpy.types.Operator):
    """Delete the dataset that is in the folder and make the one that the panel describes"""

    bl_idname = "noisy_world.generate_anew"
    bl_label = "Replace Dataset"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether a run may start."""
        return NoisyWorldGenerate.poll.__func__(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Generate over what is there."""
        how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
        try:
            result = bpy.ops.noisy_world.generate(how, overwrite=True)
        except RuntimeError as error:  # how Blender passes on what the operator reported
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return {"CANCELLED"} if result == {"CANCELLED"} else {"FINISHED"}


class NoisyWorldGenerateCancel(bpy.types.Operator):
    """Stop after the frame in hand; pressed again, at once. What is finished stays, and Generate goes on from there"""

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
        if not context.scene.noisy_world.preset_path:
            cls.poll_message_set("Save the preset first: the command names its file")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Put the command on the clipboard."""
        try:
            command = command_line(context.scene)
        except NoisyWorldError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.window_manager.clipboard = command
        self.report({"INFO"}, "Copied the command")
        return {"FINISHED"}


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons, and how the scene's run stands."""
    column = layout.column()
    run = active_run()
    if run is None:
        row = column.row()
        row.scale_y = 1.4
        row.operator(NoisyWorldGenerate.bl_idname, icon="RENDER_ANIMATION")
    else:
        draw_progress(column, run)
        if run.scene_uid != context.scene.session_uid:
            column.label(text="Another scene's dataset", icon="SCENE_DATA")
    column.operator(NoisyWorldCopyCommand.bl_idname, icon="COPYDOWN")
    own = run_of(context.scene)
    if own is None:
        return
    if not own.background.active:
        icon = {"finished": "CHECKMARK", "failed": "ERROR"}.get(own.background.phase, "INFO")
        write(layout, context, summary(own), icon)
        if own.background.phase == "failed" and "--overwrite" in own.background.error:
            layout.operator(NoisyWorldGenerateAnew.bl_idname, icon="TRASH")
    for note in own.background.notes:
        write(layout, context, note[:1].upper() + note[1:], "DOT")


def draw_progress(layout: bpy.types.UILayout, run: SceneRun) -> None:
    """Draw a bar with a button that cancels."""
    row = layout.row(align=True)
    row.progress(factor=run.background.fraction, text=summary(run))
    row.operator(NoisyWorldGenerateCancel.bl_idname, text="", icon="X")


def draw_in_status_bar(header: bpy.types.Header, _: bpy.types.Context) -> None:
    """Draw the bar in the status bar, while something runs."""
    if (run := active_run()) is not None:
        row = header.layout.row()
        row.ui_units_x = 16
        draw_progress(row, run)


def redraw(context: bpy.types.Context) -> None:
    """Have panels and status bar drawn anew."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
        with contextlib.suppress(TypeError, RuntimeError), context.temp_override(window=window):
            window.workspace.status_text_set_internal(None)  # what has the status bar drawn


CLASSES = (NoisyWorldGenerate, NoisyWorldGenerateAnew, NoisyWorldGenerateCancel, NoisyWorldCopyCommand)
LEAVING = (bpy.app.handlers.load_pre, bpy.app.handlers.exit_pre)


@bpy.app.handlers.persistent
def _leave_file(*_: object) -> None:
    stop_all()


def register() -> None:
    """Register the operators, the status bar's part and what ends a run with its file."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.STATUSBAR_HT_header.append(draw_in_status_bar)
    for handlers in LEAVING:
        handlers.append(_leave_file)


def unregister() -> None:
    """Take all of it back; a run ends."""
    stop_all()
    for handlers in LEAVING:
        handlers.remove(_leave_file)
    bpy.types.STATUSBAR_HT_header.remove(draw_in_status_bar)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
