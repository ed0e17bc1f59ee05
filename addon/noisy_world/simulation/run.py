# SPDX-License-Identifier: GPL-3.0-or-later
"""A body's simulated way along a route: the path of its camera, and what MuJoCo's own IMU felt there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.extras import need
from ..core.geometry import opencv_from_robot_c2w, pose
from ..core.streams import stream
from ..core.trajectories.trajectory import Trajectory
from .controllers import ARRIVED_M, MOST_M_S, Route, steering, wheels
from .models import FOOT_M, LEGS, STANCE_M, STEP_S, SimulatedKind, model_xml, rough_floor
from .trot import Trot, Trunk

Float64: TypeAlias = NDArray[np.float64]

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
