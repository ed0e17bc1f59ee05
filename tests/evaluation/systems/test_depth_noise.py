# SPDX-License-Identifier: GPL-3.0-or-later
"""The noise of a sequence's depth and how much depth counts in ORB-SLAM, where both are known in closed form."""

import math

import cv2
import numpy as np
import pytest

from noisy_world.evaluate.system_input import measured_inverse_depth
from noisy_world.evaluate.system_runs import PROGRAMS

FX, PIXEL_PX, SLOPE = 320.0, 0.9, 0.5


@pytest.fixture
def measured(tmp_path):
    def found(images, scale_per_m=5000.0):
        paths = [tmp_path / f"{k}.png" for k in range(len(images))]
        for path, depth_m in zip(paths, images, strict=True):
            assert cv2.imwrite(str(path), np.round(depth_m * scale_per_m).astype(np.uint16))
        return measured_inverse_depth(paths, scale_per_m)

    return found


@pytest.fixture
def bf_px_m(monkeypatch):
    monkeypatch.syspath_prepend(str(PROGRAMS))
    from orb_settings import bf_px_m

    return lambda inverse: bf_px_m({"camera": {"fx": FX}, "inverse_depth": inverse}, PIXEL_PX, SLOPE)


def wall(depth_m, tilt=0.0):
    """Depth (240, 320) of a plane: 1 / Z is linear in the column, and 1 / depth_m in the middle."""
    per_m = (1.0 + tilt * (np.arange(320) - 159.5) / 320.0) / depth_m
    return np.broadcast_to(1.0 / per_m, (240, 320))


@pytest.mark.parametrize(("depth_m", "noise_m", "tilt"), [(1.5, 0.02, 0.0), (3.0, 0.05, 0.0), (2.0, 0.01, 0.6)])
def test_noise_on_a_plane_is_found_whatever_its_slope(measured, depth_m, noise_m, tilt):
    random = np.random.default_rng(3)
    clean = wall(depth_m, tilt)
    found = measured([clean + noise_m * clean**2 / depth_m**2 * random.normal(size=clean.shape) for _ in range(12)])
    assert found.median_per_m == pytest.approx(1.0 / depth_m, rel=0.01)
    assert found.noise_per_m == pytest.approx(noise_m / depth_m**2, rel=0.02)


def test_edges_and_holes_are_no_noise_and_rounding_is(measured):
    room = np.array(wall(2.0, tilt=0.6))
    room[:, 100:140] *= 0.5
    room[50:90] = 0.0
    rounding_m = 1.0 / 5000.0 / math.sqrt(12.0)
    median_m = np.median(room[room > 0.0])
    assert measured([room]).noise_per_m == pytest.approx(rounding_m / median_m**2, rel=0.3)
    coarse = measured([wall(2.0)], scale_per_m=10.0)  # steps of 10 cm, on a wall that shows none of them
    assert coarse.noise_per_m == pytest.approx(0.1 / math.sqrt(12.0) / 4.0)


def test_without_depth_there_is_nothing_to_measure(measured, tmp_path):
    assert measured([np.zeros((240, 320))]) is None
    (tmp_path / "broken.png").write_bytes(b"\x89PNG")
    assert measured_inverse_depth([tmp_path / "broken.png"], 5000.0) is None
    assert measured_inverse_depth([], 5000.0) is None


def test_errors_of_depth_move_the_column_as_far_as_corners_are_off(bf_px_m):
    for depth_m, noise_m in ((2.0, 1e-9), (1.5, 0.02), (3.0, 0.3)):
        bf = bf_px_m({"median_per_m": 1.0 / depth_m, "noise_per_m": noise_m / depth_m**2})
        read_beside_m = PIXEL_PX / FX * depth_m * SLOPE  # of a corner that is so far off, on a surface of this slope
        assert math.hypot(noise_m, read_beside_m) * abs(bf) / depth_m**2 == pytest.approx(PIXEL_PX)
    assert bf_px_m({"median_per_m": 0.5, "noise_per_m": 1e-9}) / FX == pytest.approx(
        -2.0 / SLOPE
    )  # a baseline of Z / t


def test_no_corner_loses_its_depth_for_a_column_below_0(bf_px_m):
    # Frame::ComputeStereoFromRGBD of ORB-SLAM2 and 3 makes u - bf / Z; what uses it takes less than 0 for no depth.
    bf = bf_px_m({"median_per_m": 0.5, "noise_per_m": 1e-9})
    columns = np.arange(640)
    assert (columns - bf / 2.0 >= 0.0).all()
    assert (columns + bf / 2.0 < 0.0).all()  # with the camera on the other side no corner would have kept it
    assert bf_px_m(None) == pytest.approx(-FX / SLOPE)
