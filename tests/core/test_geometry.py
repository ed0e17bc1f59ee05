# SPDX-License-Identifier: GPL-3.0-or-later
import math
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.core.geometry import (
    OPENCV_FROM_ROBOT,
    Intrinsics,
    blender_from_opencv_c2w,
    continuous_quats,
    invert_pose,
    nearest_rotation,
    opencv_from_blender_c2w,
    opencv_from_robot_c2w,
    pose,
    quat_wxyz_from_rotation,
    rotation_angle_rad,
    rotation_error,
    rotation_from_euler_deg,
    rotation_from_quat_wxyz,
)

AXES = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8], [2 / 3, -1 / 3, 2 / 3], [-0.36, 0.48, 0.8]]])


def rodrigues(axis, angle_rad):
    """Rotation about a unit axis by Rodrigues' formula, 1 - cos by the half angle so that tiny angles survive."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle_rad) * cross + 2.0 * math.sin(angle_rad / 2) ** 2 * (cross @ cross)


def random_rotations(count, seed=0):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.array([rodrigues(a, t) for a, t in zip(axes, rng.uniform(-np.pi, np.pi, count), strict=True)])


def test_quaternion_to_rotation_published_values():
    half = math.sqrt(0.5)
    # 90 degrees about z takes x to y; (1, 1, 1, 1) / 2 permutes the axes cyclically.
    np.testing.assert_allclose(
        rotation_from_quat_wxyz([half, 0, 0, half]), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15
    )
    np.testing.assert_allclose(
        rotation_from_quat_wxyz([0.5, 0.5, 0.5, 0.5]), [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15
    )
    # scipy's documentation of Rotation.from_matrix: this matrix is 90 degrees about z.
    np.testing.assert_allclose(
        quat_wxyz_from_rotation([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), [half, 0, 0, half], atol=1e-15
    )


@cases("angle", [0.0, 1e-9, 1e-4, 0.3, math.pi / 2, 3.0, math.pi - 1e-9, math.pi, -1e-9, -2.0])
@cases("axis", AXES)
def test_quaternion_and_matrix_agree_with_rodrigues(axis, angle):
    expected_rotation = rodrigues(axis, angle)
    expected_quat = np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis])
    np.testing.assert_allclose(rotation_from_quat_wxyz(expected_quat), expected_rotation, rtol=0, atol=1e-15)
    quat = quat_wxyz_from_rotation(expected_rotation)
    assert abs(np.linalg.norm(quat) - 1.0) < 4e-16
    sign = 1.0 if quat @ expected_quat > 0 else -1.0
    np.testing.assert_allclose(sign * quat, expected_quat, rtol=0, atol=1e-15)


def test_tiny_rotation_keeps_its_relative_precision():
    quat = quat_wxyz_from_rotation(rodrigues([0.0, 0.6, 0.8], 1e-9))
    np.testing.assert_allclose(quat[1:], 0.5e-9 * np.array([0.0, 0.6, 0.8]), rtol=1e-9)


def test_quaternion_sign_is_canonical_and_both_signs_are_one_rotation():
    quats = np.random.default_rng(1).normal(size=(50, 4))
    np.testing.assert_array_equal(rotation_from_quat_wxyz(quats), rotation_from_quat_wxyz(-quats))
    assert (quat_wxyz_from_rotation(rotation_from_quat_wxyz(quats))[:, 0] >= 0).all()
    # An exact half turn has w = 0: then x, y, z decide.
    for axis in np.eye(3):
        quat = quat_wxyz_from_rotation(np.diag(2 * axis - 1))
        np.testing.assert_array_equal(quat, [0, *axis])
        assert not np.signbit(quat).any()
    # About (-0.6, 0.8, 0) as about (0.6, -0.8, 0): x is positive, though y is the larger.
    turned = quat_wxyz_from_rotation([[-0.28, -0.96, 0], [-0.96, 0.28, 0], [0, 0, -1]])
    np.testing.assert_allclose(turned, [0, 0.6, -0.8, 0], atol=1e-15)


def test_quaternion_of_any_length_but_zero():
    half = math.sqrt(0.5)
    expected = rodrigues([1, 0, 0], math.pi / 2)
    for length in (1e-200, 0.3, 1.0, 1e200):
        np.testing.assert_allclose(
            rotation_from_quat_wxyz(np.array([half, half, 0, 0]) * length), expected, rtol=0, atol=1e-15
        )
    refused(rotation_from_quat_wxyz, [[1, 0, 0, 0], [0, 0, 0, 0]], names="zero quaternion", error=ValueError)


def test_conversions_are_vectorised_over_leading_axes():
    rotations = random_rotations(24).reshape(2, 3, 4, 3, 3)
    quats = quat_wxyz_from_rotation(rotations)
    assert quats.shape == (2, 3, 4, 4)
    for index in np.ndindex(2, 3, 4):
        np.testing.assert_array_equal(quats[index], quat_wxyz_from_rotation(rotations[index]))
    np.testing.assert_allclose(rotation_from_quat_wxyz(quats), rotations, rtol=0, atol=1e-15)


def test_1e5_compositions_stay_a_rotation_once_renearested():
    step = rodrigues([0.6, 0.0, 0.8], 0.01)
    rotation = np.eye(3)
    for _ in range(100_000):
        rotation = rotation @ step
    assert rotation_error(rotation) < 1e-10
    mended = nearest_rotation(rotation)
    assert rotation_error(mended) < 1e-15
    expected = rodrigues([0.6, 0.0, 0.8], math.remainder(1000.0, 2 * math.pi))
    np.testing.assert_allclose(mended, expected, rtol=0, atol=1e-10)


def test_continuous_quats_flips_only_where_neighbours_point_apart():
    angles = np.linspace(0.0, 6 * np.pi, 400)
    smooth = np.stack([np.cos(angles / 2), np.zeros(400), np.sin(angles / 2), np.zeros(400)], axis=1)
    broken = smooth * np.random.default_rng(2).choice([-1.0, 1.0], 400)[:, None]
    broken[0] = smooth[0]
    np.testing.assert_array_equal(continuous_quats(broken), smooth)
    canonical = quat_wxyz_from_rotation(rotation_from_quat_wxyz(smooth))
    assert (np.sum(canonical[1:] * canonical[:-1], axis=1) < 0).any()  # the case exists
    np.testing.assert_allclose(continuous_quats(canonical), smooth, atol=1e-12)


def test_continuous_quats_at_exact_right_angles_and_single_rows():
    rows = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, -1, 0, 0]])  # the first dot product is exactly 0
    np.testing.assert_array_equal(continuous_quats(rows), [[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]])
    np.testing.assert_array_equal(continuous_quats(rows[2:]), rows[2:])
    two = np.stack([rows, -rows])
    np.testing.assert_array_equal(continuous_quats(two)[1], -continuous_quats(two)[0])


def test_nearest_rotation_is_the_polar_factor():
    rng = np.random.default_rng(3)
    rotations = random_rotations(40, seed=3)
    for size in (1e-9, 1e-4, 3e-3, 0.2):  # both of its ways
        stretch = np.eye(3) + size * rng.uniform(-0.3, 0.3, (40, 3, 3))
        stretch = (stretch + np.swapaxes(stretch, 1, 2)) / 2  # R S with S symmetric, positive: R is nearest
        np.testing.assert_allclose(nearest_rotation(rotations @ stretch), rotations, rtol=0, atol=3e-15)
    assert rotation_error(nearest_rotation(rotations)).max() < 1e-15


def test_nearest_rotation_of_a_reflection_is_a_rotation():
    mirrored = random_rotations(10) @ np.diag([1.0, 1.0, -1.0])
    mended = nearest_rotation(mirrored)
    assert rotation_error(mended).max() < 3e-15
    np.testing.assert_allclose(np.linalg.det(mended), 1.0, atol=1e-14)
    # Of an ordinary matrix no nearby rotation is nearer.
    matrix = np.random.default_rng(5).normal(size=(3, 3))
    best = np.linalg.norm(nearest_rotation(matrix) - matrix)
    for axis in AXES:
        for angle in (1e-3, -1e-3, 1.0, 3.0):
            assert np.linalg.norm(nearest_rotation(matrix) @ rodrigues(axis, angle) - matrix) >= best


def test_rotation_error_is_the_largest_entry():
    assert rotation_error(np.eye(3)) == 0.0
    assert rotation_error(np.diag([1.0, 1.1, 1.0])) == pytest.approx(0.21)
    sheared = np.eye(3)
    sheared[0, 1] = 0.25
    assert rotation_error(np.stack([np.eye(3), sheared])).tolist() == [0.0, 0.25]


@cases("angle", [0.0, 1e-12, 1e-9, 1e-4, 1.0, math.pi - 1e-4, math.pi - 1e-9, math.pi])
@cases("axis", AXES)
def test_angle_between_rotations(axis, angle):
    start = rodrigues([0.36, 0.48, 0.8], 1.1)
    assert rotation_angle_rad(start, start @ rodrigues(axis, angle)) == pytest.approx(angle, rel=0, abs=1e-15)


def test_euler_angles_are_rz_ry_rx():
    rx, ry, rz = 12.0, -34.0, 156.0
    expected = (
        rodrigues([0, 0, 1], math.radians(rz))
        @ rodrigues([0, 1, 0], math.radians(ry))
        @ rodrigues([1, 0, 0], math.radians(rx))
    )
    np.testing.assert_allclose(rotation_from_euler_deg(rx, ry, rz), expected, rtol=0, atol=1e-15)
    # At the pole (ry = 90 degrees) rx and rz turn about one axis.
    np.testing.assert_allclose(
        rotation_from_euler_deg(30.0, 90.0, 50.0), rotation_from_euler_deg(0.0, 90.0, 20.0), rtol=0, atol=1e-15
    )
    many = rotation_from_euler_deg(np.zeros(5), 0.0, np.arange(5.0))
    assert many.shape == (5, 3, 3)
    np.testing.assert_allclose(many[3], rodrigues([0, 0, 1], math.radians(3)), atol=1e-15)


@cases("quarters", [-5, -2, -1, 0, 1, 2, 3, 4, 7])
def test_quarter_turns_are_exact(quarters):
    cos, sin = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarters % 4]
    angle = 90.0 * quarters
    np.testing.assert_array_equal(rotation_from_euler_deg(angle, 0, 0), [[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    np.testing.assert_array_equal(rotation_from_euler_deg(0, angle, 0), [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    np.testing.assert_array_equal(rotation_from_euler_deg(0, 0, angle), [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def test_camera_axes_blender():
    # A camera at (1, 2, 3), level, looking along world +y: right is +x, down is -z.
    opencv = pose(np.column_stack([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), [1, 2, 3])
    # Blender: its camera looks along -Z with +Y up, so Z is -y of the world and Y is +z.
    blender = pose(np.column_stack([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), [1, 2, 3])
    np.testing.assert_array_equal(blender_from_opencv_c2w(opencv), blender)
    np.testing.assert_array_equal(opencv_from_blender_c2w(blender), opencv)
    assert not np.signbit(blender_from_opencv_c2w(np.eye(4))[0]).any()


def test_camera_axes_robot():
    # A robot that faces world +y: forward is +y, left is -x, up is +z.
    robot = pose(np.column_stack([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), [1, 2, 3])
    opencv = pose(np.column_stack([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), [1, 2, 3])
    np.testing.assert_array_equal(opencv_from_robot_c2w(robot), opencv)
    np.testing.assert_array_equal(OPENCV_FROM_ROBOT @ [1, 0, 0], [0, 0, 1])  # forward is z


def test_the_argument_is_not_written_to():
    c2w = np.stack([pose(r, [1, 2, 3]) for r in random_rotations(3)])
    before = c2w.copy()
    blender_from_opencv_c2w(c2w)
    invert_pose(c2w)
    nearest_rotation(c2w[:, :3, :3])
    np.testing.assert_array_equal(c2w, before)


def test_pose_broadcasts():
    poses = pose(np.eye(3), np.arange(6.0).reshape(2, 3))
    assert poses.shape == (2, 4, 4)
    np.testing.assert_array_equal(poses[1], [[1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1]])


def test_invert_pose_far_from_the_origin():
    rotation = rodrigues([0.6, 0.0, 0.8], 2.0)
    centre = np.array([1e5, -1e5, 3e4])
    inverse = invert_pose(pose(rotation, centre))
    np.testing.assert_array_equal(inverse[:3, :3], rotation.T)
    # The point one metre in front of the camera.
    np.testing.assert_allclose(inverse @ [*(centre + rotation[:, 2]), 1.0], [0, 0, 1, 1], atol=1e-10)
    twice = invert_pose(inverse)
    np.testing.assert_array_equal(twice[:3, :3], rotation)
    np.testing.assert_allclose(twice[:3, 3], centre, rtol=0, atol=1e-10)
    stack = pose(random_rotations(6).reshape(2, 3, 3, 3), np.ones(3))
    np.testing.assert_allclose(invert_pose(stack) @ stack, np.broadcast_to(np.eye(4), (2, 3, 4, 4)), atol=1e-14)


def test_rays_project_to_their_own_pixels():
    camera = Intrinsics(width_px=12, height_px=7, fx_px=6.0, fy_px=5.0, cx_px=5.5, cy_px=2.0)
    rays = camera.ray_directions()
    assert rays.shape == (7, 12, 3)
    assert rays.dtype == np.float64
    np.testing.assert_allclose(rays[2, 7], [1.5 / 6, 0, 1])
    np.testing.assert_allclose(rays[6, 0], [-5.5 / 6, 4 / 5, 1])
    pixels = (rays * 3.7) @ camera.matrix.T
    v, u = np.mgrid[:7, :12]
    np.testing.assert_allclose(pixels[..., 0] / pixels[..., 2], u, atol=1e-12)
    np.testing.assert_allclose(pixels[..., 1] / pixels[..., 2], v, atol=1e-12)


def test_replica_camera_has_its_middle_between_pixels():
    rays = Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5).ray_directions()
    np.testing.assert_allclose(rays[0, 0, :2], -rays[-1, -1, :2], atol=1e-15)
    assert np.degrees(2 * np.arctan(rays[0, -1, 0])) == pytest.approx(90.0, abs=0.1)


@cases(
    "values",
    [
        (0, 5, 1.0, 1.0, 0.0, 0.0),
        (5, -1, 1.0, 1.0, 0.0, 0.0),
        (5, 5, 0.0, 1.0, 0.0, 0.0),
        (5, 5, 1.0, math.nan, 0.0, 0.0),
    ],
)
def test_impossible_intrinsics(values):
    with pytest.raises(ValueError, match=r"pixels|positive|finite"):
        Intrinsics(*values)


def test_a_smaller_image_of_the_same_view_sees_the_mean_of_what_its_pixels_cover():
    """Its rays are those of the middles of blocks: 4 x 4 pixels here, and 4 x 3 where sides are rounded apart."""
    seen = Intrinsics(64, 48, 50.0, 52.0, 20.0, 30.5)
    blocks = seen.ray_directions().reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(seen.shrunk(16).ray_directions(), blocks, atol=1e-12)
    blocks = replace(seen, height_px=6).ray_directions().reshape(2, 3, 16, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(replace(seen, height_px=6).shrunk(16).ray_directions(), blocks, atol=1e-12)
    assert seen.shrunk(64) == seen.shrunk(1000) == seen
