# SPDX-License-Identifier: GPL-3.0-or-later
"""The paths of the sensors in a render, which its source frames are seen along."""

from dataclasses import replace

from ..perturbing.execution import chosen_poses, move, take_poses
from ..trajectories.curve import NaturalSpline
from ..trajectories.rig import sensor_trajectory
from ..trajectories.rounding import rounded_path
from ..trajectories.sensor_paths import SensorPaths
from ..trajectories.trajectory import Trajectory
from .plan import Plan, Render


def source_paths(plan: Plan, render: Render, count: int | None = None) -> SensorPaths:
    """Return the sensors' paths of a render, after its steps of motion; with "nominal" where these deviate.

    All are rounded, so that what is rendered along them, and drawn of it, is the same everywhere.

    count: how many of the scene's first poses are taken, if not all.
    """
    planned = render.scene.path
    planned = planned if count is None else planned.at(slice(count), planned.stamps_s[:count])
    if not render.moving:
        return _sensor_paths(plan, planned)
    moved = move(render.moving, planned, render.identifiers)
    chosen = chosen_poses(render.moving, len(planned), render.identifiers)
    found = _sensor_paths(plan, moved)
    if chosen is not None:
        found = replace(found, clock=NaturalSpline(planned.stamps_s[: len(chosen)], planned.stamps_s[chosen, None]))
    if all(step.perturbation.apply is None for step in render.moving):
        return found
    return replace(found, nominal=_sensor_paths(plan, take_poses(planned, chosen)).rgb)


def _sensor_paths(plan: Plan, trajectory: Trajectory) -> SensorPaths:
    if plan.rig is None:
        return SensorPaths(rounded_path(trajectory))
    depth = None if plan.rig.depth is None else sensor_trajectory(trajectory, plan.rig.depth)
    return SensorPaths(sensor_trajectory(trajectory, plan.rig.rgb), depth, trajectory).each(rounded_path)
