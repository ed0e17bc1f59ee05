# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories as keyframes: from a file to Blender and back, and what the evaluated camera does."""

import bpy
import numpy as np
import pytest

from calls import calls_made
from keyed_poses import keyed_poses
from noisy_world.render.mesh_session import add_camera, key_trajectory
from noisy_world.render.mesh_session import empty_scene, set_origin
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.trajectories.formats import read_trajectory
from noisy_world.trajectories.matrix_poses import replica_text
from noisy_world.trajectories.stamped_poses import tum_text


def random_poses(count, *, place_m=(0.0, 0.0, 0.0)):
    """Uniform rotations by Gram-Schmidt in float64, positions within 8 m of a place."""
    rng = np.random.default_rng(5)
    q, r = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[np.linalg.det(q) < 0, :, 0] *= -1
    c2w = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    c2w[:, :3, :3] = q
    c2w[:, :3, 3] = rng.uniform(-8, 8, (count, 3)) + place_m
    return c2w


@pytest.mark.parametrize("text", [replica_text, tum_text])
def test_file_to_keyframes_to_file(tmp_path, text):
    path = tmp_path / "poses.txt"
    path.write_text(text(evenly_stamped(random_poses(2000))))
    before = read_trajectory(path).c2w
    scene = empty_scene()
    camera = add_camera(scene, "camera")
    key_trajectory(scene, camera, before)
    after = keyed_poses(scene, camera, np.arange(2000))
    path.write_text(text(evenly_stamped(after)))
    again = read_trajectory(path).c2w
    assert np.abs(again - before).max() < 1e-6


def test_the_evaluated_camera_is_the_keyed_one():
    poses = random_poses(50)
    scene = empty_scene()
    camera = add_camera(scene, "camera")
    key_trajectory(scene, camera, poses, first_frame=10)
    assert (scene.frame_start, scene.frame_end) == (10, 59)
    for k in (0, 17, 49):
        scene.frame_set(10 + k)
        world = np.array(camera.matrix_world)  # Blender's axes: -y and -z of OpenCV's
        assert np.abs(world[:3, :3] * [1, -1, -1] - poses[k, :3, :3]).max() < 1e-6
        assert np.abs(world[:3, 3] - poses[k, :3, 3]).max() < 1e-6


def test_quaternion_signs_are_continuous():
    # A camera that turns twice around: naive quaternions jump at each half turn.
    angles = np.linspace(0, 4 * np.pi, 400)
    poses = np.broadcast_to(np.eye(4), (400, 4, 4)).copy()
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    scene = empty_scene()
    camera = add_camera(scene, "camera")
    key_trajectory(scene, camera, poses)
    action = camera.animation_data.action
    curves = [action.fcurve_ensure_for_datablock(camera, "rotation_quaternion", index=i) for i in range(4)]
    keys = np.array([[point.co.y for point in curve.keyframe_points] for curve in curves]).T
    assert (keys[1:] * keys[:-1]).sum(axis=1).min() > 0.99
    half = keyed_poses(scene, camera, np.array([100.5]))[0]
    middle = (angles[100] + angles[101]) / 2
    assert half[0, 0] == pytest.approx(np.cos(middle), abs=1e-5)


def test_far_from_the_origin_nothing_is_lost():
    place_m = np.array([1e5, -2e4, 3e3])
    poses = random_poses(200, place_m=place_m)
    scene = empty_scene()
    set_origin(scene, place_m)
    camera = add_camera(scene, "camera")
    key_trajectory(scene, camera, poses)
    assert np.abs(keyed_poses(scene, camera, np.arange(200)) - poses).max() < 1e-6


def test_keys_are_set_all_at_once():
    camera = add_camera(empty_scene(), "camera")
    key_trajectory(bpy.context.scene, camera, random_poses(20))  # later ones are keyed into the same action
    few, many = (calls_made(key_trajectory, bpy.context.scene, camera, random_poses(count)) for count in (20, 2000))
    assert many == few  # a loop over keyframe_insert takes seconds
