# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's fields of an IMU that the camera carries: a device, where it sits, its rate and its clock."""

from dataclasses import fields
from typing import Any

import bpy

from ..core.presets.preset import ImuSpec, RigSpec, SensorSpec
from .described import described, tell
from .typed_numbers import set_value, value_of

IMU_UPDATE = "imu"  # what listeners are told
PLACE = ("imu_x_m", "imu_y_m", "imu_z_m")
NUMBERS = ("rate_hz", "gravity_m_s2", "time_offset_s", "clock_drift_ppm")
_SHOWN = ("device", "translation_m", *NUMBERS)


def imu_members() -> dict[str, Any]:
    """Return the properties, by name."""
    return {
        "has_imu": bpy.props.BoolProperty(
            options=set(),
            name="IMU",
            description="Write what an inertial measurement unit on the camera measures, and its true states",
            update=tell(IMU_UPDATE),
        ),
        "imu_device": described(ImuSpec, "device", label="IMU Device", update=IMU_UPDATE),
        **{
            name: bpy.props.FloatProperty(
                options=set(),
                name=f"IMU {name[4].upper()}",
                description="Where the IMU sits beside the camera, in the axes of the path's poses",
                subtype="DISTANCE",
                precision=4,
                min=-1e6,
                max=1e6,
                soft_min=-0.5,
                soft_max=0.5,
                update=tell(IMU_UPDATE),
            )
            for name in PLACE
        },
        "imu_rate_hz": described(ImuSpec, "rate_hz", label="IMU Rate", update=IMU_UPDATE, soft_min=50, soft_max=1000),
        "imu_gravity_m_s2": described(ImuSpec, "gravity_m_s2", label="Gravity", update=IMU_UPDATE, soft_max=25),
        "imu_time_offset_s": described(
            ImuSpec, "time_offset_s", label="Time Offset", update=IMU_UPDATE, precision=4, soft_min=0, soft_max=0.1
        ),
        "imu_clock_drift_ppm": described(
            ImuSpec, "clock_drift_ppm", label="Clock Drift", update=IMU_UPDATE, soft_min=-200, soft_max=200
        ),
    }


def rig_of(panel: Any) -> dict[str, Any]:
    """Return the rig as a preset has it: {} without an IMU, else under its key; what is the default is left out."""
    if not panel.has_imu:
        return {}
    place = [value_of(panel, name) for name in PLACE]
    given: dict[str, Any] = {"device": panel.imu_device} | ({"translation_m": place} if any(place) else {})
    defaults = {item.name: item.default for item in fields(ImuSpec)}
    for name in NUMBERS:
        if (value := value_of(panel, f"imu_{name}")) != defaults[name]:
            given[name] = value
    return {"rig": {"imu": given}}


def unshown_rig(rig: RigSpec | None) -> dict[str, str | bool]:
    """Return by key what the panel cannot show of a rig; False for nothing."""
    if rig is None:
        return {}
    if rig.imu is None or rig.rgb != SensorSpec() or rig.depth is not None:
        return {"rig": "places sensors on a robot"}
    given = (item.name for item in fields(rig.imu) if getattr(rig.imu, item.name) != item.default)
    return {f"rig.imu.{name}": "is given" for name in given if name not in _SHOWN}


def take_rig(panel: Any, rig: RigSpec | None) -> None:
    """Set the panel from a preset's rig that it can show; None for none."""
    panel.has_imu = rig is not None
    if rig is None or rig.imu is None:
        return
    panel.imu_device = rig.imu.device
    for name, value in zip(PLACE, rig.imu.translation_m, strict=True):
        set_value(panel, name, value)
    for name in NUMBERS:
        set_value(panel, f"imu_{name}", getattr(rig.imu, name))


def draw_imu(layout: bpy.types.UILayout, panel: Any) -> None:
    """Draw the fields."""
    layout.prop(panel, "has_imu")
    if not panel.has_imu:
        return
    layout.prop(panel, "imu_device")
    for names in (PLACE, [f"imu_{name}" for name in NUMBERS]):
        column = layout.column(align=True)
        for name in names:
            column.prop(panel, name)
