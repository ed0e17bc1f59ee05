# SPDX-License-Identifier: GPL-3.0-or-later
"""The path of a body's camera, as a preset's `trajectory.body` says, and whether the mesh leaves it room."""

from ..core.errors import NoisyWorldError
from ..core.presets.scene_keys import BodySpec
from ..core.scenes.mesh import Mesh
from ..core.schema import ConfigPath
from ..core.trajectories.bodies import BODIES, embodied
from ..core.trajectories.trajectory import Trajectory


def carried_path(route: Trajectory, spec: BodySpec, seed: int, place: ConfigPath) -> Trajectory:
    """Return the path of a body's camera along a route. Raises InputError where no body can follow it."""
    try:
        return embodied(route, spec.kind, seed=seed, motion=spec.motion)
    except NoisyWorldError as error:
        raise place.error(str(error)) from error


def check_room(mesh: Mesh, path: Trajectory, spec: BodySpec, place: ConfigPath) -> None:
    """Refuse a path of a body's camera on which the mesh is too near. Raises InputError."""
    from ..core.trajectories.body_room import first_narrow

    body = BODIES[spec.kind]
    try:
        narrow = first_narrow(mesh, path, body)
    except NoisyWorldError as error:
        raise place.error(str(error)) from error
    if narrow is not None:
        where = ", ".join(f"{value:.2f}" for value in narrow.place_m)
        raise place.error(
            f"a {spec.kind} cannot go this way: at {narrow.time_s:.2f} s, at ({where}) m, the mesh is "
            f"{narrow.gap_m:.2f} m away, and it needs {body.radius_m} m",
            "take another path, or another body",
        )
