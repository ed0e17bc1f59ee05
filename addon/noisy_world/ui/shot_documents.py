# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot as a preset's document: what Generate would make if the scene and the panel were as the shot says."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import InputError, NoisyWorldError
from ..core.perturbing.reading import parse_settings
from ..core.perturbing.steps import Setting
from ..core.perturbing.sweeps import swept
from ..core.presets.preset import Preset, check_document, read_preset
from ..core.presets.settings import SettingSpec
from ..core.schema import ConfigPath
from ..perturbations import registry
from . import scene_copy, this_scene
from .apply_preset import setting_of, show_setting
from .described import notify_once
from .document import CLEAN, PANEL, perturb_of, to_document
from .keyed import curve_of
from .output_place import absolute, folder_of
from .properties import panel_of
from .shot_fields import OWN_LIST, PANEL_LIST, PRESET_LIST
from .step_list import RATE, own_rate_hz

WHERE = "Shots"


def problem(shot: Any, text: str, remedy: str) -> InputError:
    """Return an error about a shot."""
    return InputError(WHERE, f"{shot.name or 'a shot'} {text}", remedy=remedy)


def chosen_shots(panel: Any) -> list[Any]:
    """Return the shots that are taken. Raises InputError where there are none, or two share a name or a folder."""
    shots = [shot for shot in panel.shots if shot.enabled]
    if not shots:
        raise InputError(WHERE, "none is there or switched on", remedy="add one")
    names: dict[str, Any] = {}
    folders: dict[Path, Any] = {}
    for shot in shots:
        if not shot.name.strip():
            raise problem(shot, "has no name", "give it one")
        if shot.name in names:
            raise problem(shot, "is the name of two shots", "rename one")
        folder = shot_folder(shot)
        if folder in folders:
            raise problem(shot, f"has the folder of {folders[folder].name}", "choose another under Output")
        names[shot.name] = folders[folder] = shot
    return shots


def shot_folder(shot: Any) -> Path:
    """Return the folder of a shot's dataset. Raises InputError where it names none."""
    return folder_of(shot.output_folder, f"{WHERE} > {shot.name} > Output")


def preset_of_shot(scene: bpy.types.Scene, shot: Any) -> Preset:
    """Return the checked preset of a shot, as Generate would write it for a scene and a panel that say what it says.

    Raises InputError naming the shot where its camera, frames or perturbations cannot be had.
    """
    panel = panel_of(scene)
    blend = scene_copy.blend_file(scene)  # of the scene as it is: the timeline that follows is put back
    own = _own_settings(panel, shot)
    with _as_in(scene, shot):
        try:
            this_scene.check(scene)
            document = to_document(panel)  # with the severities that are keyed in the shot's frames
        except NoisyWorldError as error:
            raise InputError(f"{WHERE} > {shot.name}", error.message) from error
    step = scene.frame_step * panel.every
    frames = f"{shot.frame_start}:{shot.frame_end}" + (f":{step}" if step > 1 else "")
    document["scenes"][0] |= {"blend": str(blend), "camera": shot.camera.name, "frames": frames}
    document |= {"seed": shot.seed} | ({"settings": own} if own else {})
    return check_document(document, Path(PANEL))


@contextmanager
def _as_in(scene: bpy.types.Scene, shot: Any) -> Iterator[None]:
    """Let the scene have a shot's camera and frames, and put its own back."""
    if shot.camera is None or shot.camera.name not in scene.objects:
        raise problem(shot, "has no camera of this scene", "choose one")
    if shot.frame_end < shot.frame_start:
        raise problem(shot, f"ends at frame {shot.frame_end}, before it begins", "choose a later last frame")
    before = scene.camera, scene.frame_start, scene.frame_end
    try:
        scene.camera, scene.frame_start, scene.frame_end = shot.camera, shot.frame_start, shot.frame_end
        yield
    finally:
        scene.camera, scene.frame_start, scene.frame_end = before


# --- perturbations ---


def kept_list(panel: Any) -> str:
    """Return what the panel does to a scene as a text that a shot can hold; "" where a severity is keyed."""
    if any(step.enabled and curve_of(step) is not None for step in panel.steps):
        return ""  # a curve belongs to the timeline
    return json.dumps({"name": panel.setting_name, "perturb": perturb_of(panel)}, ensure_ascii=False)


def _own_settings(panel: Any, shot: Any) -> list[dict[str, Any]]:
    """Return the settings of a shot that does not take the panel's list; [] where it does."""
    if shot.perturbations == PANEL_LIST:
        return []
    setting = _own(shot) if shot.perturbations == OWN_LIST else _preset_setting(shot)
    clean: list[dict[str, Any]] = [{"name": CLEAN}]
    return [*(clean if panel.use_clean else []), setting] if setting["perturb"] else clean


def _preset_setting(shot: Any) -> dict[str, Any]:
    """Return the setting that a shot takes from a preset, as a preset has it; one of a sweep is written out."""
    preset, chosen = _of_preset(shot)
    for spec, place in zip(preset.spec.settings, preset.setting_places, strict=True):
        if spec.sweep is None:
            made = [(spec.name, spec.stream, list(spec.perturb))]
        else:
            found = swept(spec.sweep, place.at("sweep"), registry())
            made = [(name, stream, [step]) for name, stream, step, _ in found]
        for name, stream, perturb in made:
            if name == chosen.name:
                drawn_by = {} if stream is None else {"stream": stream}
                timed = [with_rate(panel_of(shot.id_data), step) for step in perturb]
                return {"name": name, "perturb": timed, "backend": chosen.backend, **drawn_by}
    raise AssertionError(f"{chosen.name} is one of the preset's settings")


def with_rate(panel: Any, step: dict[str, Any]) -> dict[str, Any]:
    """Return a preset's step with the rate of the scene's frames, where it counts time and gives no rate of its own."""
    ((name, values),) = step.items()
    kind, rate_hz = registry().get(name), own_rate_hz(panel)
    if kind is None or rate_hz is None or RATE in (values or {}) or not hasattr(kind.parameters, RATE):
        return step
    return {name: {**(values or {}), RATE: rate_hz}}


def _own(shot: Any) -> dict[str, Any]:
    if not shot.own_list:
        raise problem(shot, "has no list of its own yet", "press Keep List")
    return json.loads(shot.own_list)


def _of_preset(shot: Any) -> tuple[Preset, Setting]:
    if not shot.preset:
        raise problem(shot, "names no preset", "choose one")
    preset = read_preset(Path(absolute(shot.preset)))
    return preset, setting_of(preset, shot.setting)


def show_shot(scene: bpy.types.Scene, shot: Any) -> str:
    """Set scene and panel as a shot says, so that previews show it; return what was done. Raises InputError."""
    panel = panel_of(scene)
    chosen = _shown_setting(shot)
    with _as_in(scene, shot):
        pass  # raises for what cannot be shown, before anything changes
    with notify_once():
        scene.camera, scene.frame_start, scene.frame_end = shot.camera, shot.frame_start, shot.frame_end
        panel.seed = shot.seed
        if chosen is not None:
            show_setting(panel, chosen)
    if not shot.frame_start <= scene.frame_current <= shot.frame_end:
        scene.frame_set(shot.frame_start)
    took = "" if chosen is None else ", and its perturbations are in the list"
    return f"{shot.name}: camera, frames and seed are the shot's{took}"


def _shown_setting(shot: Any) -> Setting | None:
    """Return the setting that a shot has of its own; None where it has the panel's list."""
    if shot.perturbations == PRESET_LIST:
        return _of_preset(shot)[1]
    if shot.perturbations == PANEL_LIST:
        return None
    own = _own(shot)
    spec = SettingSpec(name=own["name"], perturb=tuple(own["perturb"]))
    (found,) = parse_settings([spec], [ConfigPath(PANEL, "settings.0")], registry(), panel_of(shot.id_data).backend)
    return found
