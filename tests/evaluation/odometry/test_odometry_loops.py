"""Loops undo drift; features and guesses find views again; results against closed forms."""

import box_room
import numpy as np
import pytest

from noisy_world.core.geometry import pose, rotation_from_euler_deg
from noisy_world.evaluate.frame_tracking import Aligner, Edge, agreement
from noisy_world.evaluate.odometry import Recogniser, near_keyframes


def view_at(aligner, c2w):
    colour, depth_m = box_room.frame(c2w)
    return aligner.view(colour[..., 0].copy(), depth_m.astype(np.float32))


@pytest.fixture(scope="module")
def pair():
    """An aligner, two views that are 9 cm and 15 degrees apart, and the motion between them."""
    aligner = Aligner(box_room.CAMERA)
    first = box_room.path(1)[0]
    second = first @ pose(rotation_from_euler_deg(4.0, 15.0, -3.0), [0.05, 0.02, 0.07])
    return aligner, view_at(aligner, first), view_at(aligner, second), np.linalg.inv(second) @ first


def test_a_guess_that_is_far_off_is_refined_to_2_mm(pair):
    aligner, source, target, true = pair
    off = pose(rotation_from_euler_deg(3.0, -3.0, 2.0), [0.08, -0.05, 0.06])
    found = aligner.refined(source, target, off @ true)
    np.testing.assert_allclose(found, true, atol=2e-3)


def test_features_tell_the_motion_roughly(pair):
    _, source, target, true = pair
    recogniser = Recogniser(box_room.CAMERA)
    found = recogniser.motion(recogniser.landmarks(source), recogniser.landmarks(target))
    np.testing.assert_allclose(found[:3, :3], true[:3, :3], atol=0.1)


def test_views_agree_at_the_true_motion_and_not_at_another(pair):
    _, source, target, true = pair
    right = agreement(box_room.CAMERA, source, target, true)
    assert right.depth > 0.99
    assert right.grey > 0.95
    wrong = agreement(box_room.CAMERA, source, target, pose(np.eye(3), [0.0, 0.0, 0.3]) @ true)
    assert wrong.depth < 0.5
    assert agreement(box_room.CAMERA, source, target, pose(np.eye(3), [0.0, 0.0, 99.0]) @ true).seen == 0.0


def test_uniform_pictures_have_no_features(pair):
    aligner, source, *_ = pair
    recogniser = Recogniser(box_room.CAMERA)
    nothing = recogniser.landmarks(aligner.view(np.zeros_like(source.grey), source.depth_m))
    assert recogniser.motion(nothing, recogniser.landmarks(source)) is None


def ring(count):
    """c2w (N, 4, 4) on a circle of 1 m, looking outwards; the last is where the first is."""
    turns = np.linspace(0.0, 360.0, count)
    rotation = rotation_from_euler_deg(0 * turns, 0 * turns, turns)
    return pose(rotation @ box_room.FORWARD, rotation @ np.array([1.0, 0.0, 0.0]))


def test_a_loop_spreads_the_drift_over_the_ring():
    pytest.importorskip("gtsam")
    from noisy_world.evaluate.odometry import optimised

    true = ring(41)
    drift = pose(rotation_from_euler_deg(0.0, 0.1, 0.3), [0.002, 0.003, 0.001])
    edges = [Edge(n, n + 1, np.linalg.inv(true[n]) @ true[n + 1] @ drift) for n in range(40)]
    chained = [true[0]]
    for edge in edges:
        chained.append(chained[-1] @ edge.first_from_second)
    closed = optimised(chained, edges, [Edge(0, 40, np.linalg.inv(true[0]) @ true[40])])
    before, after = (box_room.ate_rmse_m(np.stack(c2w)[:, :3, 3], true[:, :3, 3]) for c2w in (chained, closed))
    assert before > 0.02
    assert after < before / 2
    np.testing.assert_allclose(closed[0], true[0], atol=1e-6)
    np.testing.assert_allclose(closed[40], true[40], atol=0.01)


def test_one_wrong_loop_among_right_ones_is_outvoted():
    pytest.importorskip("gtsam")
    from noisy_world.evaluate.odometry import optimised

    true = ring(41)
    edges = [Edge(n, n + 1, np.linalg.inv(true[n]) @ true[n + 1]) for n in range(40)]
    right = [Edge(n, n + 30, np.linalg.inv(true[n]) @ true[n + 30]) for n in range(0, 10, 3)]
    wrong = Edge(5, 25, pose(np.eye(3), [0.5, 0.5, 0.0]))
    found = optimised(list(true), edges, [*right, wrong])
    np.testing.assert_allclose(np.stack(found), true, atol=0.01)


def test_near_keyframes_are_those_that_look_the_same_way_long_before():
    near = near_keyframes(list(ring(41)), 40)
    assert near[0] == 0
    assert set(near) <= {0, 1, 2, 3, 4}  # 9 degrees from one to the next, and at most 40 degrees


def test_a_path_that_returns_closes_its_loop(tmp_path):
    pytest.importorskip("gtsam")
    from noisy_world.evaluate.odometry import Options, run
    from noisy_world.evaluate.system_input import read_index

    there = box_room.path(18, turn_deg=70.0)
    noise = np.random.default_rng(5)

    def noisy(number, colour, depth_m):
        return colour, np.maximum(depth_m + noise.normal(0.0, 0.15, depth_m.shape), 0.0)

    index = read_index(box_room.write(tmp_path, np.concatenate([there, there[::-1]]), change=noisy))
    true = np.concatenate([there, there[::-1]])[:, :3, 3]
    ate_m = {}
    for loops in (False, True):
        result = run(index, Options(loops=loops))
        assert all(frame.c2w is not None for frame in result.frames)
        ate_m[loops] = box_room.ate_rmse_m([frame.c2w[:3, 3] for frame in result.frames], true)
    assert result.loops > 0
    assert ate_m[True] < ate_m[False]
