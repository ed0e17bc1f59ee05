"""Noise of depth is measured and averaged out; without noise nothing changes."""

import box_room
import numpy as np
import pytest

from noisy_world.evaluate.frame_tracking import depth_noise_m, smoothed

DEPTH_M = box_room.frame(box_room.path(1)[0])[1].astype(np.float32)


@pytest.mark.parametrize("noise_m", [0.01, 0.05, 0.3])
def test_the_measured_noise_is_that_which_was_added(noise_m):
    noisy = DEPTH_M + np.random.default_rng(3).normal(0.0, noise_m, DEPTH_M.shape).astype(np.float32)
    assert depth_noise_m(noisy) == pytest.approx(noise_m, rel=0.05)


def test_clean_depth_is_left_alone():
    assert smoothed(DEPTH_M) is DEPTH_M


def test_noise_falls_to_a_third_and_voids_stay():
    noisy = DEPTH_M + np.random.default_rng(4).normal(0.0, 0.1, DEPTH_M.shape).astype(np.float32)
    noisy[20:30, 40:60] = np.nan
    out = smoothed(noisy)
    np.testing.assert_array_equal(np.isnan(out), np.isnan(noisy))
    assert np.nanstd(out - DEPTH_M) < 0.1 / 3


def test_void_depth_has_no_noise():
    assert depth_noise_m(np.full((4, 5), np.nan, np.float32)) == 0.0
    assert depth_noise_m(np.ones((4, 2), np.float32)) == 0.0
