# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatter's node group against closed forms and beside its reference, drop for drop alike in distribution."""

import math

import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import by_nodes, by_reference, levels_apart, picture, radial_power

# The paper's: mean, std, sigma and threshold of the noise.
TABLE = {
    1: (0.65, 0.3, 4, 0.69),
    2: (0.65, 0.3, 3, 0.68),
    3: (0.65, 0.3, 2, 0.68),
    4: (0.65, 0.3, 1, 0.65),
    5: (0.67, 0.4, 1, 0.65),
}


def flat(height, width, level=0.0):
    return np.full((height, width, 3), level, dtype=np.float32)


def covers(make, severity, frames, size=(340, 600), **values):
    """How much the drops change, of what the colour can: (frames, H, W)."""
    level = 0.0 if severity < 4 else 1.0
    made = make("spatter", flat(*size, level), frames, severity=severity, **values)
    return np.stack([np.abs(image[..., 1] - level) for image in made])


@cases("severity", TABLE)
def test_as_many_drops_as_the_smoothed_noise_gives(severity):
    mean, std, sigma, threshold = TABLE[severity]
    # White noise through a Gaussian of sigma keeps the share 1 / (2 sigma sqrt(pi)) of its deviation.
    limit = (threshold - mean) / (std / (2 * sigma * math.sqrt(math.pi)))
    # Mud with edges that are not smoothed covers the drops exactly.
    mud = covers(by_nodes, severity, range(4), complexity=1, scaling=0.0) > 1e-3
    assert mud[:, 20:-20, 20:-20].mean() == pytest.approx(0.5 * math.erfc(limit / math.sqrt(2)), rel=0.1)


@cases("severity", [3, 5])
def test_the_spectrum_is_the_references(severity):
    check_spectrum(severity)


@pytest.mark.long
@cases("severity", [2, 4])
def test_the_spectrum_is_the_references_at_other_severities(severity):
    check_spectrum(severity)


def check_spectrum(severity):
    powers, means = [], []
    for make in (by_nodes, by_reference):
        drops = covers(make, severity, range(8))
        powers.append(np.mean([radial_power(drop) for drop in drops], axis=0))
        means.append(drops.mean())
    ratios = (powers[0] / powers[1])[4:]  # below them a small frame has few waves
    assert ratios.min() > 0.82
    assert ratios.max() < 1.18
    assert abs(means[0] - means[1]) * 255 < 1.8


@pytest.mark.long
def test_few_large_drops_at_severity_1():
    ours, theirs = covers(by_nodes, 1, range(24)), covers(by_reference, 1, range(96))
    # The reference's brightness jumps where Canny overlooks a drop: compared are the drops, each frame at its own.
    spectra = [
        np.mean([radial_power(drop / np.sqrt((drop**2).mean())) for drop in drops], axis=0) for drops in (ours, theirs)
    ]
    ratios = (spectra[0] / spectra[1])[4:]
    assert ratios.min() > 0.8
    assert ratios.max() < 1.25
    decibels = [-10 * np.log10((drops**2).mean(axis=(1, 2))) for drops in (ours, theirs)]
    # Brighter by 1.8 dB on the average of 240 frames, by those jumps; the spread of a frame is 4, of ours 2.7.
    assert np.mean(decibels[0]) - np.mean(decibels[1]) == pytest.approx(1.8, abs=2.0)


@cases("severity", [2, 3])
def test_rims_are_lit_from_the_same_side(severity):
    lean = []
    for make in (by_nodes, by_reference):
        bright, drops = covers(make, severity, range(3)), covers(make, severity, range(3), complexity=1, scaling=0.0)
        slopes = [
            np.mean(
                [(cv2.Sobel(drop, cv2.CV_32F, *way) * light).sum() for drop, light in zip(drops, bright, strict=True)]
            )
            for way in ((1, 0), (0, 1))
        ]
        lean.append(np.array(slopes) / bright.sum())
    assert lean[0] == pytest.approx(lean[1], rel=0.35)
    assert (lean[0] < -0.003).all()  # brightest where a drop ends, to the lower right


def test_the_strongest_place_has_the_scaling():
    drops = covers(by_nodes, 3, range(3))
    assert drops.max() * 255 / 238 == pytest.approx(0.5, abs=0.02)


@cases("complexity", [0, 1])
def test_no_drop_is_the_identity(complexity):
    image = picture(40, 60)
    (made,) = by_nodes("spatter", image, threshold=2.0, complexity=complexity)
    assert levels_apart(made, image)[0] < 1e-4


def test_mud_everywhere_is_mud():
    (made,) = by_nodes("spatter", picture(40, 60), mean=2.0, std=0.0, complexity=1)
    assert levels_apart(made, np.array([63, 42, 20]) / 255)[0] < 0.01


def test_water_is_pale_and_only_adds():
    image = picture(120, 160) * np.float32(0.4)
    added = by_nodes("spatter", image, severity=3)[0] - image
    assert added.min() > -1e-6
    wet = added[..., 1] > 0.05
    assert wet.any()
    assert np.abs(added[wet] / added[wet][:, 1:2] - np.array([175, 238, 238]) / 238).max() < 1e-3


@cases("severity", [1, 3, 5])
def test_a_preview_has_the_same_drops_half_as_large(severity):
    level = 0.3
    (full,) = by_nodes("spatter", flat(240, 320, level), (7,), severity=severity)
    (half,) = by_nodes("spatter", flat(120, 160, level), (7,), severity=severity, reference_width=320)
    assert np.abs(full - level).max() > 0.05
    assert levels_apart(half, cv2.resize(full, (160, 120), interpolation=cv2.INTER_AREA))[0] < 0.1


@cases("severity", [3, 5])
def test_drops_run_down(severity):
    first, half_way, later = covers(by_nodes, severity, (0, 5, 10), (160, 200), temporal="drift", run_px=0.5)
    inner = slice(50, 130)
    share = later[inner].sum() / first[45:125].sum()  # the brightest drop may be another one
    assert share == pytest.approx(1, abs=0.1)
    assert np.abs(later[inner] - first[45:125] * share).max() < 0.01
    between = (first[48:128] + first[47:127]) / 2
    assert np.abs(half_way[inner] - between * (half_way[inner].sum() / between.sum())).max() < 0.01
