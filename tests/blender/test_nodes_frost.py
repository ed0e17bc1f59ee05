# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost's node group beside its reference: the same pictures, cropped, tinted, weighed and moved alike."""

import cv2
import numpy as np
import pytest
from group_tools import by_nodes, by_reference, ks_bar, ks_distance, levels_apart, many_by_nodes, picture, step_of

from noisy_world.perturbations.shipped import frost

FULL_HEIGHT_PX, FULL_WIDTH_PX = 1024, 1536
TABLE = {1: (1.0, 0.4), 2: (0.8, 0.6), 3: (0.7, 0.7), 4: (0.65, 0.7), 5: (0.6, 0.75)}  # the paper's


def flat(height, width, level=0.0):
    return np.full((height, width, 3), level, dtype=np.float32)


def ice_alone(height, width, frames, **values):
    return by_nodes("frost", flat(height, width), frames, intensity=0.0, influence=1.0, **values)


def place(ice):
    """Where a crop comes from: (picture, row, column), and how far it is from that, in 255ths."""
    found = []
    for number in range(4):
        shown = frost.ice_picture(number)
        apart = cv2.matchTemplate(shown[..., 1].astype(np.float32), ice[..., 1] * 255, cv2.TM_SQDIFF)
        row, column = np.unravel_index(np.argmin(apart), apart.shape)
        part = shown[row : row + ice.shape[0], column : column + ice.shape[1]] / np.float32(255)
        found.append((levels_apart(ice, part)[0], number, int(row), int(column)))
    return min(found)


@pytest.fixture(scope="module")
def crops():
    return [place(ice) for ice in ice_alone(96, 128, range(16))]


def test_every_frame_shows_a_picture_uncut_unturned_and_unsquashed(crops):
    assert max(apart for apart, *_ in crops) < 0.6  # the reference rounds its tinted bytes
    assert len({crop[1:] for crop in crops}) == len(crops)


def test_white_ice_comes_twice_as_often(crops):
    counts = np.bincount([number for _, number, _, _ in crops], minlength=4)
    expected = np.array([0.2, 0.4, 0.2, 0.2]) * len(crops)
    assert ((counts - expected) ** 2 / expected).sum() < 11.3  # chi squared of 3 at 1 %


def test_crops_start_anywhere(crops):
    for starts, slack in (
        ([row for *_, row, _ in crops], FULL_HEIGHT_PX - 96),
        ([column for *_, column in crops], FULL_WIDTH_PX - 128),
    ):
        even = (np.arange(10000) + 0.5) / 10000
        assert ks_distance(np.array(starts) / slack, even) < ks_bar(np.array(starts), even)


def test_a_weighted_sum_at_every_severity():
    image = picture(120, 160)
    (ice,) = ice_alone(120, 160, (4,))
    chains = {severity: [step_of("frost", severity=severity)] for severity in TABLE}
    (made,) = many_by_nodes(chains, [image], (4,))
    for severity, (intensity, influence) in TABLE.items():
        expected = np.clip(intensity * image + influence * ice, 0, 1)
        assert levels_apart(made[severity], expected)[0] < 0.01, f"severity {severity}"


def test_as_bright_as_the_reference():
    black = flat(200, 300)
    ours, theirs = (
        [ice.mean() for ice in make("frost", black, range(16), severity=3)] for make in (by_nodes, by_reference)
    )
    spread = np.hypot(np.std(ours), np.std(theirs)) / np.sqrt(16)
    assert abs(np.mean(ours) - np.mean(theirs)) < 3 * spread


def test_a_preview_shows_the_same_ice_half_as_large():
    (full,) = ice_alone(240, 320, (7,))
    (half,) = ice_alone(120, 160, (7,), reference_width=320)
    largest, mean = levels_apart(half, cv2.resize(full, (160, 120), interpolation=cv2.INTER_AREA))
    assert largest < 12  # where the grey has a step: its mean is tinted, not the tints' mean taken
    assert mean < 0.2


def test_the_ice_creeps_to_and_fro():
    frames = ice_alone(96, 128, (0, 1, 2, 4000), temporal="drift", creep_px=3.0)
    (right, down), _ = cv2.phaseCorrelate(frames[1][..., 1], frames[2][..., 1])
    assert np.hypot(right, down) == pytest.approx(3, abs=0.7)
    fixed = ice_alone(96, 128, (0, 9), temporal="fixed")
    assert fixed[0].tobytes() == fixed[1].tobytes() == frames[0].tobytes()
    # Folded back at the picture's ends, not run out of it: no stretched border.
    assert np.abs(np.diff(frames[3][..., 1], axis=0)).mean(axis=1).min() > 1e-4
    assert np.abs(np.diff(frames[3][..., 1], axis=1)).mean(axis=0).min() > 1e-4


def test_a_large_frame_enlarges_both_axes_alike():
    (ice,) = ice_alone(300, 2900, (1,))
    blurred = ice[..., 1] - cv2.GaussianBlur(ice[..., 1], (0, 0), 4)
    down, right = (np.square(np.diff(blurred, axis=axis)).mean() for axis in (0, 1))
    assert 0.5 < down / right < 2
