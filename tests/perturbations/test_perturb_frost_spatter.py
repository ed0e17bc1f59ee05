# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost and spatter against closed forms and the pictures that frost is cut from."""

import math

import cv2
import numpy as np
import pytest
from cases import cases

from weather import TABLE, flat, frame, picture, run

from noisy_world.perturbations.shipped import frost

# Spatter


@cases("complexity", [0, 1])
@cases("temporal", ["fresh", "fixed", "drift"])
def test_an_empty_layer_is_the_identity(complexity, temporal):
    rgb = picture((20, 30))
    result = run("spatter", rgb, where=frame(3, temporal), threshold=2.0, complexity=complexity)
    assert np.array_equal(result, rgb)
    assert result is not rgb


def test_mud_everywhere_is_mud():
    result = run("spatter", picture((20, 30)), mean=2.0, std=0.0, complexity=1)
    assert np.abs(result - np.array([63, 42, 20]) / 255).max() < 1e-5


def test_mud_covers_and_water_tints():
    rgb = picture((200, 300))
    muddy = run("spatter", rgb, 5)
    covered = np.abs(muddy - rgb).max(axis=2) > 1e-6
    assert 0.02 < covered.mean() < 0.6
    mud, share = np.array([63, 42, 20]) / 255, None
    share = ((rgb - muddy)[covered] / (rgb - mud)[covered])[np.abs(rgb - mud)[covered].min(axis=1) > 0.1]
    assert share.min() > 0.79
    assert share.max() < 1.001
    assert np.ptp(share, axis=1).max() < 1e-3  # the same in all channels
    added = run("spatter", rgb, 3) - rgb
    assert added.min() > -1e-6
    assert added.max() == pytest.approx(0.5 * 238 / 255, abs=1e-5)  # the layer's strongest place has the scaling
    wet = added[..., 1] > 0.05
    assert np.abs(added[wet] / added[wet][:, 1:2] - np.array([175, 238, 238]) / 238).max() < 1e-4


@cases("severity", [1, 2, 3])
def test_as_many_drops_as_the_smoothed_noise_gives(severity):
    mean, std, sigma, threshold, *_ = TABLE["spatter"][severity - 1]
    # White noise through a Gaussian of sigma keeps the share 1 / (2 sigma sqrt(pi)) of its deviation.
    limit = (threshold - mean) / (std / (2 * sigma * math.sqrt(math.pi)))
    expected = 0.5 * math.erfc(limit / math.sqrt(2))
    shares = []
    for index in range(3):
        # Mud with edges that are not smoothed covers the drops exactly.
        result = run("spatter", flat((500, 700), 1.0), severity, frame(index), complexity=1, scaling=0.0)
        shares.append((result[20:-20, 20:-20, 0] < 0.5).mean())  # repeated border values smooth less
    assert np.mean(shares) == pytest.approx(expected, rel=0.12)


@cases("severity", [3, 5])
def test_spatter_runs_down_without_an_edge(severity):
    black = flat((70, 80))
    first = run("spatter", black, severity, frame(0, "drift"))
    for index, down in ((2, 1), (10, 5), (2 * 70, 70)):
        later = run("spatter", black, severity, frame(index, "drift"))
        assert np.abs(later - np.roll(first, down, axis=0)).max() < 1e-5


# Frost


def test_frost_is_a_weighted_sum():
    rgb = picture((40, 50))
    ice = run("frost", flat((40, 50)), intensity=0.0, influence=1.0)
    assert ice.min() >= 0
    assert ice.max() <= 1
    assert ice.std() > 0.01
    for severity, (intensity, influence) in enumerate(TABLE["frost"], 1):
        assert np.abs(run("frost", rgb, severity) - (intensity * rgb + influence * ice)).max() < 1e-6


def place_in_a_picture(ice):
    """Where the crop comes from: (picture, row, column), or nothing."""
    for number in sorted(set(frost.EQUALLY_OFTEN)):
        difference = cv2.matchTemplate(frost.ice_picture(number)[..., 0], ice[..., 0], cv2.TM_SQDIFF)
        y, x = np.unravel_index(np.argmin(difference), difference.shape)
        if np.array_equal(frost.ice_picture(number)[y : y + ice.shape[0], x : x + ice.shape[1]], ice):
            return number, y, x
    return None


def test_frost_crops_its_pictures_and_squashes_none():
    found = [
        place_in_a_picture(
            np.rint(run("frost", flat((60, 90)), where=frame(index), influence=1.0) * 255).astype(np.uint8)
        )
        for index in range(10)
    ]
    assert None not in found
    assert len(set(found)) == len(found)
    assert len({number for number, _, _ in found}) > 2


@cases("size", [(1900, 300), (300, 2900)])
def test_a_large_frame_enlarges_both_axes_alike(size):
    ice = run("frost", flat(size), influence=1.0)[..., 1]
    blurred = ice - cv2.GaussianBlur(ice, (0, 0), 4)
    down, right = (np.square(np.diff(blurred, axis=axis)).mean() for axis in (0, 1))
    # 2.04 times one axis only would change the ratio of the slopes' squares by about 4.
    assert 0.5 < down / right < 2


def test_the_ice_is_as_bright_as_the_photographs_that_people_compare_with():
    # Their mean is 0.64: 0.4 of it, less what is clipped, is the shift of 60 / 255 at severity 1. They spread 18 to 43.
    pictures = [frost.ice_picture(number) for number in frost.EQUALLY_OFTEN]
    assert np.mean([item.mean() for item in pictures]) / 255 == pytest.approx(0.64, abs=0.04)
    for item in pictures:
        grey = item.mean(axis=2)
        assert 15 < grey.std() < 46
        assert abs(grey[:512].mean() - grey[512:].mean()) < 30


@cases("number", range(4))
def test_the_ice_is_its_grey_file_tinted(number):
    item, tinted = frost.PICTURES[number], frost.ice_picture(number)
    grey = cv2.imread(str(frost.picture_file(item.name)), cv2.IMREAD_GRAYSCALE)[..., None] / 255
    assert tinted.shape == (frost.HEIGHT_PX, frost.WIDTH_PX, 3)
    assert not tinted.flags.writeable
    expected = grey * (np.array(item.shadow_rgb) * (1 - grey) + np.array(item.light_rgb) * grey)
    assert np.abs(tinted - np.clip(expected, 0, 1) * 255).max() < 0.501


def test_frost_creeps_within_its_picture():
    black = flat((60, 90))
    frames = [run("frost", black, where=frame(k, "drift"), creep_px=3.0) for k in (0, 1, 2, 5000)]
    (right, down), _ = cv2.phaseCorrelate(frames[1][..., 1], frames[2][..., 1])
    assert math.hypot(right, down) == pytest.approx(3, abs=0.7)
    assert frames[3].std() > 0.01
