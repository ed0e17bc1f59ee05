# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses to what is meaningful: as near as is said, and the same from numbers whose last bits differ."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import pose
from noisy_world.core.trajectory import Trajectory, evenly_stamped, rounded_numbers, rounded_path, rounded_poses

GENERATOR = np.random.default_rng(9)
TURNS = Rotation.random(2000, 3)  # its name for the seed is another before SciPy 1.15
POSES = pose(TURNS.as_matrix(), GENERATOR.uniform(-20, 20, (2000, 3)))


def shaken(values, by=1e-15):
    """Values with other last bits, as another numpy makes them."""
    return values * (1 + by * GENERATOR.choice([-1.0, 1.0], values.shape))


def test_poses_stay_where_they_are_to_a_nanometre_and_two_nanoradians():
    found = rounded_poses(POSES)
    assert np.abs(found[:, :3, 3] - POSES[:, :3, 3]).max() <= 0.5001e-9
    assert (TURNS.inv() * Rotation.from_matrix(found[:, :3, :3])).magnitude().max() < 2e-9
    np.testing.assert_allclose(found[:, :3, :3] @ found[:, :3, :3].swapaxes(1, 2), [np.eye(3)] * 2000, atol=1e-15)
    np.testing.assert_array_equal(rounded_poses(found), found)  # what is rounded stays


def test_other_last_bits_make_the_same_poses():
    other = (rounded_poses(shaken(POSES)) != rounded_poses(POSES)).any(axis=(1, 2))
    assert other.mean() < 1e-3  # a number that lies between two of the grid, once in a hundred thousand


def test_quarter_turns_are_exact_and_zeros_have_no_sign():
    turns = Rotation.create_group("O").as_matrix()
    for made in (turns, turns + 1e-16 * GENERATOR.normal(size=turns.shape)):
        found = rounded_poses(pose(made, np.full(3, -1e-17)))
        np.testing.assert_array_equal(found[:, :3, :3], np.rint(turns))
        assert not np.signbit(found[found == 0]).any()


def test_far_away_it_is_micrometres():
    found = rounded_numbers([123456.123456789123, 4e6 + 0.123456789, -2e9 - 0.25])
    np.testing.assert_allclose(found, [123456.123456789, 4000000.123457, -2000000000.25], rtol=0, atol=1e-10)


def test_a_path_is_rounded_between_its_poses_too_and_its_motion_is_not():
    path = evenly_stamped(POSES[:6], 10.0)
    found = rounded_path(path)
    assert rounded_path(found) is found
    np.testing.assert_array_equal(found.pose_at(0.234), rounded_poses(path.pose_at(0.234)))
    times_s = np.linspace(0, 0.5, 7)
    np.testing.assert_array_equal(found.poses_at(times_s), rounded_poses(path.poses_at(times_s)))
    here, there = (item.continuous.motion_at(times_s) for item in (found, path))
    np.testing.assert_array_equal(here.acceleration_m_s2, there.acceleration_m_s2)


def test_what_a_path_knows_stays():
    posed = np.array([True, False, True])
    path = Trajectory(POSES[:3], np.arange(3.0), ("read twice",), posed, shots=np.array([0, 0, 1]))
    found = rounded_path(path)
    assert (found.notes, found.known.tolist(), found.cuts_between(1, 2)) == (path.notes, posed.tolist(), True)
    alone = rounded_path(replace(path, posed=None, independent="each stands by itself"))
    with pytest.raises(NoisyWorldError, match="each stands by itself"):
        alone.pose_at(0.5)
