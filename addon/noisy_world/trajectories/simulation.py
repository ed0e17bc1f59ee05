# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies with mass and contacts that follow a route over a floor, simulated by MuJoCo; it comes with an extra."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.geometry import opencv_from_robot_c2w, pose
from ..core.packages import need
from ..core.streams import stream
from ..core.trajectory import Trajectory

# The bodies in MJCF: a quadruped of 8 kg and a four-wheeled rover of 11 kg, on a floor that may be rough.


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


# What steers the bodies: a point ahead on the route gives speed and turn, which a trot or four wheels follow.


AHEAD_M = 0.35  # the point that is steered for; chosen
ARRIVED_M = 0.15
MOST_M_S: dict[SimulatedKind, float] = {"quadruped": 0.8, "rover": 1.5}  # by trying
MOST_TURN_RAD_S: dict[SimulatedKind, float] = {"quadruped": 1.5, "rover": 0.8}
SKID = 1.8  # wheels that slip sideways turn the rover by less than their speeds say; by trying


@dataclass(frozen=True, eq=False)
class Route:
    """Where a body goes: points (N, 2), their way (N,) from the first, and the speed there (N,) m/s.

    held_back: whether the speed was lowered somewhere to what the body can do.
    """

    points_m: Float64
    way_m: Float64
    speed_m_s: Float64
    held_back: bool

    def ahead(self, place_m: Float64, passed_m: float) -> tuple[Float64, float, float]:
        """Return the point to steer for, how much of the way is passed, and the speed there. place_m: (2,)."""
        near = (self.way_m >= passed_m - 0.01) & (self.way_m <= passed_m + 2.0 * AHEAD_M)
        rows = np.flatnonzero(near)
        row = rows[np.argmin(np.linalg.norm(self.points_m[rows] - place_m, axis=1))]
        passed_m = max(passed_m, float(self.way_m[row]))
        goal = min(int(np.searchsorted(self.way_m, passed_m + AHEAD_M)), len(self.way_m) - 1)
        return self.points_m[goal], passed_m, float(self.speed_m_s[row])


def steering(
    kind: SimulatedKind, place_m: Float64, heading_rad: float, goal_m: Float64, speed_m_s: float
) -> tuple[float, float]:
    """Return the speed ahead, m/s, and the turn, rad/s: slower the further the goal is off the heading."""
    off_m = goal_m - place_m
    off_rad = float(np.angle(np.exp(1j * (np.arctan2(off_m[1], off_m[0]) - heading_rad))))
    turn_rad_s = float(np.clip(2.5 * off_rad, -MOST_TURN_RAD_S[kind], MOST_TURN_RAD_S[kind]))
    return speed_m_s * max(np.cos(off_rad), 0.0) ** 2, turn_rad_s


def wheels(ahead_m_s: float, turn_rad_s: float) -> Float64:
    """Return the speeds, rad/s, that are asked of the rover's wheels, in the order of LEGS."""
    sides = [1.0 if name.endswith("left") else -1.0 for name in LEGS]
    return np.array([(ahead_m_s - side * SKID * turn_rad_s * WHEEL_Y_M) / WHEEL_M for side in sides])


# A quadruped's trot with balance: legs that stand carry a level trunk, legs that swing are put where it will fall.
#
# Where a foot is put follows Raibert (Legged Robots That Balance, 1986): half the way that the trunk goes while a foot
# stands, and a share of the error of its speed; the gain is near that of the capture point, sqrt(height / g) (Pratt and
# others 2006).


STRIDE_HZ, STANDS, LIFT_M = 3.0, 0.55, 0.05  # by trying
CAPTURE_S = 0.08  # how far a foot is put aside for an error of the speed; by trying, capture: sqrt(.25 / 9.81) = .16
PULL_S = 0.04  # how far standing feet are asked to pull the trunk for an error of its speed; by trying
SWUNG = 0.85  # of a swing after which the foot is where it is put: joints lag behind; by trying
LEAD_S = 0.023  # how far joints lag behind what is asked of them; by trying
MOST_OFF_RAD = 0.04  # how far the heading that is asked for is ahead of the trunk's; chosen
DAMPED_S = 0.05  # and for an error of the turn rate; by trying
SLID = 0.2  # of how far a standing foot has slid is taken over in a step of the controller; by trying
FLOOR_SHARE = 0.05  # of a step's news of the floor's height, 250 a second; chosen
FASTER_M_S2 = 1.0  # how fast the speed that is asked for changes
HIPS_M = np.array([(x, y, 0.0) for x in (HIP_X_M, -HIP_X_M) for y in (HIP_Y_M, -HIP_Y_M)])
_PHASES = np.array([0.0 if name in ("front_left", "rear_right") else 0.5 for name in LEGS])


@dataclass(frozen=True, eq=False)
class Trunk:
    """The trunk as it is: place (3,), speed (3,) and turn rate (3,) in the world, and its axes (3, 3).

    axes: x ahead, y left, z up.
    """

    place_m: Float64
    speed_m_s: Float64
    turn_rad_s: Float64
    axes: Float64

    @property
    def heading_rad(self) -> float:
        """Which way it looks over the floor."""
        return float(np.arctan2(self.axes[1, 0], self.axes[0, 0]))


@dataclass(eq=False)
class Trot:
    """What the legs do from step to step.

    feet_m: (4, 3) where each foot was put down, or was lifted, in the world. heading_rad: which way it is to look.
    floor_m: how high feet stand.
    """

    feet_m: Float64
    heading_rad: float
    floor_m: float
    swings: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(len(LEGS), dtype=np.bool_))
    ahead_m_s: float = 0.0
    last_s: float = 0.0

    @classmethod
    def standing(cls, trunk: Trunk, floor_m: float) -> "Trot":
        """Return legs that stand below the hips. floor_m: the height of the floor there."""
        feet_m = trunk.place_m + HIPS_M @ _upright(trunk.heading_rad).T
        feet_m[:, 2] = floor_m + FOOT_M
        return cls(feet_m, trunk.heading_rad, floor_m + FOOT_M)

    def asked(self, trunk: Trunk, touching_m: Float64, time_s: float, ahead_m_s: float, turn_rad_s: float) -> Float64:
        """Return the angles (12,) that are asked of the joints: roll, hip and knee of each leg, in the order of LEGS.

        touching_m: (4, 3) where the feet are. time_s: since it began to trot; at 0 it stands.
        """
        passed_s, self.last_s = max(time_s - self.last_s, 0.0), time_s
        change = FASTER_M_S2 * passed_s
        self.ahead_m_s += float(np.clip(ahead_m_s - self.ahead_m_s, -change, change))
        off_rad = _turn(self.heading_rad + turn_rad_s * passed_s - trunk.heading_rad)
        off_rad += DAMPED_S * (turn_rad_s - trunk.turn_rad_s[2])
        if time_s > 0.0:
            self.heading_rad = trunk.heading_rad + float(np.clip(off_rad, -MOST_OFF_RAD, MOST_OFF_RAD))
        wanted_m_s = _upright(self.heading_rad) @ np.array([self.ahead_m_s, 0.0, 0.0])
        off_m_s = (wanted_m_s - trunk.speed_m_s) * [1.0, 1.0, 0.0]
        phases = (STRIDE_HZ * time_s + _PHASES) % 1.0
        swings = (phases >= STANDS) & (time_s > 0.0)
        landed = self.swings & ~swings
        self.feet_m[landed] = touching_m[landed]
        if time_s > 0.0:  # feet that slide are not pulled back
            self.feet_m[~swings] += SLID * (touching_m - self.feet_m)[~swings]
        self.swings = swings
        self.floor_m += FLOOR_SHARE * (float(touching_m[~swings, 2].min()) - self.floor_m)
        over_m = trunk.place_m + PULL_S * off_m_s + LEAD_S * wanted_m_s if time_s > 0.0 else self.feet_m.mean(axis=0)
        place_m = np.array([*over_m[:2], self.floor_m + STANCE_M])
        goals = (self.feet_m - place_m) @ _upright(self.heading_rad) - HIPS_M
        goals[:, 2] = -STANCE_M
        for leg in np.flatnonzero(swings):
            share = float((phases[leg] - STANDS) / (1.0 - STANDS))
            goals[leg] = self._swung(int(leg), share, trunk, wanted_m_s, turn_rad_s)
        return np.concatenate([_angles(goal) for goal in goals])

    def _swung(self, leg: int, share: float, trunk: Trunk, wanted_m_s: Float64, turn_rad_s: float) -> Float64:
        """Return where a foot (3,) swings to below its hip, in the trunk's axes, for a share of its swing."""
        stood_s, left_s = STANDS / STRIDE_HZ, (1.0 - share) * (1.0 - STANDS) / STRIDE_HZ
        arm_m = trunk.axes @ HIPS_M[leg]
        hip_m = trunk.place_m + arm_m
        around_m = np.array([-arm_m[1], arm_m[0], 0.0])
        hip_m_s = trunk.speed_m_s + trunk.turn_rad_s[2] * around_m
        off_m_s = wanted_m_s + turn_rad_s * around_m - hip_m_s
        to_m = hip_m + hip_m_s * (left_s + stood_s / 2.0) - CAPTURE_S * off_m_s
        share = min(share / SWUNG, 1.0)
        eased = share**2 * (3.0 - 2.0 * share)
        at_m = self.feet_m[leg] + (to_m - self.feet_m[leg]) * eased
        at_m[2] = self.floor_m + LIFT_M * np.sin(np.pi * share) ** 2
        return trunk.axes.T @ (at_m - hip_m)


def _turn(angle_rad: float) -> float:
    """Return the same turn between -pi and pi."""
    return float(np.angle(np.exp(1j * angle_rad)))


def _upright(heading_rad: float) -> Float64:
    """Return level axes (3, 3) that look this way."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _angles(foot_m: Float64) -> Float64:
    """Return the angles of roll, hip and knee that bring a foot (3,) there below its hip, the knee bent backwards."""
    forward_m, left_m, up_m = foot_m
    down_m = np.hypot(left_m, up_m)
    reach = np.clip(np.hypot(forward_m, down_m), 0.05, THIGH_M + SHANK_M - 1e-3)
    knee = np.pi - np.arccos(np.clip((THIGH_M**2 + SHANK_M**2 - reach**2) / (2 * THIGH_M * SHANK_M), -1, 1))
    lean = np.arcsin(np.clip(SHANK_M * np.sin(knee) / reach, -1, 1))
    return np.array([np.arctan2(left_m, -up_m), -np.arctan2(forward_m, down_m) - lean, knee])


RATE_HZ = 250.0  # of the poses that are kept, and of the controller: every second step
SETTLED_S = 0.5  # on its feet before it goes
PATIENCE = 4.0  # times what the route takes at its own speed
FALLEN = 0.5  # of the trunk's up along the world's


@dataclass(frozen=True, eq=False)
class SimulatedWay:
    """What came of a simulation: the camera's path, OpenCV axes, at RATE_HZ, and what an IMU there felt, (N, 3) each.

    force_m_s2, rate_rad_s: in the axes x forward, y left, z up. version: of MuJoCo. held_back: whether the route is
    faster somewhere than the body can go.
    """

    path: Trajectory
    force_m_s2: Float64
    rate_rad_s: Float64
    version: str
    held_back: bool


def simulate(route: Trajectory, kind: SimulatedKind, *, floor_m: float, roughness_m: float, seed: int) -> SimulatedWay:
    """Let a body follow a route's ground plan over a floor at a height, from where the route begins to where it ends.

    roughness_m: the standard deviation of the floor's height. Equal arguments give equal bytes with one version of
    MuJoCo. Raises NoisyWorldError where it falls or does not arrive, MissingDependencyError without MuJoCo.
    """
    need(("mujoco",), "simulate")
    import mujoco as untyped

    mujoco: Any = untyped
    plan = _planned(route, MOST_M_S[kind])
    if plan.way_m[-1] < ARRIVED_M:
        problem = f"the route is {plan.way_m[-1]:.2f} m long, and a body has arrived {ARRIVED_M} m before its end"
        raise NoisyWorldError(problem, remedy="take a longer one")
    floor = rough_floor(plan.points_m, floor_m, roughness_m, stream("simulation", kind, seed))
    first = plan.points_m[min(20, len(plan.points_m) - 1)] - plan.points_m[0]
    model = mujoco.MjModel.from_xml_string(
        model_xml(kind, floor, plan.points_m[0], float(np.arctan2(first[1], first[0])))
    )
    span_m = float(np.ptp(floor.heights_m))
    model.hfield_data[:] = ((floor.heights_m - floor.heights_m.min()) / max(span_m, 1e-6)).ravel()
    data = mujoco.MjData(model)
    longest_s = SETTLED_S + PATIENCE * float(np.sum(np.diff(plan.way_m) / np.maximum(plan.speed_m_s[1:], 0.05)))
    path, felt = _followed(mujoco, _Body(model, data, kind), plan, longest_s)
    return SimulatedWay(path, felt[:, :3], felt[:, 3:], str(mujoco.__version__), plan.held_back)


def _planned(route: Trajectory, most_m_s: float) -> Route:
    span_s = float(route.stamps_s[-1] - route.stamps_s[0])
    at_s = route.stamps_s[0] + np.linspace(0.0, span_s, max(int(span_s * 100), 2))
    points_m = route.poses_at(at_s)[:, :2, 3]
    steps_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    speed_m_s = np.append(steps_m, steps_m[-1]) / (at_s[1] - at_s[0]) if span_s else np.zeros(len(points_m))
    way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    return Route(points_m, way_m, np.clip(speed_m_s, 0.1, most_m_s), bool(speed_m_s.max() > 1.001 * most_m_s))


@dataclass(frozen=True, eq=False)
class _Body:
    """A body in MuJoCo: its model and its state."""

    model: Any
    data: Any
    kind: SimulatedKind

    @property
    def trunk(self) -> Trunk:
        """The trunk as it is."""
        found = self.data.body("trunk")
        axes = found.xmat.reshape(3, 3).copy()
        return Trunk(found.xpos.copy(), self.data.qvel[:3].copy(), axes @ self.data.qvel[3:6], axes)

    @property
    def feet_m(self) -> Float64:
        """(4, 3): where the quadruped's feet are, in the world."""
        return np.array([self.data.geom(f"{name}_foot").xpos for name in LEGS])


def _followed(mujoco: Any, body: _Body, plan: Route, longest_s: float) -> tuple[Trajectory, Float64]:
    """Return the camera's path, and what its accelerometer and gyroscope felt (N, 6)."""
    model, data, kind = body.model, body.data, body.kind
    camera = data.site("camera")
    rows: list[tuple[Float64, Float64]] = []
    passed_m, steps = 0.0, round(1.0 / (RATE_HZ * STEP_S))
    mujoco.mj_forward(model, data)
    asked = _driven(body)
    for _ in range(int(longest_s * RATE_HZ)):
        mujoco.mj_forward(model, data)
        trunk = body.trunk
        if trunk.axes[2, 2] < FALLEN:
            raise NoisyWorldError(f"the {kind} fell after {data.time:.1f} s", remedy="lower the roughness or the speed")
        goal_m, passed_m, speed_m_s = plan.ahead(trunk.place_m[:2], passed_m)
        if plan.way_m[-1] - passed_m < ARRIVED_M:
            break
        rows.append((pose(camera.xmat.reshape(3, 3), camera.xpos), data.sensordata.copy()))
        ahead, turn = steering(kind, trunk.place_m[:2], trunk.heading_rad, goal_m, speed_m_s)
        going = data.time >= SETTLED_S
        data.ctrl[:] = asked(trunk, max(data.time - SETTLED_S, 0.0), ahead * going, turn * going)
        mujoco.mj_step(model, data, nstep=steps)
    else:
        raise NoisyWorldError(
            f"the {kind} has not arrived after {longest_s:.0f} s: it is stuck, or the way is too bent"
        )
    poses, felt = (np.array(values) for values in zip(*rows, strict=True))
    return Trajectory(opencv_from_robot_c2w(poses), np.arange(len(poses)) / RATE_HZ), felt


def _driven(body: _Body) -> Callable[[Trunk, float, float, float], Float64]:
    """Return what gives the actuators' controls for the trunk, a time, a speed ahead and a turn; bend the legs."""
    if body.kind == "rover":
        return lambda _, __, ahead_m_s, turn_rad_s: wheels(ahead_m_s, turn_rad_s)
    trot = Trot.standing(body.trunk, body.trunk.place_m[2] - STANCE_M - FOOT_M)
    body.data.qpos[7:] = trot.asked(body.trunk, trot.feet_m, 0.0, 0.0, 0.0)
    return lambda trunk, time_s, ahead_m_s, turn_rad_s: trot.asked(trunk, body.feet_m, time_s, ahead_m_s, turn_rad_s)
