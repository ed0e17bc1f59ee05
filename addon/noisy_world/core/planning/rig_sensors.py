# SPDX-License-Identifier: GPL-3.0-or-later
"""The sensors of a robot as a preset says them: where they sit, and what measures depth."""

from typing import Any

from ..perturbing.kinds import DepthPerturbation
from ..perturbing.reading import Registry, parse_sensor
from ..perturbing.steps import Setting, Step
from ..presets.preset import Preset, SensorSpec
from ..schema import ConfigPath
from ..trajectories.rig import Rig, Sensor, sensor_from_extrinsics
from ..trajectories.trajectory import Axes


def depth_sensor(preset: Preset, registry: Registry) -> tuple[Step[DepthPerturbation], ...]:
    """Return the step by which a rig's depth sensor measures; none where depth is exact."""
    rig = preset.spec.rig
    if rig is None or rig.depth is None or rig.depth.sensor is None:
        return ()
    return (parse_sensor(rig.depth.sensor, preset.place("rig").at("depth").at("sensor"), registry),)


def check_sensors(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse perturbations that need colour and depth from one pose, where the sensors have two."""
    rig = preset.spec.rig
    if rig is None or rig.depth is None or rig.depth.shares_place(rig.rgb):
        return
    at_depth = preset.place("rig").at("depth")
    for setting in settings:
        for step in setting.sensor:
            if step.perturbation.needs_rgb:
                raise at_depth.at("sensor").error(
                    f"{step.perturbation.name} needs the colour that it sees, but rig.depth has another pose",
                    "give rig.depth the pose of rig.rgb",
                )
        if setting.needs_depth or setting.needs_rgb:
            seen = "depth that the colour camera" if setting.needs_depth else "colour that the depth sensor"
            raise preset.place("settings").error(
                f"{setting.name}: needs the {seen} sees, but rig.depth has another pose",
                "take that setting out, or rig.depth",
            )


def read_rig(preset: Preset, axes: set[Axes]) -> Rig | None:
    """Return the robot's sensors, None without a rig. axes: in which the scenes' trajectories are declared.

    Raises InputError where a pose is none, or axes differ.
    """
    spec = preset.spec.rig
    if spec is None:
        return None
    place = preset.place("rig")
    if len(axes) > 1:
        raise place.error(f"the scenes' trajectories declare different axes ({', '.join(sorted(axes))})", "use one")
    (robot_axes,) = axes
    apart = spec.depth is not None and not spec.depth.shares_place(spec.rgb)
    depth = _sensor(spec.depth, robot_axes, place.at("depth")) if spec.depth is not None and apart else None
    return Rig(_sensor(spec.rgb, robot_axes, place.at("rgb")), depth)


def _sensor(spec: SensorSpec, robot_axes: Axes, place: ConfigPath) -> Sensor:
    given: dict[str, Any] = {
        "quat_wxyz": spec.quat_wxyz,
        "rotation_euler_deg": spec.rotation_euler_deg,
        "matrix": spec.matrix,
    }
    if spec.matrix is None:
        given["translation_m"] = spec.translation_m
    try:
        return sensor_from_extrinsics(**given, robot_axes=robot_axes)
    except ValueError as error:
        raise place.error(str(error)) from error
