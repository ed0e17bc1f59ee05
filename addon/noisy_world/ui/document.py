# SPDX-License-Identifier: GPL-3.0-or-later
"""Converting the panel's content into a preset's document, which generate.py reads, and back."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy

from ..core.datasets.layouts import OutputFormat
from ..core.datasets.storage import storage_errors, write_atomic
from ..core.geometry import Intrinsics
from ..core.home import path_in, with_home
from ..core.perturbing.kinds import Identifiers, MotionPerturbation
from ..core.perturbing.reading import parse_settings, parse_steps
from ..core.perturbing.steps import Setting, Step, steps_of_kind
from ..core.presets.output import OutputSpec
from ..core.presets.preset import Preset, PresetSpec, check_document, read_preset
from ..core.presets.selection import OnlySpec
from ..core.scenes.embedded import is_embedded, room_mesh, room_name, room_seeds
from ..core.schema import Place, unknown_name
from ..core.yaml_reading import yaml_text
from ..perturbations import registry
from ..planning import make_plan
from .described import LARGEST_INT, tell, told_once
from .properties import OVERRIDE, parameters_of, perturbation_of
from .step_list import put_step, take_step
from .typed_numbers import set_value, value_of

CLEAN = "clean"
HEADING = "# Made in Blender's sidebar by Noisy World; headless/generate.py makes the same dataset from it."
PANEL = "Noisy World panel"  # used like a file's name in messages about the panel's content
DEVIATION = {"deviation_rotation_deg": "rotation_deg", "deviation_translation_m": "translation_m"}
OWN_FIELDS = ("motion_deviation", "faster_motion")  # perturbations that the panel has fields for, beside its list
CAMERA = {
    "width_px": "width", "height_px": "height", "fx_px": "fx", "fy_px": "fy", "cx_px": "cx", "cy_px": "cy",
    "near_m": "near_m", "far_m": "far_m",
}  # fmt: skip
INTRINSICS = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
HANDHELD = {
    "handheld_frames": "frames", "handheld_rate_hz": "rate_hz", "handheld_speed_m_s": "speed_m_s",
    "handheld_clearance_m": "clearance_m",
}  # fmt: skip
TRAJECTORY = {
    "trajectory_format": "format", "trajectory_pose": "pose", "trajectory_axes": "axes",
    "trajectory_rate_hz": "rate_hz", "trajectory_stamp_unit": "stamp_unit",
}  # fmt: skip


# --- the panel as a document ---


def to_document(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the preset that the panel describes: one scene, the settings clean and, with perturbations, one more.

    Paths are absolute, or relative to `folder` if they are inside it.
    """
    perturb = perturb_of(panel)
    modalities = [name for name in ("rgb", "depth") if getattr(panel, f"use_{name}")]
    return {
        "seed": panel.seed,
        "scenes": [scene_of(panel, folder)],
        "camera": {key: value_of(panel, name) for name, key in CAMERA.items()},
        "render": {"engine": panel.engine, "samples": panel.samples, "backend": panel.backend},
        "settings": [{"name": CLEAN}, *([{"name": panel.setting_name, "perturb": perturb}] if perturb else [])],
        "output": {
            "layout": panel.layout,
            "image": panel.image,
            "colour": panel.colour,
            "depth_scale_per_m": value_of(panel, "depth_scale_per_m"),
            "depth_beyond": panel.depth_beyond,
            "modalities": modalities,
            "overview": panel.overview,
        },
    }


def format_of(panel: Any) -> OutputFormat:
    """Return the format of the dataset that the panel describes."""
    scale_per_m = value_of(panel, "depth_scale_per_m")
    output = OutputSpec(panel.layout, panel.image, panel.colour, scale_per_m, panel.depth_beyond)
    return output.format


def scene_of(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the panel's scene as a preset has it."""
    return {
        "name": panel.scene_name,
        "mesh": room_mesh(panel.room_seed) if panel.mesh_source == "ROOM" else _path(panel.mesh_path, folder),
        "trajectory": _trajectory(panel, folder),
    }


def absolute(path: str) -> str:
    """Return a path of the panel as an absolute one, with forward slashes; "" stays "".

    ~ and ~user are home folders; the name of a user who is not there stays, and is refused when the file is read.
    """
    if path.startswith("~"):
        try:
            path = str(with_home(path))
        except LookupError:
            return path
    return Path(bpy.path.abspath(path)).resolve().as_posix() if path else ""


def _path(path: str, folder: Path | None) -> str:
    whole = absolute(path)
    if folder is None or not whole or not Path(whole).is_relative_to(folder.resolve()):
        return whole
    return Path(whole).relative_to(folder.resolve()).as_posix()


def _trajectory(panel: Any, folder: Path | None) -> dict[str, Any]:
    if panel.trajectory_source == "HANDHELD":
        made: dict[str, Any] = {"handheld": {key: value_of(panel, name) for name, key in HANDHELD.items()}}
    else:
        made = {"file": _path(panel.trajectory_path, folder)}
        made |= {key: value_of(panel, name) for name, key in TRAJECTORY.items()}
    return made | ({"every": panel.every} if panel.every > 1 else {})


def perturb_of(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel does to a scene, as a preset's `perturb`; what is switched off is left out."""
    listed = []
    for step in panel.steps:
        if step.enabled and step.perturbation not in registry():
            raise unknown_name(Place(PANEL, "perturbations"), "perturbation", step.perturbation, list(registry()))
        if step.enabled:
            listed.append({step.perturbation: values_of(step)})
    return _own_motion(panel) + listed


def _own_motion(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel's own fields do to the path."""
    steps: list[dict[str, Any]] = []
    if panel.speed_factor > 1:
        steps.append({"faster_motion": {"factor": panel.speed_factor}})
    if panel.deviation_rotation or panel.deviation_translation_m:
        steps.append({"motion_deviation": {key: value_of(panel, name) for name, key in DEVIATION.items()}})
    return steps


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
    defaults = {item.name: item.default for item in fields(perturbation.parameters)}
    given = [name for name in defaults if value_of(group, name) != defaults[name]]
    values: dict[str, Any] = {}
    if perturbation.severities and (step.use_severity or step.mode == "dynamic"):
        values["severity"] = value_of(step, "severity")
        if step.mode == "dynamic":
            values["mode"] = "dynamic"
        by_severity = {name for name in perturbation.severities if not getattr(group, OVERRIDE + name)}
        given = [
            name for name in defaults if name not in by_severity and (name in perturbation.severities or name in given)
        ]
    elif perturbation.severities and not given:
        given = list(perturbation.severities)  # at least these, as without any key a preset means severity 3
    values |= {name: value_of(group, name) for name in given}
    if perturbation.temporals and step.temporal != perturbation.temporals[0]:
        values["temporal"] = step.temporal
    return values


def steps_of(panel: Any) -> tuple[Step, ...]:
    """Return what the panel does to a scene, in propagation order. Raises InputError naming what is wrong."""
    return parse_steps(perturb_of(panel), Place(PANEL, "perturbations"), registry())


def motion_of(panel: Any) -> tuple[Step[MotionPerturbation], ...]:
    """Return the steps that act on the path, in propagation order, even if other steps are wrong."""
    perturb = _own_motion(panel) + listed_motion(panel)
    return steps_of_kind(parse_steps(perturb, Place(PANEL, "motion"), registry()), MotionPerturbation)


def intrinsics_of(panel: Any) -> Intrinsics:
    """Return the panel's camera."""
    return Intrinsics(*(value_of(panel, name) for name in INTRINSICS))


def identifiers_of(panel: Any) -> Identifiers:
    """Return the identifiers of the random streams of the panel's sequence, as in the generator."""
    return (panel.seed, panel.scene_name, panel.setting_name)


def preset_of(panel: Any, path: Path | None = None) -> Preset:
    """Return the checked preset that the panel describes, as if it were read from `path`.

    Raises InputError naming the key.
    """
    return check_document(to_document(panel, path and path.parent), path or Path(PANEL))


def save_preset(panel: Any, path: Path) -> None:
    """Write the preset that the panel describes. Raises NoisyWorldError; an existing file is then kept."""
    preset = preset_of(panel, path)
    make_plan(preset)  # raises for a preset that cannot be generated, which is then not saved
    text = yaml_text(preset.document)
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, f"{HEADING}\n{text}".encode(), path.parent)
    panel.preset_path = str(path)
    panel.preset_settings = "\n".join(item["name"] for item in preset.document["settings"])


# --- a document into the panel ---


def open_preset(panel: Any, path: Path, setting: str = "") -> None:
    """Load a preset's file into the panel: its scene and one of its settings, by default the first that is not clean.

    Raises InputError where it cannot be read, or has content that the panel cannot show; the panel is then unchanged.
    """
    _take(panel, read_preset(path), setting)
    panel.preset_path = str(path)


def from_document(document: dict[str, Any], panel: Any, *, path: Path, setting: str = "") -> None:
    """Load a preset's document into the panel as open_preset does, as if it were read from the file `path`."""
    _take(panel, check_document(document, path), setting)


def add_perturbations(panel: Any, path: Path, setting: str = "") -> tuple[list[Step], list[Step]]:
    """Put the perturbations of one of a preset's settings into the panel, and change nothing else in it.

    One that is in the panel already is set as the preset has it; the others are added. setting: by default the first
    that is not clean. Returns those that were added, and those that were set. Raises InputError where the file cannot
    be read or its perturbations cannot be shown; the panel is then unchanged.
    """
    _, chosen = _settings_of(read_preset(path), setting)
    added: list[Step] = []
    changed: list[Step] = []
    with told_once():
        for step in chosen.steps:
            if step.perturbation.name in OWN_FIELDS:
                before = _own_motion(panel)
                _take_own_motion(panel, step)
                was_there = any(step.perturbation.name in item for item in before)
            else:
                was_there = put_step(panel, step)
            (changed if was_there else added).append(step)
        tell("steps")(panel, bpy.context)
    return added, changed


def _take(panel: Any, preset: Preset, wanted: str) -> None:
    spec = preset.spec
    _refuse_unshown(preset)
    found, chosen = _settings_of(preset, wanted)
    if chosen.stream != chosen.name:
        problem = f"{chosen.name}: draws by the stream {chosen.stream}: the panel cannot show that"
        raise preset.place("settings").error(problem, "run it with generate.py")
    with told_once():
        _take_scene(panel, preset)
        _take_rest(panel, spec, chosen)
        _take_steps(panel, chosen)
        panel.preset_settings = "\n".join(item.name for item in found)


def _settings_of(preset: Preset, wanted: str) -> tuple[tuple[Setting, ...], Setting]:
    """Return a preset's settings, and that which is wanted: "" is the first that is not clean."""
    place = preset.place("settings")
    found = parse_settings(preset.spec.settings, preset.setting_places, registry(), preset.spec.render.backend)
    chosen = next((item for item in found if item.name == wanted or (not wanted and item.steps)), None)
    if chosen is None and wanted:
        raise unknown_name(place, "setting", wanted, [item.name for item in found])
    chosen = chosen or found[0]
    for step in chosen.steps:
        if step.levels is not None and step.severity is None:
            raise place.error(f"{chosen.name}: levels cannot be shown in the panel", "use severity")
    return found, chosen


def _refuse_unshown(preset: Preset) -> None:
    """Refuse content that the panel cannot show, as it would be lost when the preset is saved again."""
    spec = preset.spec
    scene = spec.scenes[0]
    trajectory = scene.trajectory
    asked = {
        "scenes": len(spec.scenes) > 1 and f"holds {len(spec.scenes)} scenes, and the panel shows one",
        "scenes.0.sequence": scene.sequence is not None and "is an existing sequence",
        "scenes.0.replica": scene.replica is not None and "is looked for under data",
        "only": spec.only != OnlySpec() and "chooses a part of the scenes or settings",
        "scenes.0.mesh": _unshowable(scene.mesh or ""),
        "scenes.0.trajectory.start": trajectory is not None and trajectory.start != 0 and "chooses a part of the path",
        "scenes.0.trajectory.stop": trajectory is not None and trajectory.stop is not None and "chooses a part",
        "scenes.0.trajectory.resample_hz": trajectory is not None and trajectory.resample_hz is not None
        and "resamples the path",
        "scenes.0.trajectory.handheld.seed": trajectory is not None and trajectory.handheld is not None
        and trajectory.handheld.seed is not None and "is another seed than the preset's",
        "scenes.0.trajectory.handheld.revisit": trajectory is not None and trajectory.handheld is not None
        and trajectory.handheld.revisit and "is true",
        "rig": spec.rig is not None and "places sensors on a robot",
        "render.device": spec.render.device != "cpu" and f"is {spec.render.device}",
        "output.licence": spec.output.licence is not None and "states a licence",
        "render.allow_empty": spec.render.allow_empty and "is true",
        "render.processors": spec.render.processors != "same" and f"is {spec.render.processors}",
        "seed": spec.seed > LARGEST_INT and f"is {spec.seed}, and the panel counts to {LARGEST_INT}",
    }  # fmt: skip
    for path, problem in asked.items():
        if problem:
            raise preset.place(path).error(f"{problem}: the panel cannot show that", "run it with generate.py")


def _unshowable(mesh: str) -> str:
    """Return why the panel cannot show a mesh, or ""."""
    if not is_embedded(mesh):
        return "stands for several files" if "*" in mesh else ""
    try:
        return "stands for several rooms" if len(room_seeds(mesh)) > 1 else ""
    except ValueError as error:
        return str(error)


def _take_scene(panel: Any, preset: Preset) -> None:
    (scene,) = preset.spec.scenes
    assert scene.mesh is not None
    assert scene.trajectory is not None
    panel.mesh_source = "ROOM" if is_embedded(scene.mesh) else "FILE"
    if is_embedded(scene.mesh):
        (panel.room_seed,) = room_seeds(scene.mesh)
    else:
        panel.mesh_path = str(path_in(preset.folder, scene.mesh, preset.place("scenes.0.mesh")))
    panel.scene_name = scene.name or (
        room_name(scene.mesh, panel.room_seed) if is_embedded(scene.mesh) else Path(scene.mesh).stem
    )
    handheld = scene.trajectory.handheld
    panel.trajectory_source = "FILE" if handheld is None else "HANDHELD"
    if handheld is None:
        assert scene.trajectory.file is not None
        file = path_in(preset.folder, scene.trajectory.file, preset.place("scenes.0.trajectory"))
        panel.trajectory_path = str(file)
        for name, field in TRAJECTORY.items():
            set_value(panel, name, getattr(scene.trajectory, field))
    else:
        for name, field in HANDHELD.items():
            set_value(panel, name, getattr(handheld, field))
    panel.every = scene.trajectory.every


def _take_rest(panel: Any, spec: PresetSpec, setting: Setting) -> None:
    panel.seed = spec.seed
    for name, field in CAMERA.items():
        set_value(panel, name, getattr(spec.mesh_camera, field))
    panel.engine, panel.samples = spec.render.engine, spec.render.samples
    panel.backend = setting.backend
    output = spec.output.format
    panel.layout = output.layout.name
    panel.image, panel.colour = output.image, output.colour
    set_value(panel, "depth_scale_per_m", output.depth_scale_per_m)
    panel.depth_beyond = output.depth_beyond
    panel.use_rgb = "rgb" in spec.output.modalities
    panel.use_depth = "depth" in spec.output.modalities
    panel.overview = spec.output.overview
    if setting.name != CLEAN:
        panel.setting_name = setting.name


def _take_own_motion(panel: Any, step: Step) -> None:
    """Set the panel's own fields from a step of one of OWN_FIELDS."""
    if step.perturbation.name == "faster_motion":
        panel.speed_factor = step.parameters(None).factor
        return
    for name, field in DEVIATION.items():
        set_value(panel, name, getattr(step.parameters(None), field))


def _take_steps(panel: Any, setting: Setting) -> None:
    for name in DEVIATION:
        set_value(panel, name, 0.0)
    panel.speed_factor = 1
    panel.steps.clear()
    panel.active_step = 0
    for step in setting.steps:
        if step.perturbation.name in OWN_FIELDS:
            _take_own_motion(panel, step)
        else:
            take_step(panel.steps.add(), step)
    tell("steps")(panel, bpy.context)
