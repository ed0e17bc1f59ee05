# SPDX-License-Identifier: GPL-3.0-or-later
"""The weight of depth in ORB-SLAM, against depth whose noise and surfaces are known in closed form."""

import math
import sys

import cv2
import numpy as np
import pytest

from noisy_world.evaluation.systems.checking import PROGRAMS

FX, PIXEL_PX, SLOPE = 320.0, 0.9, 0.5


@pytest.fixture
def weight_of(monkeypatch, tmp_path):
    """Return a function of depth images in metres: bf, by the program's own module."""
    monkeypatch.syspath_prepend(str(PROGRAMS))
    from depth_weight import baseline_px_m

    def found(images, scale_per_m=5000.0, pixel_px=PIXEL_PX):
        frames = []
        for k, depth_m in enumerate(images):
            path = tmp_path / f"{k}.png"
            assert cv2.imwrite(str(path), np.round(depth_m * scale_per_m).astype(np.uint16))
            frames.append({"depth": str(path)})
        index = {"camera": {"fx": FX}, "depth_scale_per_m": scale_per_m, "frames": frames}
        return baseline_px_m(index, pixel_px, SLOPE)

    yield found
    sys.modules.pop("depth_weight", None)


def wall(depth_m, tilt=0.0):
    """Depth (240, 320) of a plane: 1 / Z is linear in the column, and 1 / depth_m in the middle."""
    per_m = (1.0 + tilt * (np.arange(320) - 159.5) / 320.0) / depth_m
    return np.broadcast_to(1.0 / per_m, (240, 320))


def test_exact_depth_counts_as_much_as_corners_beside_it_allow(weight_of):
    assert weight_of([wall(2.0)]) == pytest.approx(-FX * 2.0 / SLOPE, rel=1e-3)
    assert weight_of([wall(4.0)], pixel_px=1.8) == pytest.approx(-FX * 4.0 / SLOPE, rel=2e-3)


def test_noise_of_depth_moves_the_column_as_far_as_corners_are_off(weight_of):
    random = np.random.default_rng(3)
    for depth_m, noise_m in ((1.5, 0.02), (3.0, 0.05)):
        images = [wall(depth_m) + noise_m * random.normal(size=(240, 320)) for _ in range(12)]
        bf = weight_of(images)
        of_noise, beside = bf * noise_m / depth_m**2, bf * PIXEL_PX * SLOPE / (FX * depth_m)
        assert math.hypot(of_noise, beside) == pytest.approx(PIXEL_PX, rel=0.02)


def test_coarse_steps_are_noise_and_slopes_edges_and_holes_are_none(weight_of):
    coarse = weight_of([wall(2.0)], scale_per_m=10.0)  # steps of 10 cm on a wall that shows none of it
    assert math.hypot(coarse * 0.1 / math.sqrt(12.0) / 4.0, coarse * PIXEL_PX * SLOPE / (FX * 2.0)) == pytest.approx(
        0.9
    )
    room = np.array(wall(2.0, tilt=0.6))
    room[:, 100:140] *= 0.5
    room[50:90] = 0.0
    assert weight_of([room]) == pytest.approx(-FX * np.median(room[room > 0.0]) / SLOPE, rel=0.01)
    assert weight_of([np.zeros((240, 320))]) == pytest.approx(-FX / SLOPE, rel=1e-3)


def test_no_corner_loses_its_depth_for_a_column_below_0(weight_of):
    # What ORB-SLAM2 and 3 take for depth that is missing: Frame::ComputeStereoFromRGBD and its users test u_r < 0.
    bf = weight_of([wall(2.0)])
    columns = np.arange(640)
    assert (columns - bf / 2.0 >= 0.0).all()
    assert (columns + bf / 2.0 < 0.0).all()  # on the other side no corner would have kept it
