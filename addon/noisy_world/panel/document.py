# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel as a preset's document, which generate.py reads; and presets taken into the panel, whole or a part."""

import json
import math
from collections.abc import Collection, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors, write_atomic
from ..core.errors import InputError
from ..core.file_access import path_in, read_bytes
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, parse, read_yaml, unknown_name, yaml_text
from ..dataset.plan import make_plan
from ..layouts import OutputFormat
from ..perturbations import registry
from ..perturbations.execution import chosen_poses, split_motion
from ..perturbations.kinds import Identifiers, MotionPerturbation
from ..perturbations.parsing import drawing_by, parse_settings, parse_steps, swept
from ..perturbations.shares import COLOUR, MASK, MIX, WHITE, has_colour, has_share
from ..perturbations.steps import Step, steps_of_kind
from ..preset.keys import EngineName, OutputSpec, Preset, PresetSpec, SettingSpec, check_document, read_preset
from ..preset.scene_keys import HandheldSpec, TrajectorySpec
from ..scenes.polygon_mesh import is_embedded
from ..sources import SOURCES, read_scenes
from . import open_scene
from .entries import in_order, put_entry, take_entry
from .fields import is_offered, tell
from .open_scene import absolute
from .properties import LOADED, parameters_of, perturbation_of
from .source_views import PANEL_SOURCES, Footage, footage_of, shown, shown_as, shows_footage
from .step_list import SEVERITY, SHARE_COLOUR, SHARE_MIX, clear_entries, curve_ends, curve_of, levels_of
from .tree import FileText, from_line, give, is_file, is_given, set_value, take, taking, to_line, value_of, with_files
from .tree import to_document as said_by

CLEAN = "clean"
HEADING = "# Made in Blender's sidebar by Noisy World; headless/generate.py makes the same dataset from it."
PANEL = "Noisy World panel"  # used like a file's name in messages about the panel's content
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
OF_FILES = ("file", "format", "pose", "axes", "rate_hz", "stamp_unit")
"""The keys of a path that go with a file of poses."""

APART = ("scenes", "settings")
"""The keys of a preset that are lists: the panel shows an entry of each, and keeps the others as lines."""

Part: TypeAlias = Literal["SCENE", "PATH", "CAMERA", "OUTPUT"]
"""What a section of the panel shows, beside the perturbations."""


# --- the panel as a document ---


def to_document(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the preset that the panel describes.

    Paths are absolute, or relative to `folder` if they are inside it.
    """
    file, source = partial(_placed, folder=None if panel.use_data else folder), shown(panel)
    said = said_by(panel, PresetSpec, file, leave=APART)
    if not source.carries:
        said.pop("rig", None)
    if "camera" in said and (not source.distorts or source.own_distortion):
        said["camera"].pop("distortion", None)
    scenes = [_scene_line(item.line, file) for item in panel.other_scenes]
    scenes.insert(panel.scene_place, scene_of(panel, folder))
    return said | {"scenes": scenes, "settings": settings_of(panel)}


def _scene_line(line: str, file: FileText) -> Any:
    """Return what a line says of a scene, with the paths of files as `file` gives them."""
    said = from_line(line, "scenes")
    kind = next((kind for name, kind in SOURCES.items() if isinstance(said, dict) and said.get(name) is not None), None)
    return said if kind is None else with_files(parse(kind.keys, said, ConfigPath(PANEL, "scenes")), said, file)


def settings_of(panel: Any) -> list[dict[str, Any]]:
    """Return the settings that the panel describes: clean alone where there is no other."""
    found = [from_line(item.line, "settings") for item in panel.other_settings]
    if (perturb := perturb_of(panel)) and not is_picked(panel):
        own = said_by(panel.setting, SettingSpec, leave=("perturb", "sweep", "include"))
        found.insert(panel.setting_place, own | {"name": setting_name(panel), "perturb": perturb})
    return [{"name": CLEAN}, *found] if panel.use_clean or not found else found


def is_picked(panel: Any) -> bool:
    """Tell whether the perturbations are as one of the preset's sweeps has them, so that its line says them."""
    return bool(panel.picked) and json.loads(panel.picked) == [panel.setting.name, perturb_of(panel)]


def setting_name(panel: Any) -> str:
    """Return the name of the setting that is shown: another than that of a sweep's from which it was changed."""
    name = value_of(panel.setting, "name")
    changed = panel.picked and json.loads(panel.picked)[0] == name and not is_picked(panel)
    return f"{name}_changed" if changed else name


def scene_name(panel: Any) -> str:
    """Return the name of the scene that is shown."""
    return panel.scene.name if panel.scene.use_name else shown(panel).unnamed(panel)


def engine_of(panel: Any) -> EngineName:
    """Return the engine that the panel gives. Raises InputError for one that this Blender lacks."""
    if not is_offered(panel.render.engine):
        problem = "is Embree, which needs the Python package embreex in Blender"
        raise InputError(PANEL, problem, where="render.engine", remedy="choose another engine, or install it")
    return panel.render.engine


def format_of(panel: Any) -> OutputFormat:
    """Return the format of the dataset that the panel describes."""
    output = panel.output
    given = {name: getattr(output, name) for name in ("layout", "image", "colour", "depth_beyond")}
    return OutputSpec(**given, depth_scale_per_m=value_of(output, "depth_scale_per_m")).format


def scene_of(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the panel's scene as a preset has it."""
    source, file = shown(panel), partial(_placed, folder=folder)
    name = {"name": panel.scene.name} if panel.scene.use_name else {}
    path = {"trajectory": _trajectory(panel, file)} if source.has_path(panel) else {}
    return {**name, **source.entry(panel, file), **path}


def recorded(panel: Any) -> Footage:
    """Return the recording that the panel names. Raises InputError."""
    if not shown(panel).previewed:
        problem = "has no frames that can be shown here"
        raise InputError(PANEL, problem, where="scenes", remedy="press Generate to make them")
    camera = {"camera": camera_of(panel)} if panel.use_camera else {}
    document = {"seed": 0, "scenes": [scene_of(panel)], **camera, "settings": [{"name": CLEAN}]}
    return footage_of(check_document(document, Path(PANEL)))


def camera_of(panel: Any) -> dict[str, Any]:
    """Return the panel's camera as a preset has it, without a lens that distorts."""
    return {name: value_of(panel.camera, name) for name in (*INTRINSICS, "near_m", "far_m")}


def _placed(path: str, folder: Path | None) -> str:
    """Return a file's path as a preset in a folder has it."""
    whole = path if is_embedded(path) else absolute(path)
    if folder is None or not whole or not Path(whole).is_relative_to(folder.resolve()):
        return whole
    return Path(whole).relative_to(folder.resolve()).as_posix()


def _trajectory(panel: Any, file: FileText) -> dict[str, Any]:
    path, from_file = panel.scene.trajectory, panel.trajectory_source == "FILE"
    leave = ("handheld",) if from_file else ("handheld", *OF_FILES)
    made = said_by(path, TrajectorySpec, file, leave=leave)
    if from_file:
        return {"file": file(path.file)} | made
    return {"handheld": said_by(path.handheld, HandheldSpec) | {"frames": path.handheld.frames}} | made


def perturb_of(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel does to a scene, as a preset's `perturb`; what is switched off is left out."""
    listed = []
    for step in panel.steps:
        if step.enabled and step.perturbation not in registry():
            raise unknown_name(ConfigPath(PANEL, "perturbations"), "perturbation", step.perturbation, list(registry()))
        if step.enabled:
            listed.append({step.perturbation: values_of(step)})
    return listed


def listed_motion(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel's list does to the path, as a preset's `perturb`."""
    return [
        {step.perturbation: values_of(step)}
        for step in panel.steps
        if step.enabled and isinstance(registry().get(step.perturbation), MotionPerturbation)
    ]


def values_of(step: Any) -> dict[str, Any]:
    """Return an entry of the list as a preset has it."""
    perturbation, group = perturbation_of(step), parameters_of(step)
    given = [item.name for item in fields(perturbation.parameters) if is_given(group, item.name)]
    values: dict[str, Any] = {}
    if perturbation.severities and (step.use_severity or step.mode == "dynamic"):
        values |= _severity_of(step)
    elif not given:
        given = list(perturbation.severities)  # at least these, as without any key a preset means severity 3
    for name in given:
        value = value_of(group, name)
        if not is_file(perturbation.parameters, name):
            values[name] = value
        elif value:  # without a file there is none
            values[name] = absolute(value)
    if perturbation.temporals and step.temporal != perturbation.temporals[0]:
        values["temporal"] = step.temporal
    return values | _share_of(step) if has_share(perturbation) else values


def _share_of(step: Any) -> dict[str, Any]:
    """Return how much of an entry's effect shows, and where, as a preset has it; {} for all of it."""
    levels = levels_of(step, _keyed_frames(step, SHARE_MIX), SHARE_MIX)
    mix = value_of(step, SHARE_MIX) if levels is None else levels if len(levels) > 1 else levels[0]
    said: dict[str, Any] = {} if mix == 1 else {MIX: mix}
    colour = value_of(step, SHARE_COLOUR) if has_colour(perturbation_of(step)) else list(WHITE)
    said |= {} if colour == list(WHITE) else {COLOUR: colour}
    return said | {MASK: absolute(step.share_mask)} if step.share_mask else said


def _severity_of(step: Any) -> dict[str, Any]:
    """Return an entry's severity as a preset has it: one, drawn for each frame, or of each frame as it is keyed."""
    levels = levels_of(step, _keyed_frames(step, SEVERITY))
    if levels is not None:
        return {"mode": "keyed", "levels": levels} if len(levels) > 1 else {"severity": levels[0]}
    if step.mode == "dynamic" and step.levels:
        return {"mode": "dynamic", "levels": from_line(step.levels, "levels")}
    values = {"severity": value_of(step, "severity")}
    return values | {"mode": "dynamic"} if step.mode == "dynamic" else values


def _keyed_frames(step: Any, name: str) -> NDArray[np.int64] | None:
    """Return the scene frames that the sequence shows, as far as an entry's value is keyed; None for all from 0."""
    curve = curve_of(step, name)
    ends = None if curve is None else curve_ends(curve)
    if ends is None:
        return None
    scene = step.id_data
    _, choosing = split_motion(motion_of(scene.noisy_world))
    count = max(1 + math.ceil(ends[1]) * max(1, scene.noisy_world.speed_factor), scene.frame_end + 1)
    shown_frames = chosen_poses(choosing, count, identifiers_of(scene.noisy_world))
    frames = open_scene.scene_frames(scene, count)
    return np.asarray(frames if shown_frames is None else frames[shown_frames], np.int64)


def steps_of(panel: Any) -> tuple[Step, ...]:
    """Return what the panel does to a scene, in propagation order. Raises InputError naming what is wrong."""
    place = ConfigPath(PANEL, "perturbations")
    stream = panel.setting.stream if panel.setting.use_stream else None
    return drawing_by(parse_steps(perturb_of(panel), place, registry()), setting_name(panel), stream, place)


def motion_of(panel: Any) -> tuple[Step[MotionPerturbation], ...]:
    """Return the steps that act on the path, in propagation order, even if other steps are wrong."""
    found = parse_steps(listed_motion(panel), ConfigPath(PANEL, "motion"), registry())
    return steps_of_kind(found, MotionPerturbation)


def intrinsics_of(panel: Any) -> Intrinsics:
    """Return the panel's camera; that of the scene or the recording where it holds. Raises InputError without one."""
    if shows_footage(panel):
        return recorded(panel).camera
    if open_scene.is_shown(panel) and not panel.use_camera:
        return open_scene.intrinsics_of_scene(panel.id_data)
    return Intrinsics(*(value_of(panel.camera, name) for name in INTRINSICS))


def identifiers_of(panel: Any) -> Identifiers:
    """Return the identifiers of the random streams of the panel's sequence, as in the generator."""
    return (value_of(panel, "seed"), scene_name(panel), setting_name(panel))


def preset_of(panel: Any, path: Path | None = None) -> Preset:
    """Return the checked preset that the panel describes, as if it were read from `path`.

    Raises InputError naming the key.
    """
    return check_document(to_document(panel, path and path.parent), path or Path(PANEL))


def save_preset(panel: Any, path: Path) -> str:
    """Write the preset that the panel describes; return what was done beside that, "" for nothing.

    Raises NoisyWorldError; an existing file is then kept.
    """
    said = ""
    if open_scene.is_shown(panel):
        open_scene.check(panel.id_data)
        said = open_scene.ensure(panel.id_data, path.with_suffix(".blend"))
    preset = preset_of(panel, path)
    make_plan(preset)  # raises for a preset that cannot be generated, which is then not saved
    text = yaml_text(preset.document)
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, f"{HEADING}\n{text}".encode(), path.parent)
    panel.preset_path = str(path)
    panel.preset_settings = "\n".join(written_settings(preset))
    return said


# --- presets taken into the panel ---


def open_preset(panel: Any, path: Path, setting: str = "") -> None:
    """Take a preset's file into the panel. setting: which one is shown, by default the first that is not clean.

    Raises InputError where it cannot be read; the panel is then unchanged.
    """
    _take(panel, read_preset(path), setting)
    panel.preset_path = str(path)


def add_perturbations(panel: Any, path: Path, setting: str = "") -> tuple[list[Step], list[Step]]:
    """Put the perturbations of one of a preset's settings into the panel, and change nothing else in it.

    One that is in the panel already is set as the preset has it; the others are added. setting: by default the first
    that is not clean. Returns those that were added, and those that were set. Raises InputError where the file cannot
    be read; the panel is then unchanged.
    """
    chosen = setting_of(read_preset(path), setting)
    place = ConfigPath(path, "settings")
    steps = parse_steps(chosen["perturb"], place, registry())
    added: list[Step] = []
    changed: list[Step] = []
    with taking():
        for step, (name, values) in zip(steps, in_order(chosen["perturb"], place), strict=True):
            (changed if put_entry(panel, name, values, step.occurrence) else added).append(step)
        tell("steps")(panel, bpy.context)
    return added, changed


def shows_loaded(path: Path) -> bool:
    """Tell whether a preset's first scene is a mesh, which is loaded into a file. Raises InputError."""
    return shown_as(read_scenes(read_preset(path))[0]) in LOADED


def apply_part(panel: Any, path: Path, part: Part) -> None:
    """Set one section of the panel from a preset, and change nothing else.

    Raises InputError where the file cannot be read, or the panel cannot show that part; it is then unchanged.
    """
    preset = read_preset(path)
    _refuse_path(preset, part)
    with taking():
        if part in ("SCENE", "PATH"):
            _take_scene(panel, preset, 0, part=part)
        elif part == "CAMERA":
            _take_key(panel, preset, "camera")
        else:
            _take_key(panel, preset, "render")
            _take_key(panel, preset, "output")


DevicePart: TypeAlias = Literal["CAMERA", "DEPTH", "NOISE"]
"""What a file of a measured device says: its camera and lens, the noise of its depth, the noise of its colour."""

_DEVICE_KEYS: dict[str, DevicePart] = {"camera": "CAMERA", "depth": "DEPTH", "perturb": "NOISE"}


def take_device(panel: Any, path: Path, parts: Collection[DevicePart]) -> list[DevicePart]:
    """Take what the file of a measured device says into the panel, as a preset that names it has it.

    Noise of colour goes into the list, as of a preset's perturbations. Returns the parts of `parts` that the file says.
    Raises InputError where it cannot be read, or says none of them; the panel is then unchanged.
    """
    held = device_parts(path)
    taken: list[DevicePart] = [part for part in held if part in parts]
    if not taken:
        raise InputError(path, "says nothing of what is to be taken", remedy="name a file of measure --device")
    preset = check_document(_naming_device(str(path), taken), Path(PANEL))
    steps = parse_steps(preset.document["settings"][-1].get("perturb", []), preset.place("settings"), registry())
    if "DEPTH" in taken:
        parse_steps([preset.document["rig"]["depth"]["sensor"]], ConfigPath(path, "depth"), registry())
    with taking():
        if "CAMERA" in taken:
            take(panel.camera, preset.spec.camera, preset.document["camera"], leave=("near_m", "far_m"))
            panel.use_camera = True
        if "DEPTH" in taken:
            panel.rig.depth.sensor = to_line(preset.document["rig"]["depth"]["sensor"])
            give(panel.rig.depth, "sensor")
        items = in_order(preset.document["settings"][-1].get("perturb", []), preset.place("settings"))
        for step, (name, values) in zip(steps, items, strict=True):
            put_entry(panel, name, values, step.occurrence)
        for name in ("camera", "rig", "steps"):
            tell(name)(panel, bpy.context)
    return taken


def device_parts(path: Path) -> list[DevicePart]:
    """Return what the file of a measured device says; [] for a file that is none. Raises InputError for no YAML."""
    try:
        content = read_yaml(read_bytes(path), path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    if not isinstance(content, dict) or not set(content) <= set(_DEVICE_KEYS):
        return []
    found: list[DevicePart] = [part for name, part in _DEVICE_KEYS.items() if content.get(name)]
    return found


def _naming_device(file: str, parts: Collection[DevicePart]) -> dict[str, Any]:
    """Return a preset's document that names a device's file for these parts, and else as little as a preset can."""
    scene = {"name": "any", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 2}}}
    named: dict[str, Any] = {"seed": 0, "scenes": [scene], "settings": [{"name": CLEAN}]}
    if "CAMERA" in parts:
        named["camera"] = {"device": file}
    if "DEPTH" in parts:
        named["rig"] = {"depth": {"sensor": file}}
    if "NOISE" in parts:
        named["settings"].append({"name": "measured", "perturb": [{"device": file}]})
    return named


def can_apply(path: Path, part: Part) -> bool:
    """Tell whether the panel can take a part of a preset."""
    try:
        _refuse_path(read_preset(path), part)
    except InputError:
        return False
    return True


def _refuse_path(preset: Preset, part: Part) -> None:
    """Refuse the path of a preset that has none of its own."""
    (entry, *_) = read_scenes(preset)
    if part == "PATH" and PANEL_SOURCES[shown_as(entry)].has_own_path:
        raise preset.place("scenes.0").at(entry.kind.name).error("has a path of its own", "take the scene too")


def _take(panel: Any, preset: Preset, wanted: str) -> None:
    read_scenes(preset)
    written = written_settings(preset)
    if wanted and wanted not in written:
        raise unknown_name(preset.place("settings"), "setting", wanted, list(written))
    with taking():
        for item in fields(PresetSpec):
            if item.name not in APART:
                _take_key(panel, preset, item.name)
        panel.other_scenes.clear()
        for index, entry in enumerate(preset.document["scenes"][1:], 1):
            keys = read_scenes(preset)[index].keys
            line = panel.other_scenes.add()
            line.name, line.line = (
                str(entry.get("name", f"Scene {index}")),
                to_line(with_files(keys, entry, _reading(preset))),
            )
        panel.scene_place = 0
        _take_scene(panel, preset, 0)
        _take_settings(panel, preset, written, wanted)
        panel.preset_settings = "\n".join(written)


def _reading(preset: Preset) -> FileText:
    """Return what gives the whole path of a file that a preset names."""
    return lambda text: text if is_embedded(text) else str(path_in(preset.folder, text, preset.place("scenes")))


def _take_key(panel: Any, preset: Preset, name: str) -> None:
    """Take one of a preset's keys, but scenes and settings."""
    spec, given = preset.spec, preset.document
    only = tuple(item.name for item in fields(PresetSpec) if item.name != name)
    take(panel, spec, given, _reading(preset), leave=only)
    if name == "camera" and spec.camera is None:
        for key in (*INTRINSICS, "near_m", "far_m"):
            set_value(panel.camera, key, getattr(spec.mesh_camera, key))
        panel.camera.use_distortion = False
    if name == "output":
        own = spec.output.format
        panel.output.image, panel.output.colour = own.image, own.colour
        set_value(panel.output, "depth_scale_per_m", value_given(given, own.depth_scale_per_m))
    if name == "rig" and spec.rig is None:
        panel.rig.use_imu = panel.rig.use_depth = False


def value_given(document: dict[str, Any], otherwise: float) -> float:
    """Return the depth scale that a preset gives, or the layout's."""
    return (document.get("output") or {}).get("depth_scale_per_m") or otherwise


def _take_scene(panel: Any, preset: Preset, index: int, part: Part | None = None) -> None:
    """Show a preset's scene, or what a section shows of it."""
    entry, given, file = read_scenes(preset)[index], preset.document["scenes"][index], _reading(preset)
    if part != "PATH":
        panel.mesh_source = shown_as(entry)
        shown(panel).take(panel, entry, given, file)
        name = given.get("name")
        panel.scene.name = shown(panel).unnamed(panel) if name is None else name
        panel.scene.use_name = name is not None
    path = getattr(entry.keys, "trajectory", None)
    if part == "SCENE":
        return
    panel.scene.use_trajectory = path is not None
    if path is not None:
        panel.trajectory_source = "FILE" if path.handheld is None else "HANDHELD"
        take(panel.scene.trajectory, path, given["trajectory"], file)
    elif shown_as(entry) == "SCENE":
        panel.trajectory_source = "CAMERA"
        chosen = getattr(entry.keys, "frame_range", None)
        panel.scene.trajectory.every = max(1, (1 if chosen is None else chosen.step) // panel.id_data.frame_step)


# --- settings ---


def written_settings(preset: Preset) -> dict[str, dict[str, Any]]:
    """Return by name the settings of a preset as a preset has them, those of sweeps written out. Raises InputError."""
    spec = preset.spec
    parsed = parse_settings(spec.settings, preset.setting_places, registry(), spec.render.backend)
    found: dict[str, dict[str, Any]] = {}
    for item, place in zip(spec.settings, preset.setting_places, strict=True):
        if item.sweep is None:
            made = [(item.name, item.stream, list(item.perturb))]
        else:
            made = [
                (name, stream, [step]) for name, stream, step, _ in swept(item.sweep, place.at("sweep"), registry())
            ]
        for name, stream, perturb in made:
            given = {"backend": item.backend, "stream": stream}
            own = {key: value for key, value in given.items() if value is not None}
            located = [_located(step, preset.folder, place) for step in perturb]
            found[name or ""] = {"name": name, "perturb": located, **own}
    assert list(found) == [item.name for item in parsed]
    return found


def _located(step: Any, folder: Path, place: ConfigPath) -> Any:
    """Return a preset's step with the files that it names by whole paths. folder: of the preset."""
    ((name, values),) = step.items() if isinstance(step, dict) else (("", None),)
    kind = registry().get(name)
    if kind is None or not isinstance(values, dict):
        return step
    of_files = {item.name for item in fields(kind.parameters) if is_file(kind.parameters, item.name)}
    of_files |= {MASK} if has_share(kind) else set()
    whole = {key: str(path_in(folder, values[key], place)) for key in of_files if values.get(key)}
    return {name: {**values, **whole}}


def setting_of(preset: Preset, wanted: str) -> dict[str, Any]:
    """Return the setting of a preset that is wanted, as a preset has it: "" is the first that is not clean.

    Raises InputError where there is none of this name.
    """
    found = written_settings(preset)
    if wanted and wanted not in found:
        raise unknown_name(preset.place("settings"), "setting", wanted, list(found))
    perturbed = (item for item in found.values() if item["perturb"])
    return found[wanted] if wanted else next(perturbed, next(iter(found.values())))


def show_setting(panel: Any, setting: dict[str, Any], place: ConfigPath) -> None:
    """Let the panel's perturbations be those of a setting, in place of what it holds."""
    with taking():
        if setting["name"] != CLEAN:
            panel.setting.name = setting["name"]
        for key in ("backend", "stream"):
            if key in setting:
                setattr(panel.setting, key, setting[key])
            setattr(panel.setting, f"use_{key}", key in setting)
        clear_entries(panel)
        panel.active_step = 0
        for name, values in in_order(setting["perturb"], place):
            take_entry(panel.steps.add(), name, values, speed_factor=panel.speed_factor)
        tell("steps")(panel, bpy.context)


def _take_settings(panel: Any, preset: Preset, written: dict[str, dict[str, Any]], wanted: str) -> None:
    """Take a preset's settings: the one to show into the list, the others as lines."""
    given: Sequence[Any] = preset.document.get("settings") or [{"name": CLEAN}]
    panel.use_clean = given[0] == {"name": CLEAN}
    others = [*given[1:]] if panel.use_clean else [*given]
    named = [item["name"] for item in others if item.get("perturb")]
    chosen = wanted or next(iter(named), "") or next((name for name, item in written.items() if item["perturb"]), "")
    place = next((index for index, item in enumerate(others) if item.get("name") == chosen and chosen in named), None)
    panel.setting_place = len(others) if place is None else place
    if place is not None:
        others.pop(place)
    panel.other_settings.clear()
    for item in others:
        line = panel.other_settings.add()
        line.name, line.line = _spoken_name(item), to_line(item)
    panel.picked = ""
    show_setting(panel, written.get(chosen, {"name": CLEAN, "perturb": []}), preset.place("settings"))
    if chosen and place is None and written[chosen]["perturb"]:
        panel.picked = json.dumps([chosen, perturb_of(panel)])


def _spoken_name(item: dict[str, Any]) -> str:
    return item.get("name") or f"Sweep of {', '.join(item['sweep']['perturb'])}"
