# SPDX-License-Identifier: GPL-3.0-or-later
"""The sensors of a robot as a preset says them: where they sit, and what measures depth."""

from collections.abc import Sequence as Many
from dataclasses import replace
from typing import Any

from ..inertial.imu import MOST_SAMPLES, Imu
from ..perturbing.kinds import DepthPerturbation
from ..perturbing.reading import Registry, is_sensor, parse_sensor
from ..perturbing.steps import Setting, Step, steps_of_kind
from ..presets.preset import ImuSpec, Preset, SensorSpec
from ..schema import ConfigPath
from ..trajectories.rig import Rig, Sensor, sensor_from_extrinsics
from ..trajectories.rounding import rounded_poses
from ..trajectories.stamps import NS_PER_S, FrameStamps
from ..trajectories.trajectory import Axes
from .scene import Scene


def depth_sensor(preset: Preset, registry: Registry) -> tuple[Step[DepthPerturbation], ...]:
    """Return the step by which a rig's depth sensor measures; none where depth is exact."""
    rig = preset.spec.rig
    if rig is None or rig.depth is None or rig.depth.sensor is None:
        return ()
    return (parse_sensor(rig.depth.sensor, preset.place("rig").at("depth").at("sensor"), registry),)


def check_sensors(settings: tuple[Setting, ...], preset: Preset) -> None:
    """Refuse depth that is measured twice, and what needs colour and depth from one pose where the sensors have two."""
    rig = preset.spec.rig
    for setting in settings:
        own = steps_of_kind(setting.steps, DepthPerturbation)
        measured = [step.perturbation for step in (*setting.sensor, *own) if is_sensor(step.perturbation)]
        if setting.sensor and len(measured) > 1:
            problem = f"{setting.name}: {measured[1].name} measures depth, which rig.depth.sensor has measured"
            raise preset.place("settings").error(problem, "keep one of them")
    if rig is None or rig.depth is None or rig.depth.shares_place(rig.rgb):
        return
    if rig.depth.has_camera or rig.depth.registered:
        return  # what lies between the cameras is known, so each image can be had as the other camera sees it
    at_depth = preset.place("rig").at("depth")
    for setting in settings:
        for step in setting.sensor:
            if step.perturbation.needs_rgb:
                raise at_depth.at("sensor").error(
                    f"{step.perturbation.name} needs the colour that it sees, but rig.depth has another pose",
                    "give rig.depth the pose of rig.rgb, or registered: true",
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
    imu = None if spec.imu is None else _imu(spec.imu, robot_axes, place.at("imu"))
    return Rig(_sensor(spec.rgb, robot_axes, place.at("rgb")), depth, imu)


def check_imu(rig: Rig, settings: tuple[Setting, ...], scenes: Many[Scene], preset: Preset) -> None:
    """Refuse an IMU on paths that have no acceleration, and stamps before 0, which no file of a layout can say."""
    if rig.imu is None:
        return
    place = preset.place("rig").at("imu")
    for setting in settings:
        moving = [step.perturbation for step in setting.motion if step.severity != 0]
        for kind in moving:
            if kind.apply is not None and not kind.continuous:
                raise place.error(
                    f"{setting.name}: {kind.name} moves each pose by itself, so its path has no finite acceleration",
                    "take one of them out; vibration, drift and jerk deviate along a smooth path",
                )
    for scene in scenes:
        stamps_ns = FrameStamps.of(scene.source.frame_stamps).rgb.ns
        numbers = rig.imu.sample_numbers((stamps_ns[-1] - stamps_ns[0]) / NS_PER_S)
        if (first_ns := stamps_ns[0] + round(numbers.start / rig.imu.rate_hz * NS_PER_S)) < 0:
            problem = f"puts the IMU's first stamp on {scene.name} at {first_ns / NS_PER_S:g} s, before 0"
            raise place.at("time_offset_s").error(problem, "use 0 or more, or a path with later stamps")
        if len(numbers) > MOST_SAMPLES:
            problem = f"makes {len(numbers):,} samples along {scene.name}, more than {MOST_SAMPLES:,}"
            raise place.at("rate_hz").error(problem, "use a lower one")


def _imu(spec: ImuSpec, robot_axes: Axes, place: ConfigPath) -> Imu:
    turned = spec.quat_wxyz or spec.rotation_euler_deg or spec.matrix
    with_axes = spec if turned else replace(spec, quat_wxyz=(1.0, 0.0, 0.0, 0.0))  # the robot's
    return Imu(
        _sensor(with_axes, robot_axes, place).robot_from_sensor,
        spec.model,
        spec.rate_hz,
        spec.gravity_m_s2,
        spec.time_offset_s,
        spec.clock_drift_ppm,
    )


def _sensor(spec: SensorSpec, robot_axes: Axes, place: ConfigPath) -> Sensor:
    given: dict[str, Any] = {
        "quat_wxyz": spec.quat_wxyz,
        "rotation_euler_deg": spec.rotation_euler_deg,
        "matrix": spec.matrix,
    }
    if spec.matrix is None:
        given["translation_m"] = spec.translation_m
    try:
        found = sensor_from_extrinsics(**given, robot_axes=robot_axes)
    except ValueError as error:
        raise place.error(str(error)) from error
    return Sensor(rounded_poses(found.robot_from_sensor))
