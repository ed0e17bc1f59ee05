# SPDX-License-Identifier: GPL-3.0-or-later
import math

import numpy as np
import pytest
from cases import cases

from noisy_world.core.geometry import pose, rotation_from_euler_deg
from noisy_world.core.trajectory import Trajectory, convert_convention
from noisy_world.trajectories.rig import Rig, Sensor, sensor_from_extrinsics, sensor_trajectory

HALF = math.sqrt(0.5)


def robot_trajectory():
    """A robot at (1, 2, 3) that faces world +x, then one at (4, 5, 6) that faces world +y; its file has robot axes."""
    body = pose(rotation_from_euler_deg(0.0, 0.0, [0.0, 90.0]), [[1, 2, 3], [4, 5, 6]])
    return Trajectory(convert_convention(body, direction="c2w", axes="robot"), [0.5, 0.75])


def test_sensor_ahead_and_above_looks_where_the_robot_faces():
    # 0.3 m ahead of the robot's centre, 0.1 m to its left, 0.2 m above it.
    sensor = sensor_from_extrinsics(translation_m=[0.3, 0.1, 0.2])
    moved = sensor_trajectory(robot_trajectory(), sensor)
    np.testing.assert_allclose(moved.c2w[:, :3, 3], [[1.3, 2.1, 3.2], [3.9, 5.3, 6.2]], atol=1e-15)
    np.testing.assert_allclose(moved.c2w[:, :3, 2], [[1, 0, 0], [0, 1, 0]], atol=1e-15)  # forward
    np.testing.assert_allclose(moved.c2w[:, :3, 1], [[0, 0, -1], [0, 0, -1]], atol=1e-15)  # the image's down
    np.testing.assert_array_equal(moved.stamps_s, [0.5, 0.75])


@cases(
    "rotation",
    [
        # The optical frame of a camera that faces forward, as robot descriptions (ROS) write it.
        {"rotation_euler_deg": [-90, 0, -90]},
        {"quat_wxyz": [0.5, -0.5, 0.5, -0.5]},
        {"matrix": [[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]},
        {},
    ],
)
def test_forward_camera_in_robot_axes(rotation):
    np.testing.assert_allclose(sensor_from_extrinsics(**rotation).robot_from_sensor, np.eye(4), atol=1e-15)


def test_camera_that_looks_up_and_to_the_left():
    # Identity in robot axes: the sensor's z, forward, is the robot's up; its x, the image's right, the robot's front.
    up = sensor_from_extrinsics(rotation_euler_deg=[0, 0, 0])
    moved = sensor_trajectory(robot_trajectory(), up)
    np.testing.assert_allclose(moved.c2w[0, :3, :3], np.eye(3), atol=1e-15)
    # In OpenCV axes the robot's left is -x: half of half a turn about y (down), against the clock seen from above.
    left = sensor_from_extrinsics(quat_wxyz=[HALF, 0, -HALF, 0], robot_axes="opencv")
    moved = sensor_trajectory(robot_trajectory(), left)
    np.testing.assert_allclose(moved.c2w[:, :3, 2], [[0, 1, 0], [-1, 0, 0]], atol=1e-15)


def test_the_same_mount_in_all_three_axes():
    in_robot = sensor_from_extrinsics(translation_m=[0.3, 0.1, 0.2], robot_axes="robot").robot_from_sensor
    in_opencv = sensor_from_extrinsics(translation_m=[-0.1, -0.2, 0.3], robot_axes="opencv").robot_from_sensor
    in_opengl = sensor_from_extrinsics(translation_m=[-0.1, 0.2, -0.3], robot_axes="opengl").robot_from_sensor
    np.testing.assert_allclose(in_robot, in_opencv, atol=1e-16)
    np.testing.assert_allclose(in_opengl, in_opencv, atol=1e-16)


def test_two_sensors_keep_their_distance():
    rig = Rig(
        rgb=sensor_from_extrinsics(translation_m=[0, 0.025, 0]),
        depth=sensor_from_extrinsics(translation_m=[0, -0.025, 0], rotation_euler_deg=[-90, 0, -88]),
    )
    rgb, depth = (sensor_trajectory(robot_trajectory(), sensor) for sensor in (rig.rgb, rig.depth))
    np.testing.assert_allclose(np.linalg.norm(rgb.c2w[:, :3, 3] - depth.c2w[:, :3, 3], axis=1), 0.05)
    np.testing.assert_allclose(np.sum(rgb.c2w[:, :3, 2] * depth.c2w[:, :3, 2], axis=1), math.cos(math.radians(2)))


def test_composition_order():
    mount = pose(rotation_from_euler_deg(10, 20, 30), [1, 2, 3])
    robot = robot_trajectory()
    moved = sensor_trajectory(robot, Sensor(mount))
    for world_from_robot, c2w in zip(robot.c2w, moved.c2w, strict=True):
        point = np.array([0.5, -0.7, 2.0, 1.0])
        np.testing.assert_allclose(c2w @ point, world_from_robot @ (mount @ point), atol=1e-14)


def test_rounded_rotations_are_mended():
    rounded = np.round(pose(rotation_from_euler_deg(10, 20, 30), [1, 2, 3]), 4)
    mended = sensor_from_extrinsics(matrix=rounded, robot_axes="opencv").robot_from_sensor
    np.testing.assert_allclose(mended[:3, :3].T @ mended[:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(mended, rounded, atol=1e-4)


@cases(
    ("given", "says"),
    [
        ({"quat_wxyz": [1, 0, 0, 0], "rotation_euler_deg": [0, 0, 0]}, "one rotation"),
        ({"matrix": np.eye(4), "translation_m": [0, 0, 0]}, "either"),
        ({"matrix": np.eye(4), "quat_wxyz": [1, 0, 0, 0]}, "either"),
        ({"matrix": np.eye(3)}, "matrix must be 4 x 4 numbers"),
        ({"matrix": np.diag([1, 1, -1, 1])}, "mirrors"),
        ({"matrix": np.diag([1.1, 1.1, 1.1, 1])}, "off by 0.21"),
        ({"matrix": np.eye(4) + np.eye(4, k=-1)}, "last row"),
        ({"quat_wxyz": [0, 0, 0, 0]}, "length 1, not 0"),
        ({"quat_wxyz": [1, 1, 0, 0]}, "length 1, not 1.41421"),
        ({"quat_wxyz": [1, 0, 0]}, "quat_wxyz must be 4 numbers"),
        ({"rotation_euler_deg": [0, 0]}, "rotation_euler_deg must be 3 numbers"),
        ({"rotation_euler_deg": 90}, "rotation_euler_deg must be 3 numbers"),
        ({"translation_m": [0, 0, math.nan]}, "finite"),
        ({"translation_m": ["a", 0, 0]}, "translation_m must be 3 numbers"),
        ({"translation_m": [[0], [0, 1]]}, "translation_m must be 3 numbers"),
        ({"robot_axes": "ros"}, "opencv, opengl, robot"),
    ],
)
def test_extrinsics_that_are_none(given, says):
    with pytest.raises(ValueError, match=says):
        sensor_from_extrinsics(**given)
