# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs on a scene's panel, each in a Blender in the background: generator and tracker, one at a time, and previews."""

import contextlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..core.errors import InputError, NoisyWorldError, StorageError
from ..core.file_access import check_utf8_values, path_in
from ..nodes.datablocks import override
from ..perturbations import registry
from ..perturbations.parsing import parse_settings
from ..perturbations.steps import Setting
from ..preset.keys import Preset, PresetSpec, read_preset
from ..preset.scene_keys import SceneKeys
from ..render.own_stills import COPY, StillRequest, write_request
from ..scenes.polygon_mesh import is_embedded
from ..sources import read_scenes
from ..sources.blender_process import background_command
from ..sources.scene_kinds import SceneEntry
from . import open_scene
from .background import BackgroundRun, BackgroundSeries
from .document import PANEL, preset_of, to_document
from .open_scene import output_folder
from .properties import panel_of
from .source_views import PANEL_SOURCES, shown_as
from .wording import spoken

STOPPED = "Stopped; finished frames stay, and Generate continues from there"
NOT_RENDERED = "Stopped; the picture that was there stays"
NOT_TRACKED = "Stopped; the paths that were drawn before stay"
BUSY = "Something runs in the background already"


@dataclass
class SceneRun:
    """A scene's run, its dataset and its temporary folder, which holds the preset or what the tracker found.

    stopped: what is said when it was stopped. sequences: the names of those that are tracked, SETTING/SCENE.
    preset: the file that the generator was given, which its messages name. said: what was done before, "" for nothing.
    """

    scene_uid: int
    out: Path
    background: BackgroundRun | BackgroundSeries
    folder: Path
    stopped: str = STOPPED
    sequences: tuple[str, ...] = ()
    preset: str = PANEL
    said: str = ""

    def tidy(self) -> None:
        """Remove the temporary folder: the dataset's manifest holds the preset, and the scene the paths."""
        shutil.rmtree(self.folder, ignore_errors=True)


_RUNS: dict[int, SceneRun] = {}  # the last run of the generator of each scene, by the scene's uid in this session
_TRACKED: dict[int, SceneRun] = {}  # and of the tracker
_SHOTS: dict[int, SceneRun] = {}  # and of the generator that takes the scene's shots
_STILLS: dict[int, SceneRun] = {}  # and of the renderer of previewed frames


def generator_script() -> Path:
    """Return the generator: in the installed extension, or in a checkout."""
    return _script("generate.py")


def tracker_script() -> Path:
    """Return the script that runs the embedded SLAM system on a dataset."""
    return _script("run_odometry.py")


def _script(name: str) -> Path:
    package = Path(__file__).resolve().parents[1]
    for folder in (package, package.parents[1]):
        script = folder / "headless" / name
        if script.is_file():
            return script
    raise StorageError("not there", file=package / "headless" / name, remedy="install the extension again")


def generator_command(preset: Path, out: Path, *options: str) -> list[str]:
    """Return the command that makes a preset's dataset."""
    return _command(generator_script(), str(preset), "--out", str(out), *options)


def _command(script: Path, *words: str) -> list[str]:
    """Return the command that runs a script: with this Blender, or with this Python where it is the wheel's.

    That Blender starts without the user's preferences: other add-ons could change what is rendered, and take time.
    """
    if bpy.app.binary_path:
        # The packages are found nevertheless: the scripts add the folder of the extensions' wheels by themselves.
        return [bpy.app.binary_path, "-b", "--factory-startup", "-P", str(script), "--", *words]
    return [sys.executable, str(script), *words]


@contextmanager
def starting(what: str, who: str) -> Iterator[Path]:
    """Give a new temporary folder to start a program with, and remove it where that fails. Raises StorageError then."""
    folder = Path(tempfile.mkdtemp(prefix=f"noisy-world-{what}-"))
    try:
        yield folder
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):
            raise StorageError(f"{who} cannot be started: {error}") from error
        raise


def start(scene: bpy.types.Scene, *, overwrite: bool = False) -> SceneRun:
    """Start the generator on a scene's panel. Raises NoisyWorldError where its dataset cannot be made."""
    panel = panel_of(scene)
    out = output_folder(panel)
    said = ""
    if open_scene.is_shown(panel):
        open_scene.check(scene)
        said = open_scene.ensure(scene)
    preset_of(panel)  # raises at once what would otherwise be reported only by the started Blender
    with starting("preset", "the generator") as folder:
        preset = saved_preset(panel) or temporary_preset(to_document(panel), folder)
        options = ("--progress", "json", *(["--overwrite"] if overwrite else []))
        background = BackgroundRun(generator_command(preset, out, *options))
    run = _RUNS[scene.session_uid] = SceneRun(scene.session_uid, out, background, folder, preset=str(preset), said=said)
    return run


def keep_shots(run: SceneRun) -> None:
    """Let this be the last run of its scene's shots."""
    _SHOTS[run.scene_uid] = run


def start_tracking(scene: bpy.types.Scene, out: Path, sequences: tuple[str, ...]) -> SceneRun:
    """Start the embedded SLAM system on sequences of a dataset. Raises NoisyWorldError where it cannot be started."""
    words = [word for name in sequences for word in ("--only", name)]
    with starting("paths", "the tracker") as folder:
        command = _command(tracker_script(), str(out), str(folder), *words, "--progress", "json")
        background = BackgroundRun(command, who="the tracker")
    run = SceneRun(scene.session_uid, out, background, folder, NOT_TRACKED, sequences)
    _TRACKED[scene.session_uid] = run
    return run


def start_still(scene: bpy.types.Scene, request: StillRequest, *, stopped: str = NOT_RENDERED) -> SceneRun:
    """Start rendering frames of a copy of the open file. stopped: what is said when it was stopped.

    Raises NoisyWorldError where that cannot be.
    """
    with starting("frame", "the renderer") as folder:
        open_scene.save_as_it_is(folder / COPY)
        write_request(request, folder)
        command = background_command("noisy_world.render.own_stills", str(folder))
        background = BackgroundRun(command, who="the renderer", patient=False)
    run = _STILLS[scene.session_uid] = SceneRun(scene.session_uid, folder, background, folder, stopped)
    return run


def saved_preset(panel: Any) -> Path | None:
    """Return the preset's file if its content is the panel's, so that the command line can continue the dataset."""
    if not panel.preset_path:
        return None
    path = Path(bpy.path.abspath(panel.preset_path)).resolve()
    try:
        return path if _placed(read_preset(path)) == _placed(preset_of(panel)) else None
    except InputError:  # the file was moved or damaged since
        return None


def _placed(preset: Preset) -> tuple[PresetSpec, list[SceneKeys], tuple[Setting, ...]]:
    """Return a preset's content with absolute paths and the camera written out, as the panel has them."""
    found = []
    entries = read_scenes(preset)
    for entry in entries:

        def whole(text: Any, key: str, entry: SceneEntry[Any] = entry) -> Any:
            name = getattr(text, "SHORTHAND", "")  # of a dataclass, whose file or folder a bare text is
            if name:
                return replace(text, **{name: whole(getattr(text, name), key)})
            if text is None or is_embedded(text):
                return text
            return path_in(preset.folder, text, entry.place.at(key)).resolve().as_posix()

        files = (*PANEL_SOURCES[shown_as(entry)].files, "trajectory")
        given = {key: whole(value, key) for key in files if (value := getattr(entry.keys, key, None)) is not None}
        found.append(replace(entry.keys, **given))
    own = any(PANEL_SOURCES[shown_as(entry)].own_lens for entry in entries)
    camera = preset.spec.camera if own else preset.spec.mesh_camera
    settings = parse_settings(preset.spec.settings, preset.setting_places, registry(), preset.spec.render.backend)
    return replace(preset.spec, scenes=(), settings=(), camera=camera, data=None), found, settings


def temporary_preset(document: dict[str, Any], folder: Path, name: str = "noisy_world") -> Path:
    """Write a preset's document into a folder; return the file. Raises InputError for a name that is not UTF-8."""
    path = folder / f"{name}.yaml"
    # JSON is YAML, and keeps numbers exactly.
    check_utf8_values(document, PANEL)
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False), encoding="utf-8")
    return path


def run_of(scene: bpy.types.Scene) -> SceneRun | None:
    """Return a scene's last run of the generator."""
    return _RUNS.get(scene.session_uid)


def shots_of(scene: bpy.types.Scene) -> SceneRun | None:
    """Return the last run of a scene's shots."""
    return _SHOTS.get(scene.session_uid)


def tracking_of(scene: bpy.types.Scene) -> SceneRun | None:
    """Return a scene's last run of the tracker."""
    return _TRACKED.get(scene.session_uid)


def active_run() -> SceneRun | None:
    """Return the active run; there is at most one."""
    return next((run for run in (*_RUNS.values(), *_TRACKED.values(), *_SHOTS.values()) if run.background.active), None)


def active_still() -> SceneRun | None:
    """Return the frame that is being rendered for a preview; there is at most one, beside what else runs."""
    return next((run for run in _STILLS.values() if run.background.active), None)


def stop_all(*_: object) -> None:
    """End all that runs, as the file or Blender is about to close."""
    for runs in (_RUNS, _TRACKED, _SHOTS, _STILLS):
        for run in runs.values():
            run.background.close()
            run.tidy()
        runs.clear()


def command_line(scene: bpy.types.Scene) -> str:
    """Return the command that generates the same dataset without windows, to paste into a shell.

    Raises InputError where no preset's file has the panel's content.
    """
    panel = panel_of(scene)
    out = output_folder(panel)
    preset = saved_preset(panel)
    if preset is None:
        raise InputError("Preset", "no file says what the panel says", remedy="save the preset first")
    words = generator_command(preset, out)
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def summary(run: SceneRun) -> str:
    """Return a run's state in a few words."""
    state = run.background
    rate = f", {state.frames_per_s:.2f} frames/s" if state.frames_per_s else ""
    match state.phase:
        case "starting" | "running" | "stopping":
            counted = state.where + (f"{state.done} of {state.total} frames{rate}" if state.total else "starting")
            return f"Stopping, {counted}" if state.phase == "stopping" else counted[:1].upper() + counted[1:]
        case "finished":
            return state.result[:1].upper() + state.result[1:]
        case "stopped":
            return run.stopped
        case _:
            return spoken(state.error, run.preset)


# An operator that starts a run in the background and follows it while the windows stay usable.


if TYPE_CHECKING:
    _Mixin = bpy.types.Operator  # what Following is mixed into
else:
    _Mixin = object

LOOK_EVERY_S = 0.2  # between polls of the run; chosen: smooth for a progress bar, and cheap


class Following(_Mixin):
    """Start a run and follow it to its end: what an operator gives says which run, and what becomes of its result.

    No abstract base class: Blender's operators have a metaclass of their own.
    """

    _timer: bpy.types.Timer | None = None
    _run: SceneRun | None = None

    def begin(self, scene: bpy.types.Scene) -> SceneRun:
        """Start the run. Raises NoisyWorldError where that cannot be."""
        raise NotImplementedError

    def take(self, run: SceneRun) -> str:
        """Take the result of a run that has finished; return a sentence on it. Raises NoisyWorldError."""
        raise NotImplementedError

    def started(self, context: bpy.types.Context) -> bool:
        """Start the run; tell whether that went well."""
        try:
            self._run = self.begin(context.scene)
        except NoisyWorldError as error:
            self.report({"ERROR"}, spoken(error.message))
            return False
        return True

    def waited(self, context: bpy.types.Context) -> set[str]:
        """Wait for the end of the run, for scripts."""
        assert self._run is not None
        self._run.background.wait()
        return self._conclude(context)

    def followed(self, context: bpy.types.Context) -> set[str]:
        """Let the window stay usable while the run goes on."""
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
        """End the run when the window that it was started from closes."""
        if self._run is not None:
            self._run.background.close()
            self._leave(context)

    def _conclude(self, context: bpy.types.Context) -> set[str]:
        assert self._run is not None
        state = self._run.background
        try:
            if state.phase == "failed":
                self.report({"ERROR"}, spoken(state.error, self._run.preset))
                return {"CANCELLED"}
            if state.phase == "stopped":
                self.report({"WARNING"}, self._run.stopped)
                return {"CANCELLED"}
            self.report({"INFO"}, self.take(self._run))
        except NoisyWorldError as error:
            self.report({"ERROR"}, spoken(error.message))
            return {"CANCELLED"}
        finally:
            self._leave(context)
        return {"FINISHED"}

    def _leave(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._run is not None:
            self._run.tidy()
        redraw(context)


def redraw(context: bpy.types.Context) -> None:
    """Redraw panels and status bar."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
        with contextlib.suppress(TypeError, RuntimeError), override(window=window):
            window.workspace.status_text_set_internal(None)  # what has the status bar drawn
