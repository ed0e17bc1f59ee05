# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of the generator on what a scene's panel describes, one at a time, each in a Blender in the background."""

import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import InputError, StorageError
from ..core.presets.preset import EMBEDDED_ROOM, Preset, PresetSpec, SceneSpec, read_preset
from .background_run import BackgroundRun
from .document import preset_of, to_document
from .properties import panel_of

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

    The Blender starts without the user's preferences: other add-ons could change what is rendered, and take their time.
    """
    words = [str(preset), "--out", str(out), *options]
    if bpy.app.binary_path:
        # The packages are found all the same: Blender adds their folder first, and lets it be where no extension is on.
        return [bpy.app.binary_path, "-b", "--factory-startup", "-P", str(generator_script()), "--", *words]
    return [sys.executable, str(generator_script()), *words]


def output_folder(panel: Any) -> Path:
    """Return the dataset's folder. Raises InputError where it cannot be told."""
    text = panel.output_folder.strip()
    if not text:
        raise InputError("Output", "no folder is named", remedy="choose one")
    if text.startswith("//") and not bpy.data.filepath:
        raise InputError("Output", f"{text} is beside this file, which has no place yet", remedy="save it")
    return Path(bpy.path.abspath(text)).resolve()


def start(scene: bpy.types.Scene, *, overwrite: bool = False) -> SceneRun:
    """Start the generator on what a scene's panel describes. Raises NoisyWorldError where that cannot be made."""
    panel = panel_of(scene)
    out = output_folder(panel)
    preset_of(panel)  # what is wrong is told now, not when another Blender has started
    folder = Path(tempfile.mkdtemp(prefix="noisy-world-preset-"))
    try:
        preset = saved_preset(panel) or temporary_preset(panel, folder)
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


def saved_preset(panel: Any) -> Path | None:
    """Return the preset's file where it says what the panel says: with it the command line goes on with the dataset."""
    if not panel.preset_path:
        return None
    path = Path(bpy.path.abspath(panel.preset_path)).resolve()
    try:
        return path if _placed(read_preset(path)) == preset_of(panel).spec else None
    except InputError:  # it was moved or spoilt since
        return None


def _placed(preset: Preset) -> PresetSpec:
    """Return what a preset says with whole paths, as the panel has them."""

    def whole(name: str | None) -> str | None:
        return name if name in (None, EMBEDDED_ROOM) else (preset.path.parent / str(name)).resolve().as_posix()

    def placed(scene: SceneSpec) -> SceneSpec:
        path = scene.trajectory
        return replace(scene, mesh=whole(scene.mesh), trajectory=path and replace(path, file=whole(path.file)))

    return replace(preset.spec, scenes=tuple(placed(scene) for scene in preset.spec.scenes))


def temporary_preset(panel: Any, folder: Path) -> Path:
    """Write what the panel describes into a folder; return the file."""
    path = folder / "noisy_world.yaml"
    # JSON is YAML, and numbers are as they were.
    path.write_text(json.dumps(to_document(panel), indent=1, ensure_ascii=False), encoding="utf-8")
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
    panel = panel_of(scene)
    out = output_folder(panel)
    preset = saved_preset(panel)
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
