# SPDX-License-Identifier: GPL-3.0-or-later
"""Between the panel and a preset: what the panel holds as the document that generate.py reads, and back."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core.mixture import Identifiers, Step, parse_steps
from ..core.preset import EMBEDDED_ROOM, Preset, check_document
from ..core.schema import Place
from ..perturbations import registry
from .properties import OVERRIDE, parameters_of, perturbation_of

CLEAN = "clean"
PANEL = "Noisy World panel"  # stands for a file's name in messages about what the panel holds
DEVIATION = {"deviation_rotation_deg": "rotation_deg", "deviation_translation_m": "translation_m"}
CAMERA = {
    "width_px": "width", "height_px": "height", "fx_px": "fx", "fy_px": "fy", "cx_px": "cx", "cy_px": "cy",
    "near_m": "near_m", "far_m": "far_m",
}  # fmt: skip
HANDHELD = {
    "handheld_frames": "frames", "handheld_rate_hz": "rate_hz", "handheld_speed_m_s": "speed_m_s",
    "handheld_clearance_m": "clearance_m",
}  # fmt: skip
TRAJECTORY = {"trajectory_pose": "pose", "trajectory_axes": "axes", "trajectory_rate_hz": "rate_hz"}


# --- numbers: Blender's are float32, a preset's are what was typed ---


def value_of(group: Any, name: str) -> Any:
    """Return a property's value as a person would type it: the number remembered, or the shortest decimal."""
    value = getattr(group, name)
    if not isinstance(value, float):
        return value
    remembered = json.loads(group.exact).get(name) if getattr(group, "exact", "") else None
    if remembered is not None and np.float32(remembered) == np.float32(value):
        return remembered
    return float(str(np.float32(value)))


def set_value(group: Any, name: str, value: Any) -> None:
    """Set a property; a number that float32 cannot tell from others is remembered beside it."""
    setattr(group, name, value)
    if isinstance(value, float) and float(str(np.float32(value))) != value:
        group.exact = json.dumps((json.loads(group.exact) if group.exact else {}) | {name: value})


# --- the panel as a document ---


def to_document(settings: Any) -> dict[str, Any]:
    """Return the preset that the panel describes: one scene, the settings clean and, with perturbations, one more.

    Paths are absolute.
    """
    perturb = perturb_of(settings)
    modalities = [name for name in ("rgb", "depth") if getattr(settings, f"use_{name}")]
    return {
        "seed": settings.seed,
        "scenes": [
            {
                "name": settings.scene_name,
                "mesh": EMBEDDED_ROOM if settings.mesh_source == "ROOM" else absolute(settings.mesh_path),
                "trajectory": _trajectory(settings),
            }
        ],
        "camera": {key: value_of(settings, name) for name, key in CAMERA.items()},
        "render": {"engine": settings.engine, "samples": settings.samples, "backend": settings.backend},
        "settings": [{"name": CLEAN}, *([{"name": settings.setting_name, "perturb": perturb}] if perturb else [])],
        "output": {
            "layout": settings.layout,
            "image": settings.image,
            "modalities": modalities,
            "overview": settings.overview,
        },
    }


def absolute(path: str) -> str:
    """Return a path of the panel as an absolute one, with forward slashes; nothing stays nothing."""
    return Path(bpy.path.abspath(path)).resolve().as_posix() if path else ""


def _trajectory(settings: Any) -> dict[str, Any]:
    if settings.trajectory_source == "HANDHELD":
        made: dict[str, Any] = {"handheld": {key: value_of(settings, name) for name, key in HANDHELD.items()}}
    else:
        made = {"file": absolute(settings.trajectory_path)}
        made |= {key: value_of(settings, name) for name, key in TRAJECTORY.items()}
    return made | ({"every": settings.every} if settings.every > 1 else {})


def perturb_of(settings: Any) -> list[dict[str, Any]]:
    """Return what the panel does to a scene, as a preset's `perturb`; what is switched off is left out."""
    found: list[dict[str, Any]] = []
    if settings.speed_factor > 1:
        found.append({"faster_motion": {"factor": settings.speed_factor}})
    if settings.deviation_rotation_deg or settings.deviation_translation_m:
        found.append({"motion_deviation": {key: value_of(settings, name) for name, key in DEVIATION.items()}})
    return found + [{step.perturbation: values_of(step)} for step in settings.steps if step.enabled]


def values_of(step: Any) -> dict[str, Any]:
    """Return an entry of the list as a preset has it."""
    perturbation, group = perturbation_of(step), parameters_of(step)
    names = [item.name for item in fields(perturbation.parameters)]
    values: dict[str, Any] = {}
    if perturbation.severities and (step.use_severity or step.mode == "dynamic"):
        values["severity"] = value_of(step, "severity")
        if step.mode == "dynamic":
            values["mode"] = "dynamic"
        given = [name for name in names if getattr(group, OVERRIDE + name)]
    else:
        defaults = {item.name: item.default for item in fields(perturbation.parameters)}
        given = [name for name in names if value_of(group, name) != defaults[name]]
        if perturbation.severities and not given:
            given = list(perturbation.severities)
    values |= {name: value_of(group, name) for name in given}
    if perturbation.temporals and step.temporal != perturbation.temporals[0]:
        values["temporal"] = step.temporal
    return values


def steps_of(settings: Any) -> tuple[Step, ...]:
    """Return what the panel does to a scene, in propagation order. Raises InputError naming what is wrong."""
    return parse_steps(perturb_of(settings), Place(PANEL, "perturbations"), registry())


def identifiers_of(settings: Any) -> Identifiers:
    """Return what names the random streams of the panel's sequence, as in the generator."""
    return (settings.seed, settings.scene_name, settings.setting_name)


def preset_of(settings: Any, path: Path | None = None) -> Preset:
    """Return the checked preset that the panel describes, as if it were read from `path`.

    Raises InputError naming the key.
    """
    return check_document(to_document(settings), path or Path(PANEL))
