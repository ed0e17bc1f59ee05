# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of poses and of pairing, against float64 arithmetic written out here."""

from math import cos, erf, radians, sin, sqrt

import numpy as np
from cases import cases

from noisy_world.perturbations.execution import move
from noisy_world.perturbations.kinds import SequenceContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.core.streams import stream
from noisy_world.core.trajectory import Trajectory, evenly_stamped
from noisy_world.perturbations import registry

CONTEXT = SequenceContext((7, "room", "shaky", "motion_deviation", 0))


def perturbation(name):
    return registry()[name]


def still(count):
    return evenly_stamped(np.tile(np.eye(4), (count, 1, 1)))


def winding(count):
    """A path that turns and climbs."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for k, pose in enumerate(poses):
        a = 0.03 * k
        pose[:3, :3] = [[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]]
        pose[:3, 3] = [cos(a), sin(a), 0.01 * k]
    return evenly_stamped(poses)


def deviate(trajectory, context=CONTEXT, **given):
    item = perturbation("motion_deviation")
    return item.apply(trajectory, item.parameters(**given), context)


def euler_deg(rotation):
    """x, y, z of Rz Ry Rx, in degrees."""
    x = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    y = -np.arcsin(rotation[..., 2, 0])
    z = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    return np.degrees(np.stack([x, y, z], axis=-1))


def kolmogorov(sample):
    """The largest distance between the sample's distribution and the standard normal's."""
    ordered = np.sort(sample)
    cdf = np.array([0.5 * (1 + erf(x / sqrt(2))) for x in ordered])
    steps = np.arange(len(ordered) + 1) / len(ordered)
    return max(np.abs(cdf - steps[1:]).max(), np.abs(cdf - steps[:-1]).max())


def test_deviations_are_the_gaussian_asked_for():
    moved = deviate(still(4000), rotation_deg=3.0, translation_m=0.025)
    angles = euler_deg(moved.c2w[:, :3, :3]) / 3.0
    shifts = moved.c2w[:, :3, 3] / 0.025
    for values in (angles, shifts):
        for axis in range(3):
            assert kolmogorov(values[:, axis]) < 1.63 / sqrt(4000)  # 1 %
    both = np.concatenate([angles, shifts], axis=1)
    correlation = np.corrcoef(both.T) - np.eye(6)
    assert np.abs(correlation).max() < 4.5 / sqrt(4000)
    for lag in range(1, 65):
        assert np.abs((both[lag:] * both[:-lag]).mean(axis=0)).max() < 5 / sqrt(4000 - lag)


def test_deviations_are_composed_as_rotations():
    path = winding(300)
    moved = deviate(path, rotation_deg=40.0, translation_m=0.5)
    for k in range(300):
        x, y, z, *shift = stream(*CONTEXT.identifiers, frame=k).standard_normal(6)
        (cx, sx), (cy, sy), (cz, sz) = ((cos(radians(40 * a)), sin(radians(40 * a))) for a in (x, y, z))
        rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        assert np.abs(moved.c2w[k, :3, :3] - path.c2w[k, :3, :3] @ rz @ ry @ rx).max() < 1e-14
        assert np.abs(moved.c2w[k, :3, 3] - path.c2w[k, :3, 3] - 0.5 * np.array(shift)).max() < 1e-15


def test_deviated_poses_stay_rotations_over_many_compositions():
    path = still(2000)
    for _ in range(5):
        path = deviate(path, rotation_deg=5.0, translation_m=0.05)
    turned = np.eye(3)
    for pose in np.tile(path.c2w, (10, 1, 1)):  # 2,000 x 5 x 10 = 100,000 factors in all
        turned = turned @ pose[:3, :3]
    assert abs(np.linalg.det(turned) - 1) < 1e-12
    assert np.abs(turned.T @ turned - np.eye(3)).max() < 1e-12


def test_a_pose_alone_deviates_as_in_the_whole_path():
    whole = deviate(winding(50))
    assert np.array_equal(deviate(winding(20)).c2w, whole.c2w[:20])
    other = deviate(winding(50), SequenceContext((8, *CONTEXT.identifiers[1:])))
    assert not np.array_equal(other.c2w, whole.c2w)


def test_no_deviation_is_the_path_itself():
    path = winding(10)
    assert np.array_equal(deviate(path, rotation_deg=0.0, translation_m=0.0).c2w, path.c2w)
    before = path.c2w.copy()
    deviate(path)
    assert np.array_equal(path.c2w, before)
    only_moved = deviate(path, rotation_deg=0.0)
    assert np.array_equal(only_moved.c2w[:, :3, :3], path.c2w[:, :3, :3])


@cases(("count", "factor", "kept"), [(10, 1, 10), (10, 2, 5), (11, 2, 6), (10, 8, 2), (1, 4, 1), (5, 9, 1)])
def test_faster_motion_keeps_every_nth_pose_at_the_camera_s_rate(count, factor, kept):
    path = Trajectory(winding(count).c2w, 100.0 + 0.05 * np.arange(count))
    (step,) = parse_steps([{"faster_motion": {"factor": factor}}], ConfigPath("x"), registry())
    fast = move([step], path, (7, "room", "fast"))
    assert np.array_equal(fast.c2w, path.c2w[::factor])
    assert np.array_equal(fast.stamps_s, 100.0 + 0.05 * np.arange(kept))


def pairs(count, **given):
    item = perturbation("desync")
    return item.apply(count, item.parameters(**given), CONTEXT).tolist()


def test_depth_comes_later_and_the_ends_are_clamped_or_dropped():
    assert pairs(6, offset=2) == [2, 3, 4, 5, 5, 5]
    assert pairs(6, offset=-2) == [0, 0, 0, 1, 2, 3]
    assert pairs(6, offset=2, edge="drop") == [2, 3, 4, 5, -1, -1]
    assert pairs(6, offset=-2, edge="drop") == [-1, -1, 0, 1, 2, 3]
    assert pairs(4, offset=0) == [0, 1, 2, 3]
    assert pairs(3, offset=50) == [2, 2, 2]
    assert pairs(3, offset=50, edge="drop") == [-1, -1, -1]
    assert pairs(1, offset=1) == [0]


def test_frames_are_lost_and_depth_is_repeated_as_often_as_asked():
    count = 5000
    lost = np.array(pairs(count, offset=0, lost_percent=20))
    assert abs(np.mean(lost < 0) - 0.2) < 0.02  # 3.5 deviations of a binomial share
    assert (lost[lost >= 0] == np.flatnonzero(lost >= 0)).all()
    again = np.array(pairs(count, offset=-2, repeated_percent=30, lost_percent=20))
    assert (np.flatnonzero(again < 0) == np.flatnonzero(lost < 0)).all()
    late = np.arange(count) - again
    shown = again >= 0
    assert late[3:][shown[3:]].min() == 2
    # Repeated once, twice: the depth is as much older, with probabilities of .3 and .3^2.
    assert abs(np.mean(late[shown] > 2) - 0.3) < 0.025
    assert abs(np.mean(late[shown] > 3) - 0.09) < 0.016


def test_dynamic_offsets_are_even_among_three():
    count = 3000
    found = np.array(pairs(count, offset=10, mode="dynamic"))[: count - 11] - np.arange(count - 11)
    assert set(found) == {9, 10, 11}
    shares = np.array([(found == k).mean() for k in (9, 10, 11)])
    assert np.abs(shares - 1 / 3).max() < 4 * sqrt(2 / 9 / count)
    deviation = found - 10.0
    for lag in range(1, 65):
        assert abs((deviation[lag:] * deviation[:-lag]).mean()) < 5 * (2 / 3) / sqrt(count - lag)
    assert pairs(20, offset=3, mode="dynamic")[:10] == pairs(2000, offset=3, mode="dynamic")[:10]
