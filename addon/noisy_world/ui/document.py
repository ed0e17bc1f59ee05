# SPDX-License-Identifier: GPL-3.0-or-later
"""Converting the panel's content into a preset's document, which generate.py reads, and back."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS
from ..core.datasets.layouts import OutputFormat
from ..core.datasets.storage import storage_errors, write_atomic
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.perturbing.contexts import Identifiers
from ..core.perturbing.execution import chosen_poses, split_motion
from ..core.perturbing.kinds import MotionPerturbation
from ..core.perturbing.reading import parse_steps
from ..core.perturbing.steps import Step, steps_of_kind
from ..core.presets.output import OutputSpec
from ..core.presets.preset import EngineName, Preset, check_document
from ..core.schema import ConfigPath, unknown_name
from ..core.yaml_reading import yaml_text
from ..perturbations import registry
from ..planning import make_plan
from . import footage, scene_copy, this_scene
from .imu_fields import rig_of
from .keyed import curve_ends, curve_of, levels_of
from .lens_fields import distortion_of
from .output_place import absolute
from .properties import OVERRIDE, parameters_of, perturbation_of
from .shown_sources import shown
from .typed_numbers import value_of

CLEAN = "clean"
HEADING = "# Made in Blender's sidebar by Noisy World; headless/generate.py makes the same dataset from it."
PANEL = "Noisy World panel"  # used like a file's name in messages about the panel's content
DEVIATION = {"deviation_rotation_deg": "rotation_deg", "deviation_translation_m": "translation_m"}
OWN_FIELDS = ("motion_deviation", "faster_motion")  # perturbations that the panel has fields for, beside its list
CAMERA = {
    "width_px": "width", "height_px": "height", "fx_px": "fx", "fy_px": "fy", "cx_px": "cx", "cy_px": "cy",
    "near_m": "near_m", "far_m": "far_m",
}  # fmt: skip
NO_BODY = "NONE"
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
    """Return the preset that the panel describes: one scene, clean where it is asked for, and with perturbations.

    Paths are absolute, or relative to `folder` if they are inside it.
    """
    perturb = perturb_of(panel)
    source = shown(panel)
    modalities = [name for name in CHANNELS if getattr(panel, f"use_{name}")]
    return {
        "seed": panel.seed,
        "scenes": [scene_of(panel, folder)],
        **({"camera": camera_of(panel) | _lens(panel)} if source.gives_lens(panel) else {}),
        **(rig_of(panel) if source.carries else {}),
        "render": {
            **({"engine": engine_of(panel), "samples": panel.samples} if source.gives_render(panel) else {}),
            "backend": panel.backend,
        },
        "settings": settings_of(panel, perturb),
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


def settings_of(panel: Any, perturb: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the settings that the panel describes: clean alone where nothing is perturbed."""
    clean: list[dict[str, Any]] = [{"name": CLEAN}]
    if not perturb:
        return clean
    return [*(clean if panel.use_clean else []), {"name": panel.setting_name, "perturb": perturb}]


def engine_of(panel: Any) -> EngineName:
    """Return the engine that the panel gives. Raises InputError where a file chose one that this Blender lacks."""
    if not panel.engine:
        problem = "this file chose Embree, which needs the Python package embreex in Blender"
        raise InputError(PANEL, problem, where="render.engine", remedy="choose another engine, or install it")
    return panel.engine


def format_of(panel: Any) -> OutputFormat:
    """Return the format of the dataset that the panel describes."""
    scale_per_m = value_of(panel, "depth_scale_per_m")
    output = OutputSpec(panel.layout, panel.image, panel.colour, scale_per_m, panel.depth_beyond)
    return output.format


def scene_of(panel: Any, folder: Path | None = None) -> dict[str, Any]:
    """Return the panel's scene as a preset has it."""
    source = shown(panel)
    path = {"trajectory": _trajectory(panel, folder)} if source.has_path(panel) else {}
    return {"name": panel.scene_name, **source.entry(panel, lambda path: _path(path, folder)), **path}


def recorded(panel: Any) -> footage.Footage:
    """Return the recording that the panel names. Raises InputError."""
    camera = {"camera": camera_of(panel)} if shown(panel).gives_lens(panel) else {}
    document = {"seed": 0, "scenes": [scene_of(panel)], **camera, "settings": [{"name": CLEAN}]}
    return footage.footage_of(check_document(document, Path(PANEL)))


def camera_of(panel: Any) -> dict[str, Any]:
    """Return the panel's camera as a preset has it."""
    return {key: value_of(panel, name) for name, key in CAMERA.items()}


def _lens(panel: Any) -> dict[str, Any]:
    """Return the lens of the camera; a recording's is said of its scene."""
    source = shown(panel)
    return distortion_of(panel, rendered=source.loads) if source.distorts and not source.own_distortion else {}


def _path(path: str, folder: Path | None) -> str:
    whole = absolute(path)
    if folder is None or not whole or not Path(whole).is_relative_to(folder.resolve()):
        return whole
    return Path(whole).relative_to(folder.resolve()).as_posix()


def _trajectory(panel: Any, folder: Path | None) -> dict[str, Any]:
    if panel.trajectory_source != "FILE":
        made: dict[str, Any] = {"handheld": {key: value_of(panel, name) for name, key in HANDHELD.items()}}
    else:
        made = {"file": _path(panel.trajectory_path, folder)}
        made |= {key: value_of(panel, name) for name, key in TRAJECTORY.items()}
    if panel.body != NO_BODY:
        made["body"] = {"kind": panel.body, "motion": value_of(panel, "body_motion")}
    return made | ({"every": panel.every} if panel.every > 1 else {})


def perturb_of(panel: Any) -> list[dict[str, Any]]:
    """Return what the panel does to a scene, as a preset's `perturb`; what is switched off is left out."""
    listed = []
    for step in panel.steps:
        if step.enabled and step.perturbation not in registry():
            raise unknown_name(ConfigPath(PANEL, "perturbations"), "perturbation", step.perturbation, list(registry()))
        if step.enabled:
            listed.append({step.perturbation: values_of(step)})
    return own_motion(panel) + listed


def own_motion(panel: Any) -> list[dict[str, Any]]:
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
        values |= _severity_of(step)
        by_severity = {name for name in perturbation.severities if not getattr(group, OVERRIDE + name)}
        given = [
            name for name in defaults if name not in by_severity and (name in perturbation.severities or name in given)
        ]
    elif perturbation.severities and not given:
        given = list(perturbation.severities)  # at least these, as without any key a preset means severity 3
    values |= {name: value_of(group, name) for name in given}
    for item in fields(perturbation.parameters):
        if item.metadata["key"].file is not None and values.get(item.name):
            values[item.name] = absolute(values[item.name])
    if perturbation.temporals and step.temporal != perturbation.temporals[0]:
        values["temporal"] = step.temporal
    return values


def _severity_of(step: Any) -> dict[str, Any]:
    """Return an entry's severity as a preset has it: one, drawn for each frame, or of each frame as it is keyed."""
    levels = levels_of(step, _keyed_frames(step))
    if levels is not None:
        return {"mode": "keyed", "levels": levels} if len(levels) > 1 else {"severity": levels[0]}
    values = {"severity": value_of(step, "severity")}
    return values | {"mode": "dynamic"} if step.mode == "dynamic" else values


def _keyed_frames(step: Any) -> NDArray[np.int64] | None:
    """Return the scene frames that the sequence shows, as far as an entry's severity is keyed; None for all from 0."""
    curve = curve_of(step)
    ends = None if curve is None else curve_ends(curve)
    if ends is None:
        return None
    scene = step.id_data
    _, choosing = split_motion(motion_of(scene.noisy_world))
    count = max(1 + math.ceil(ends[1]) * max(1, scene.noisy_world.speed_factor), scene.frame_end + 1)
    shown = chosen_poses(choosing, count, identifiers_of(scene.noisy_world))
    frames = this_scene.scene_frames(scene, count)
    return np.asarray(frames if shown is None else frames[shown], np.int64)


def steps_of(panel: Any) -> tuple[Step, ...]:
    """Return what the panel does to a scene, in propagation order. Raises InputError naming what is wrong."""
    return parse_steps(perturb_of(panel), ConfigPath(PANEL, "perturbations"), registry())


def motion_of(panel: Any) -> tuple[Step[MotionPerturbation], ...]:
    """Return the steps that act on the path, in propagation order, even if other steps are wrong."""
    perturb = own_motion(panel) + listed_motion(panel)
    return steps_of_kind(parse_steps(perturb, ConfigPath(PANEL, "motion"), registry()), MotionPerturbation)


def intrinsics_of(panel: Any) -> Intrinsics:
    """Return the panel's camera; that of the scene or the recording where it holds. Raises InputError without one."""
    if footage.is_shown(panel):
        return recorded(panel).camera
    if not shown(panel).gives_lens(panel):
        return this_scene.intrinsics_of_scene(panel.id_data)
    return Intrinsics(*(value_of(panel, name) for name in INTRINSICS))


def identifiers_of(panel: Any) -> Identifiers:
    """Return the identifiers of the random streams of the panel's sequence, as in the generator."""
    return (panel.seed, panel.scene_name, panel.setting_name)


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
    if this_scene.is_shown(panel):
        this_scene.check(panel.id_data)
        said = scene_copy.ensure(panel.id_data, path.with_suffix(".blend"))
    preset = preset_of(panel, path)
    make_plan(preset)  # raises for a preset that cannot be generated, which is then not saved
    text = yaml_text(preset.document)
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, f"{HEADING}\n{text}".encode(), path.parent)
    panel.preset_path = str(path)
    panel.preset_settings = "\n".join(item["name"] for item in preset.document["settings"])
    return said
