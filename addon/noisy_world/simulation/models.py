# SPDX-License-Identifier: GPL-3.0-or-later
"""The bodies in MJCF: a quadruped of 8 kg and a four-wheeled rover of 11 kg, on a floor that may be rough."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]
SimulatedKind: TypeAlias = Literal["quadruped", "rover"]

STEP_S = 0.002  # of the simulation
THIGH_M, SHANK_M, FOOT_M = 0.16, 0.16, 0.03
STANCE_M = 0.25  # from the hip to the floor while a leg stands
HIP_X_M, HIP_Y_M = 0.16, 0.13
WHEEL_M, WHEEL_X_M, WHEEL_Y_M = 0.10, 0.17, 0.2
LEGS = ("front_left", "front_right", "rear_left", "rear_right")
CELL_M = 0.05  # of a rough floor

_LEG = """
      <body name="{name}" pos="{x} {y} 0">
        <joint name="{name}_roll" axis="1 0 0" damping="1" armature="0.01"/>
        <joint name="{name}_hip" axis="0 1 0" damping="1" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -{thigh}" size="0.02" mass="0.4" contype="0" conaffinity="0"/>
        <body pos="0 0 -{thigh}">
          <joint name="{name}_knee" axis="0 1 0" damping="1" armature="0.01"/>
          <geom type="capsule" fromto="0 0 0 0 0 -{shank}" size="0.015" mass="0.2" contype="0" conaffinity="0"/>
          <geom name="{name}_foot" type="sphere" pos="0 0 -{shank}" size="{foot}" mass="0.05" friction="1.2"/>
        </body>
      </body>"""
_WHEEL = """
      <body name="{name}" pos="{x} {y} 0">
        <joint name="{name}_axle" axis="0 1 0" damping="0.05"/>
        <geom type="ellipsoid" size="{radius} 0.03 {radius}" mass="0.5" friction="0.9"/>
      </body>"""
_WORLD = """<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{step}" integrator="implicitfast"{contacts}/>
  <asset>
    <hfield name="floor" nrow="{rows}" ncol="{columns}" size="{half_x} {half_y} {high} 0.1"/>
  </asset>
  <worldbody>
    <geom type="hfield" hfield="floor" pos="{x} {y} {low}" friction="1"/>
    <body name="trunk" pos="{start_x} {start_y} {start_z}" quat="{quat}">
      <freejoint/>
      <geom type="box" size="{trunk}" mass="{mass}"/>
      <site name="camera" pos="{camera}"/>{parts}
    </body>
  </worldbody>
  <actuator>{actuators}
  </actuator>
  <sensor>
    <accelerometer site="camera"/>
    <gyro site="camera"/>
  </sensor>
</mujoco>
"""


@dataclass(frozen=True, eq=False)
class Floor:
    """A floor around a route. heights_m: (R, C) above its level, rows along y; corner_m: (2,) of the first cell."""

    heights_m: Float64
    corner_m: Float64
    level_m: float


def rough_floor(route_m: Float64, level_m: float, roughness_m: float, rng: np.random.Generator) -> Floor:
    """Return a floor around a route (N, 2), whose heights are normal, smooth over 15 cm, of this standard deviation."""
    import cv2

    corner_m = route_m.min(axis=0) - 1.0
    columns, rows = np.ceil((route_m.max(axis=0) + 1.0 - corner_m) / CELL_M).astype(int) + 1
    heights_m = cv2.GaussianBlur(rng.standard_normal((rows, columns)), (0, 0), 0.15 / CELL_M)
    spread = float(heights_m.std())
    return Floor(heights_m * (roughness_m / spread if spread > 0 else 0.0), corner_m, level_m)


def model_xml(kind: SimulatedKind, floor: Floor, start_m: Float64, heading_rad: float) -> str:
    """Return a body on its floor at a place (2,), as MJCF."""
    least_m, most_m = float(floor.heights_m.min()), float(floor.heights_m.max())
    rows, columns = floor.heights_m.shape
    size_m = np.array([columns - 1, rows - 1]) * CELL_M
    centre_m = floor.corner_m + size_m / 2.0
    shared = {
        "step": STEP_S, "rows": rows, "columns": columns, "half_x": size_m[0] / 2, "half_y": size_m[1] / 2,
        "high": max(most_m - least_m, 1e-6), "x": centre_m[0], "y": centre_m[1], "low": floor.level_m + least_m,
        "start_x": start_m[0], "start_y": start_m[1],
        "quat": f"{np.cos(heading_rad / 2)} 0 0 {np.sin(heading_rad / 2)}",
    }  # fmt: skip
    own = _quadruped(floor.level_m + most_m) if kind == "quadruped" else _rover(floor.level_m + most_m)
    return _WORLD.format(**shared, **own)


def _quadruped(top_m: float) -> dict[str, object]:
    places = [(x, y) for x in (HIP_X_M, -HIP_X_M) for y in (HIP_Y_M, -HIP_Y_M)]
    parts = [
        _LEG.format(name=name, x=x, y=y, thigh=THIGH_M, shank=SHANK_M, foot=FOOT_M)
        for name, (x, y) in zip(LEGS, places, strict=True)
    ]
    drives = [
        f'\n    <position joint="{name}_{joint}" kp="300" kv="6" forcerange="-60 60"/>'
        for name in LEGS
        for joint in ("roll", "hip", "knee")
    ]
    return {
        "start_z": top_m + STANCE_M + FOOT_M, "trunk": "0.2 0.12 0.05", "mass": 5.0, "camera": "0.2 0 0.17",
        "parts": "".join(parts), "actuators": "".join(drives),
        "contacts": ' cone="elliptic" impratio="10"',  # feet that slide less
    }  # fmt: skip


def _rover(top_m: float) -> dict[str, object]:
    places = [(x, y) for x in (WHEEL_X_M, -WHEEL_X_M) for y in (WHEEL_Y_M, -WHEEL_Y_M)]
    parts = [_WHEEL.format(name=name, x=x, y=y, radius=WHEEL_M) for name, (x, y) in zip(LEGS, places, strict=True)]
    drives = [f'\n    <velocity joint="{name}_axle" kv="4" forcerange="-8 8"/>' for name in LEGS]
    return {
        "start_z": top_m + WHEEL_M + 0.01, "trunk": "0.22 0.15 0.05", "mass": 9.0, "camera": "0.2 0 0.3",
        "parts": "".join(parts), "actuators": "".join(drives), "contacts": "",
    }  # fmt: skip
