# SPDX-License-Identifier: GPL-3.0-or-later
"""A preset's content into the panel: all of it, or the part that a section shows."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import bpy

from ..core.channels import CHANNELS
from ..core.errors import InputError
from ..core.home import path_in
from ..core.perturbing.reading import parse_settings
from ..core.perturbing.steps import Setting, Step
from ..core.presets.preset import Preset, check_document, read_preset
from ..core.presets.scene_keys import SceneSpec
from ..core.presets.selection import OnlySpec
from ..core.scenes.embedded import is_embedded, room_name, room_seeds
from ..core.schema import unknown_name
from ..perturbations import registry
from . import footage, scene_copy, this_scene
from .described import LARGEST_INT, tell, told_once
from .document import CAMERA, CLEAN, DEVIATION, HANDHELD, OWN_FIELDS, TRAJECTORY, own_motion
from .step_list import clear_entries, put_step, take_step
from .typed_numbers import set_value

Part: TypeAlias = Literal["SCENE", "PATH", "CAMERA", "OUTPUT"]
"""What a section of the panel shows, beside the perturbations."""

_SHOWN: dict[Part, tuple[str, ...]] = {
    "SCENE": ("scenes", "scenes.0.sequence", "scenes.0.replica", "scenes.0.mesh", "scenes.0.blend"),
    "PATH": ("scenes", "scenes.0.sequence", "scenes.0.replica", "scenes.0.trajectory", "scenes.0.blend"),
    "CAMERA": (),
    "OUTPUT": ("render", "output"),
}
"""Keys of what each part takes; what the panel cannot show of them refuses the part."""


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
                before = own_motion(panel)
                _take_own_motion(panel, step)
                was_there = any(step.perturbation.name in item for item in before)
            else:
                was_there = put_step(panel, step)
            (changed if was_there else added).append(step)
        tell("steps")(panel, bpy.context)
    return added, changed


def take_part(panel: Any, path: Path, part: Part) -> None:
    """Set one section of the panel from a preset, and change nothing else.

    Raises InputError where the file cannot be read, or the panel cannot show that part; it is then unchanged.
    """
    preset = read_preset(path)
    _refuse_unshown(preset, part)
    with told_once():
        if part == "SCENE":
            _take_mesh(panel, preset)
        elif part == "PATH":
            _take_path(panel, preset)
        elif part == "CAMERA":
            _take_camera(panel, preset)
        else:
            _take_output(panel, preset)
            panel.backend = preset.spec.render.backend


def can_take(path: Path, part: Part) -> bool:
    """Tell whether the panel can take a part of a preset."""
    try:
        _refuse_unshown(read_preset(path), part)
    except InputError:
        return False
    return True


def _take(panel: Any, preset: Preset, wanted: str) -> None:
    _refuse_unshown(preset)
    found, chosen = _settings_of(preset, wanted)
    if chosen.stream != chosen.name:
        problem = f"{chosen.name}: draws by the stream {chosen.stream}: the panel cannot show that"
        raise preset.place("settings").error(problem, "run it with generate.py")
    with told_once():
        _take_mesh(panel, preset)
        _take_path(panel, preset)
        _take_camera(panel, preset)
        _take_output(panel, preset)
        panel.seed, panel.backend = preset.spec.seed, chosen.backend
        if chosen.name != CLEAN:
            panel.setting_name = chosen.name
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
        if step.levels is not None and step.severity is None and not step.keyed:
            raise place.error(f"{chosen.name}: levels cannot be shown in the panel", "use severity")
    return found, chosen


def _refuse_unshown(preset: Preset, part: Part | None = None) -> None:
    """Refuse content that the panel cannot show, as it would be lost when the preset is saved again.

    part: what is looked at; by default everything.
    """
    spec = preset.spec
    scene = spec.scenes[0]
    trajectory = scene.trajectory
    recording = scene.sequence or scene.video or ""
    asked = {
        "scenes": len(spec.scenes) > 1 and f"holds {len(spec.scenes)} scenes, and the panel shows one",
        "scenes.0.sequence": "stands for several" if "*" in recording
        else part == "PATH" and recording and "is an existing sequence, which has its own path",
        "scenes.0.blend": scene.blend is not None and _not_open(preset, scene),
        "scenes.0.replica": scene.replica is not None and "is looked for under data",
        "only": spec.only != OnlySpec() and "chooses a part of the scenes or settings",
        "scenes.0.mesh": _unshowable(scene.mesh or ""),
        "scenes.0.up": scene.up is not None and f"is {scene.up}",
        "scenes.0.light": scene.light != "none" and f"is {scene.light}",
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
        if problem and (part is None or _belongs(path, part)):
            raise preset.place(path).error(f"{problem}: the panel cannot show that", "run it with generate.py")


def _belongs(key: str, part: Part) -> bool:
    """Tell whether a key is one of a part, or inside one; of `scenes` itself, only their number is asked."""
    return any(key == shown or (shown != "scenes" and key.startswith(f"{shown}.")) for shown in _SHOWN[part])


def _unshowable(mesh: str) -> str:
    """Return why the panel cannot show a mesh, or ""."""
    if not is_embedded(mesh):
        return "stands for several files" if "*" in mesh else ""
    try:
        return "stands for several rooms" if len(room_seeds(mesh)) > 1 else ""
    except ValueError as error:
        return str(error)


def _not_open(preset: Preset, scene: SceneSpec) -> str:
    """Return why the panel cannot show a scene of a .blend, or "": it shows the one that is open."""
    open_scene = bpy.context.scene
    file = Path(path_in(preset.folder, scene.blend or "", preset.place("scenes.0.blend")))
    if file.resolve() not in {path.resolve() for path in scene_copy.known_files(open_scene)}:
        return f"is {file.name}, which is not the file that is open"
    if scene.scene not in (None, open_scene.name):
        return f"has the scene {scene.scene}, and {open_scene.name} is shown"
    if scene.camera not in (None, open_scene.camera and open_scene.camera.name):
        return f"looks through {scene.camera}, which is not the scene's camera"
    shown = this_scene.frame_range(open_scene)
    if scene.frames is not None and scene.frame_range != replace(shown, step=open_scene.frame_step):
        step = scene.frame_range.step if scene.frame_range is not None else 1
        if scene.frame_range != replace(shown, step=step) or step % open_scene.frame_step:
            return f"has the frames {scene.frames}, which are not the scene's"
    return ""


def _take_this_scene(panel: Any, scene: SceneSpec) -> None:
    panel.mesh_source = "SCENE"
    panel.compositing = scene.compositor
    set_value(panel, "depth_alpha", scene.depth_alpha)
    panel.scene_name = scene.name or Path(scene.blend or "").stem


def _take_mesh(panel: Any, preset: Preset) -> None:
    (scene,) = preset.spec.scenes
    if scene.blend is not None:
        _take_this_scene(panel, scene)
        return
    if scene.sequence is not None or scene.video is not None:
        place = preset.place("scenes.0")
        footage.take(panel, scene, lambda text, key: Path(path_in(preset.folder, text, place.at(key))))
        return
    assert scene.mesh is not None
    panel.mesh_source = "ROOM" if is_embedded(scene.mesh) else "FILE"
    if is_embedded(scene.mesh):
        (panel.room_seed,) = room_seeds(scene.mesh)
    else:
        panel.mesh_path = str(path_in(preset.folder, scene.mesh, preset.place("scenes.0.mesh")))
    panel.scene_name = scene.name or (
        room_name(scene.mesh, panel.room_seed) if is_embedded(scene.mesh) else Path(scene.mesh).stem
    )


def _take_path(panel: Any, preset: Preset) -> None:
    (scene,) = preset.spec.scenes
    if footage.is_shown(panel):
        return
    if scene.trajectory is None:
        panel.trajectory_source = "CAMERA"
        step = 1 if scene.frame_range is None else scene.frame_range.step
        panel.every = max(1, step // panel.id_data.frame_step)
        return
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


def _take_camera(panel: Any, preset: Preset) -> None:
    panel.lens_source = "SCENE" if preset.spec.camera is None else "GIVEN"
    panel.recorded_camera = "RECORDED" if preset.spec.camera is None else "GIVEN"
    if preset.spec.camera is None and (this_scene.is_shown(panel) or footage.is_shown(panel)):
        return
    for name, field in CAMERA.items():
        set_value(panel, name, getattr(preset.spec.mesh_camera, field))


def _take_output(panel: Any, preset: Preset) -> None:
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
    clear_entries(panel)
    panel.active_step = 0
    for step in setting.steps:
        if step.perturbation.name in OWN_FIELDS:
            _take_own_motion(panel, step)
        else:
            take_step(panel.steps.add(), step, speed_factor=panel.speed_factor)
    tell("steps")(panel, bpy.context)
