# SPDX-License-Identifier: GPL-3.0-or-later
"""Applies a preset to the panel: all of it, or the part that a section shows."""

from pathlib import Path
from typing import Any, Literal, TypeAlias

import bpy

from ..core.channels import CHANNELS
from ..core.errors import InputError
from ..core.home import path_in
from ..core.perturbing.reading import parse_settings
from ..core.perturbing.steps import Setting, Step
from ..core.presets.preset import Preset, read_preset
from ..core.presets.selection import OnlySpec
from ..core.schema import unknown_name
from ..perturbations import registry
from ..sources import read_scenes
from . import footage
from .described import LARGEST_INT, is_offered, notify_once, tell
from .document import CAMERA, CLEAN, DEVIATION, HANDHELD, NO_BODY, OWN_FIELDS, TRAJECTORY, own_motion
from .imu_fields import take_rig, unshown_rig
from .lens_fields import take_distortion
from .shown_sources import PANEL_SOURCES, shown, shown_as
from .step_list import clear_entries, put_step, take_step
from .typed_numbers import set_value

Part: TypeAlias = Literal["SCENE", "PATH", "CAMERA", "OUTPUT"]
"""What a section of the panel shows, beside the perturbations."""


def open_preset(panel: Any, path: Path, setting: str = "") -> None:
    """Load a preset's file into the panel: its scene and one of its settings, by default the first that is not clean.

    Raises InputError where it cannot be read, or has content that the panel cannot show; the panel is then unchanged.
    """
    _apply(panel, read_preset(path), setting)
    panel.preset_path = str(path)


def add_perturbations(panel: Any, path: Path, setting: str = "") -> tuple[list[Step], list[Step]]:
    """Put the perturbations of one of a preset's settings into the panel, and change nothing else in it.

    One that is in the panel already is set as the preset has it; the others are added. setting: by default the first
    that is not clean. Returns those that were added, and those that were set. Raises InputError where the file cannot
    be read or its perturbations cannot be shown; the panel is then unchanged.
    """
    _, chosen = _settings_of(read_preset(path), setting)
    added: list[Step] = []
    changed: list[Step] = []
    with notify_once():
        for step in chosen.steps:
            if step.perturbation.name in OWN_FIELDS:
                before = own_motion(panel)
                _apply_own_motion(panel, step)
                was_there = any(step.perturbation.name in item for item in before)
            else:
                was_there = put_step(panel, step)
            (changed if was_there else added).append(step)
        tell("steps")(panel, bpy.context)
    return added, changed


def apply_part(panel: Any, path: Path, part: Part) -> None:
    """Set one section of the panel from a preset, and change nothing else.

    Raises InputError where the file cannot be read, or the panel cannot show that part; it is then unchanged.
    """
    preset = read_preset(path)
    _refuse_unshown(preset, part)
    with notify_once():
        if part == "SCENE":
            _apply_mesh(panel, preset)
        elif part == "PATH":
            _apply_path(panel, preset)
        elif part == "CAMERA":
            _apply_camera(panel, preset)
        else:
            _apply_output(panel, preset)
            panel.backend = preset.spec.render.backend


def can_apply(path: Path, part: Part) -> bool:
    """Tell whether the panel can take a part of a preset."""
    try:
        _refuse_unshown(read_preset(path), part)
    except InputError:
        return False
    return True


def _apply(panel: Any, preset: Preset, wanted: str) -> None:
    _refuse_unshown(preset)
    found, chosen = _settings_of(preset, wanted)
    if chosen.stream != chosen.name:
        problem = f"{chosen.name}: draws by the stream {chosen.stream}: the panel cannot show that"
        raise preset.place("settings").error(problem, "run it with generate.py")
    with notify_once():
        _apply_mesh(panel, preset)
        _apply_path(panel, preset)
        _apply_camera(panel, preset)
        _apply_output(panel, preset)
        panel.seed, panel.backend = preset.spec.seed, chosen.backend
        take_rig(panel, preset.spec.rig)
        if chosen.name != CLEAN:
            panel.setting_name = chosen.name
        _apply_steps(panel, chosen)
        panel.use_clean = any(item.name == CLEAN for item in found)
        panel.preset_settings = "\n".join(item.name for item in found)


def setting_of(preset: Preset, wanted: str) -> Setting:
    """Return the setting of a preset that is wanted: "" is the first that is not clean.

    Raises InputError where there is none of this name, or the panel cannot show it.
    """
    return _settings_of(preset, wanted)[1]


def show_setting(panel: Any, setting: Setting) -> None:
    """Let the panel's perturbations be those of a setting, in place of what it holds."""
    with notify_once():
        panel.backend = setting.backend
        if setting.name != CLEAN:
            panel.setting_name = setting.name
        _apply_steps(panel, setting)


def _settings_of(preset: Preset, wanted: str) -> tuple[tuple[Setting, ...], Setting]:
    """Return a preset's settings, and that which is wanted: "" is the first that is not clean."""
    place = preset.place("settings")
    found = parse_settings(preset.spec.settings, preset.setting_places, registry(), preset.spec.render.backend)
    chosen = next((item for item in found if item.name == wanted or (not wanted and item.steps)), None)
    if chosen is None and wanted:
        raise unknown_name(place, "setting", wanted, [item.name for item in found])
    chosen = chosen or found[0]
    for step in chosen.steps:
        if step.levels is not None and step.severity is None and not step.keyed:
            raise place.error(f"{chosen.name}: levels cannot be shown in the panel", "use severity")
    return found, chosen


def _refuse_unshown(preset: Preset, part: Part | None = None) -> None:
    """Refuse content that the panel cannot show, as it would be lost when the preset is saved again.

    part: what is looked at; by default everything.
    """
    spec, (entry, *others) = preset.spec, read_scenes(preset)
    source, path = PANEL_SOURCES.get(shown_as(entry)), getattr(entry.keys, "trajectory", None)
    handheld = None if path is None else path.handheld
    asked: dict[str, Any] = {}
    if part in (None, "SCENE", "PATH"):
        lacking = {entry.kind.name: "is a source that the panel has no fields for"}
        unshown = lacking if source is None else source.unshown(entry, path=part == "PATH")
        asked = {
            "scenes": others and f"holds {len(others) + 1} scenes, and the panel shows one",
            **{f"scenes.0.{key}": problem for key, problem in unshown.items()},
        }
    if part in (None, "PATH") and path is not None:
        asked |= {
            "scenes.0.trajectory.start": path.start != 0 and "chooses a part of the path",
            "scenes.0.trajectory.stop": path.stop is not None and "chooses a part",
            "scenes.0.trajectory.resample_hz": path.resample_hz is not None and "resamples the path",
            "scenes.0.trajectory.handheld.seed": handheld is not None
            and handheld.seed is not None
            and "is another seed than the preset's",
            "scenes.0.trajectory.handheld.revisit": handheld is not None and handheld.revisit and "is true",
            "scenes.0.trajectory.handheld.wander_m": handheld is not None
            and handheld.wander_m > 0.0
            and "is more than 0",
        }
    if part in (None, "OUTPUT"):
        asked |= {
            "render.engine": not is_offered(spec.render.engine)
            and f"is {spec.render.engine}, which needs the Python package embreex in Blender",
            "render.device": spec.render.device != "cpu" and f"is {spec.render.device}",
            "output.formats": bool(spec.output.format.formats) and "says what files of channels are",
            "output.licence": spec.output.licence is not None and "states a licence",
            "render.allow_empty": spec.render.allow_empty and "is true",
            "render.processors": spec.render.processors != "same" and f"is {spec.render.processors}",
        }
    if part is None:
        asked |= {
            "only": spec.only != OnlySpec() and "chooses a part of the scenes or settings",
            **unshown_rig(spec.rig),
            "seed": spec.seed > LARGEST_INT and f"is {spec.seed}, and the panel counts to {LARGEST_INT}",
        }
    for key, problem in asked.items():
        if problem:
            raise preset.place(key).error(f"{problem}: the panel cannot show that", "run it with generate.py")


def _apply_mesh(panel: Any, preset: Preset) -> None:
    (entry,) = read_scenes(preset)
    panel.mesh_source = shown_as(entry)
    unnamed = shown(panel).take(panel, entry)
    panel.scene_name = entry.keys.name or unnamed


def _apply_path(panel: Any, preset: Preset) -> None:
    (entry,) = read_scenes(preset)
    if footage.is_shown(panel):
        return
    path = getattr(entry.keys, "trajectory", None)
    if path is None:
        panel.trajectory_source = "CAMERA"
        chosen = getattr(entry.keys, "frame_range", None)
        panel.every = max(1, (1 if chosen is None else chosen.step) // panel.id_data.frame_step)
        return
    handheld = path.handheld
    panel.trajectory_source = "FILE" if handheld is None else "HANDHELD"
    if handheld is None:
        assert path.file is not None
        file = path_in(preset.folder, path.file, entry.place.at("trajectory"))
        panel.trajectory_path = str(file)
        for name, field in TRAJECTORY.items():
            set_value(panel, name, getattr(path, field))
    else:
        for name, field in HANDHELD.items():
            set_value(panel, name, getattr(handheld, field))
    panel.body = NO_BODY if path.body is None else path.body.kind
    if path.body is not None:
        set_value(panel, "body_motion", path.body.motion)
    panel.every = path.every


def _apply_camera(panel: Any, preset: Preset) -> None:
    panel.lens_source = "SCENE" if preset.spec.camera is None else "GIVEN"
    panel.recorded_camera = "RECORDED" if preset.spec.camera is None else "GIVEN"
    source = shown(panel)
    if source.distorts and not source.own_distortion:
        take_distortion(panel, preset.spec.mesh_camera.distortion)
    if preset.spec.camera is None and source.lens_field:
        return
    for name, field in CAMERA.items():
        set_value(panel, name, getattr(preset.spec.mesh_camera, field))


def _apply_output(panel: Any, preset: Preset) -> None:
    spec = preset.spec
    given = preset.document.get("render") or {}
    panel.render_source = "GIVEN" if {"engine", "samples"} & set(given) else "SCENE"
    panel.engine, panel.samples = spec.render.engine, spec.render.samples
    output = spec.output.format
    panel.layout = output.layout.name
    panel.image, panel.colour = output.image, output.colour
    set_value(panel, "depth_scale_per_m", output.depth_scale_per_m)
    panel.depth_beyond = output.depth_beyond
    for name in CHANNELS:
        setattr(panel, f"use_{name}", name in spec.output.modalities)
    panel.overview = spec.output.overview


def _apply_own_motion(panel: Any, step: Step) -> None:
    """Set the panel's own fields from a step of one of OWN_FIELDS."""
    if step.perturbation.name == "faster_motion":
        panel.speed_factor = step.parameters(None).factor
        return
    for name, field in DEVIATION.items():
        set_value(panel, name, getattr(step.parameters(None), field))


def _apply_steps(panel: Any, setting: Setting) -> None:
    for name in DEVIATION:
        set_value(panel, name, 0.0)
    panel.speed_factor = 1
    clear_entries(panel)
    panel.active_step = 0
    for step in setting.steps:
        if step.perturbation.name in OWN_FIELDS:
            _apply_own_motion(panel, step)
        else:
            take_step(panel.steps.add(), step, speed_factor=panel.speed_factor)
    tell("steps")(panel, bpy.context)
