# SPDX-License-Identifier: GPL-3.0-or-later
"""A room of many colours and cameras that move steadily, for what a shutter does to an image."""

from dataclasses import replace

import numpy as np
from analytic import box_mesh, look_at
from ray_tools import OPTIONS
from scipy.spatial.transform import Rotation

from noisy_world.core.geometry import Intrinsics, pose
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory
from noisy_world.render.ray_session import RaySession

LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.5, 3.0, 2.4])
CAMERA = Intrinsics(48, 36, 30.0, 28.0, 22.5, 18.0)
START = look_at([-0.4, 0.1, 1.2], [1.0, 0.9, 1.0])
RATE_HZ = 20.0
PERIOD_S = 0.016  # of the vibration
TURNS_DEG_S = {"linear": [0, 0, 0], "rotation": [20, 60, 0], "roll": [0, 0, 200]}
MOVES_M_S = {"linear": [2.0, 0.6, 0.4], "rotation": [0, 0, 0], "roll": [0.1, 0, 0]}


def moved(motion, times_s):
    """The camera at some times (...): a steady turn about its own axes and a steady speed."""
    times_s = np.asarray(times_s, dtype=np.float64)
    if motion == "vibration":
        phase = 2 * np.pi * times_s.reshape(-1, 1) / PERIOD_S + [0.0, 1.0, 0.0]
        turned = Rotation.from_rotvec(np.sin(phase) * [0.05, 0.08, 0.0]).as_matrix()
        return pose(START[:3, :3] @ turned.reshape(*times_s.shape, 3, 3), START[:3, 3] + 0 * times_s[..., None])
    turned = Rotation.from_rotvec(times_s.reshape(-1, 1) * np.radians(TURNS_DEG_S[motion])).as_matrix()
    return pose(
        START[:3, :3] @ turned.reshape(*times_s.shape, 3, 3),
        START[:3, 3] + times_s[..., None] * np.array(MOVES_M_S[motion], float),
    )


def paths(motion, count=3, rate_hz=RATE_HZ, speed=1.0):
    """The path of some poses, of which the middle one has the stamp 0."""
    stamps_s = (np.arange(count) - count // 2) / rate_hz
    return SensorPaths(Trajectory(moved(motion, speed * stamps_s), stamps_s))


def coloured_room(side=12, *, smooth=False):
    """The box's walls in small faces: each of a colour of its own, or smoothly coloured by waves across the room."""
    plain = box_mesh(LOW, HIGH)
    corners = plain.vertices_m[plain.corner_vertices].reshape(-1, 4, 3)
    steps = np.linspace(0, 1, side + 1)
    a, b = (values.ravel() for values in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    faces = [
        wall[0]
        + steps[a + i, None, None].reshape(-1, 1) * (wall[1] - wall[0])
        + steps[b + j].reshape(-1, 1) * (wall[3] - wall[0])
        for wall in corners
        for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    quads = np.stack(faces).reshape(len(corners), 4, -1, 3).transpose(0, 2, 1, 3).reshape(-1, 4, 3)
    vertices_m = quads.reshape(-1, 3)
    if smooth:
        waves = np.random.default_rng(3).normal(0, 4, (3, 3))
        rgb = (0.5 + 0.45 * np.sin(vertices_m @ waves)).astype(np.float32)
    else:
        rgb = np.repeat(np.random.default_rng(3).uniform(0, 1, (len(quads), 3)).astype(np.float32), 4, axis=0)
    starts = np.arange(0, 4 * len(quads), 4, dtype=np.int32)
    return Mesh(vertices_m, rgb, np.arange(4 * len(quads), dtype=np.int32), starts)


def room_session(sensors, camera=CAMERA, mesh=None, **options):
    return RaySession(coloured_room() if mesh is None else mesh, sensors, camera, replace(OPTIONS, **options))


def psnr_db(seen, true):
    """Of images in [0, 1]."""
    return -10 * np.log10(max(float(np.mean((np.asarray(seen, float) - true) ** 2)), 1e-30))
