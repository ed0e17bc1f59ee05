# SPDX-License-Identifier: GPL-3.0-or-later
"""The self-check is silent on what is right, and speaks up when something is wrong."""

import numpy as np
from cases import cases
from analytic import box_depth, dense_box, look_at

from noisy_world.core.geometry import Intrinsics
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.sources.rendered_mesh import reprojection_problem, share_in_front

CAMERA = Intrinsics(160, 120, 90.0, 80.0, 70.0, 65.0)
LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.5, 1.5, 2.5])
EYE = look_at([0.4, 0.2, 1.1], [2.0, 1.0, 0.7])


def test_silent_on_the_truth():
    depth, _ = box_depth(CAMERA, EYE, LOW, HIGH)
    assert share_in_front(dense_box(LOW, HIGH), EYE, CAMERA, depth) < 1e-3
    assert reprojection_problem(dense_box(LOW, HIGH), EYE, CAMERA, depth) is None


@cases("wrong", ["axes", "transposed", "principal point", "ray distance", "scale", "shifted"])
def test_speaks_up(wrong):
    eye, camera = EYE.copy(), CAMERA
    depth, _ = box_depth(CAMERA, EYE, LOW, HIGH)
    if wrong == "axes":
        eye[:3, 1:3] *= -1
    elif wrong == "transposed":
        eye[:3, :3] = eye[:3, :3].T
    elif wrong == "principal point":
        camera = Intrinsics(160, 120, 90.0, 80.0, 110.0, 45.0)
    elif wrong == "ray distance":
        v, u = np.indices(depth.shape)
        depth = depth * np.sqrt(1 + ((u - 70) / 90) ** 2 + ((v - 65) / 80) ** 2)
    elif wrong == "scale":
        depth = depth * 1.1
    elif wrong == "shifted":
        eye[:3, 3] += [0.3, 0, 0]
    assert "went wrong" in reprojection_problem(dense_box(LOW, HIGH), eye, camera, depth)


def test_says_nothing_of_too_little():
    mesh = Mesh(np.zeros((3, 3)), None, np.arange(3, dtype=np.int32), np.zeros(1, np.int32))
    assert share_in_front(mesh, EYE, CAMERA, np.ones((120, 160), np.float32)) is None
