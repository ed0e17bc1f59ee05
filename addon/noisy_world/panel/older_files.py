# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that were saved by older versions, whose panel was a list of fields: their values are taken over."""

import json
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..channels import CHANNELS
from ..perturbations import registry
from .properties import LOADED, OWN_SLIDERS, panel_of
from .tree import GIVEN, property_name, set_value, taking

OVERRIDE = "override_"
MOVED: dict[str, str] = {
    "scene_name": "scene.name", "mesh_path": "of_mesh.mesh", "depth_alpha": "of_blend.depth_alpha",
    "sequence_path": "of_sequence.sequence.folder", "recorded_layout": "of_sequence.layout",
    "recorded_poses": "of_sequence.poses", "recorded_rate_hz": "of_sequence.rate_hz",
    "undistort": "of_sequence.undistort", "register_depth": "of_sequence.register",
    "recorded_void": "of_sequence.void", "recorded_depth_scale_per_m": "of_sequence.depth_scale_per_m",
    "video_path": "of_video.video", "video_depth_path": "of_video.depth",
    "video_depth_scale_per_m": "of_video.depth_scale_per_m", "every": "scene.trajectory.every",
    **{f"handheld_{name}": f"scene.trajectory.handheld.{name}"
       for name in ("frames", "rate_hz", "speed_m_s", "clearance_m")},
    "trajectory_path": "scene.trajectory.file",
    **{f"trajectory_{name}": f"scene.trajectory.{name}"
       for name in ("format", "pose", "axes", "rate_hz", "stamp_unit")},
    "body_motion": "scene.trajectory.body.motion",
    **{f"{name}_px": f"camera.{name}" for name in ("width", "height", "fx", "fy", "cx", "cy")},
    "near_m": "camera.near_m", "far_m": "camera.far_m", "distorts": "camera.use_distortion",
    **{f"distortion_{name}": f"camera.distortion.{name}"
       for name in ("model", "undistort", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")},
    "has_imu": "rig.use_imu",
    **{f"imu_{name}": f"rig.imu.{name}"
       for name in ("device", "rate_hz", "gravity_m_s2", "time_offset_s", "clock_drift_ppm")},
    "engine": "render.engine", "backend": "render.backend", "samples": "render.samples",
    "layout": "output.layout", "image": "output.image", "colour": "output.colour",
    "depth_scale_per_m": "output.depth_scale_per_m", "depth_beyond": "output.depth_beyond",
    "overview": "output.overview", "setting_name": "setting.name",
}  # fmt: skip
"""Where the fields of the panel are now."""

BODIES = (None, "walker", "runner", "quadruped", "rover", "drone")
ABSENT = {"of_sequence.rate_hz", "of_sequence.depth_scale_per_m"}
"""Fields whose 0 said that they were not given."""


@persistent
def _on_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        stored = scene.bl_system_properties_get()
        if scene.library is None and stored is not None and "noisy_world" in stored:
            values = stored["noisy_world"]
            take_fields(panel_of(scene), values)
            take_degrees(panel_of(scene), values)


def take_fields(panel: Any, stored: Any) -> None:
    """Take the fields that are stored beside the tree into it. stored: the values as the file holds them."""
    if "seed" in stored and "use_seed" not in stored:
        panel.use_seed = True
    old = {name: value for name, value in stored.items() if name in (*MOVED, *_SPECIAL)}
    if not old and not any(name.startswith(OVERRIDE) for step in stored.get("steps", ()) for name in _names(step)):
        return
    exact = json.loads(stored.get("exact") or "{}")
    for name, path in MOVED.items():
        if name in old and not (path in ABSENT and not old[name]):
            _put(panel, path, exact.get(name, old[name]))
    for name, set_it in _SPECIAL.items():
        if name in old:
            set_it(panel, old[name])
    shown = [name for name, item in CHANNELS.items() if stored.get(f"use_{name}", name in ("rgb", "depth"))]
    panel.output.modalities = set(shown)
    for step, values in zip(panel.steps, stored.get("steps", ()), strict=False):
        for name in registry():
            if name in values:
                _take_overrides(getattr(step, name), values[name], name)
    for name in old:
        del stored[name]


def _take_overrides(group: Any, values: Any, name: str) -> None:
    """Tick what an entry's parameters gave: what was set by hand."""
    for item in fields(registry()[name].parameters):
        held = property_name(item.name)
        by_severity = item.name in registry()[name].severities
        given = values.get(OVERRIDE + item.name, False) if by_severity else held in values
        with taking():
            setattr(group, GIVEN + item.name, bool(given))


def _names(group: Any) -> Iterator[str]:
    for name, value in group.items():
        yield name
        if hasattr(value, "items"):
            yield from _names(value)


def _put(panel: Any, path: str, value: Any) -> None:
    """Set a property of the tree; what is not a property's any more stays out."""
    owner, _, name = path.rpartition(".")
    group = panel.path_resolve(owner) if owner else panel
    held = group.bl_rna.properties[property_name(name)]
    if held.type == "ENUM":
        value = next((item.identifier for item in held.enum_items if item.value == value), held.default)
    elif held.type == "BOOLEAN":
        value = bool(value)
    elif held.type == "FLOAT" and not held.is_array:
        value = float(str(np.float32(value)))
    set_value(group, name, value)


def _take_camera(panel: Any, value: int) -> None:
    panel.use_camera = panel.mesh_source in LOADED or value == 1


def _take_render(panel: Any, value: int) -> None:
    given = panel.mesh_source in LOADED or value == 1
    panel.render.use_engine = panel.render.use_samples = given


def _take_body(panel: Any, value: int) -> None:
    path = panel.scene.trajectory
    kind = BODIES[value] if value < len(BODIES) else None
    path.use_body = kind is not None
    if kind is not None:
        path.body.kind = kind


def _take_slider(name: str) -> Any:
    return lambda panel, value: setattr(panel, name, value) if value else None


def _take_place(axis: int) -> Any:
    def take(panel: Any, value: float) -> None:
        place = list(panel.rig.imu.translation_m)
        place[axis] = value
        set_value(panel.rig.imu, "translation_m", [float(str(np.float32(each))) for each in place])

    return take


_SPECIAL: dict[str, Any] = {
    "lens_source": _take_camera, "recorded_camera": _take_camera, "render_source": _take_render, "body": _take_body,
    **{name: _take_slider(name) for name in OWN_SLIDERS},
    **{f"imu_{axis}_m": _take_place(place) for place, axis in enumerate("xyz")},
}  # fmt: skip


def take_degrees(panel: Any, stored: Any) -> None:
    """Take the angles that are stored in degrees into the panel. stored: the values as the file holds them."""
    for step, values in zip(panel.steps, stored.get("steps", ()), strict=False):
        for name, perturbation in registry().items():
            for item in fields(perturbation.parameters):
                if item.name.endswith("_deg") and name in values and item.name in values[name]:
                    set_value(getattr(step, name), item.name, float(str(np.float32(values[name][item.name]))))
                    del values[name][item.name]
    if "deviation_rotation_deg" in stored:
        panel.deviation_rotation = np.radians(float(str(np.float32(stored["deviation_rotation_deg"]))))
        del stored["deviation_rotation_deg"]


def register() -> None:
    """Register the handler of files that are opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister() -> None:
    """Unregister it."""
    bpy.app.handlers.load_post.remove(_on_load)
