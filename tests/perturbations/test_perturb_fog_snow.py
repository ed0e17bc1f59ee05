# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog and snow against closed forms and loops of their definitions."""

import math

import cv2
import numpy as np
import pytest
from cases import cases

from weather import TABLE, flat, frame, picture, run

from noisy_world.perturbations.shipped import fog

# Fog


def diamond_square(cells, smoothness, draw):
    """Make the plasma point by point in float64: `draw` gives the deviations of a level, three to a cell."""
    levels = cells.bit_length() - 1
    points = {(0, 0): 0.0}
    for level in range(levels):
        step, count = cells >> level, 1 << level
        half, size = step // 2, smoothness ** (-2 * level)
        deviations = (2 * draw((3, count, count)).astype(np.float64) - 1) * size

        def mean(*places):
            return sum(points[row % cells, column % cells] for row, column in places) / 4  # noqa: B023

        corners = [(row, column) for row in range(count) for column in range(count)]
        for i, j in corners:
            y, x = i * step, j * step
            around = mean((y, x), (y, x + step), (y + step, x), (y + step, x + step))
            points[y + half, x + half] = around + deviations[0, i, j]
        edges = {}
        for i, j in corners:
            y, x = i * step, j * step
            edges[y, x + half] = (
                mean((y, x), (y, x + step), (y + half, x + half), (y - half, x + half)) + deviations[1, i, j]
            )
            edges[y + half, x] = (
                mean((y, x), (y + step, x), (y + half, x + half), (y + half, x - half)) + deviations[2, i, j]
            )
        points |= edges
    field = np.array([[points[row, column] for column in range(cells)] for row in range(cells)])
    return (field - field.min()) / (field.max() - field.min())


@cases("size", [(2, 2), (3, 4), (32, 32), (20, 29)])
@cases("severity", [1, 5])
def test_fog_is_the_plasma_scaled_by_the_brightest(size, severity):
    thickness, smoothness = TABLE["fog"][severity - 1]
    cells = 1 << (max(size) - 1).bit_length()
    generator = frame().pattern_stream()
    plasma = diamond_square(cells, smoothness, lambda shape: generator.random(shape, dtype=np.float32))
    rgb = picture(size) * np.float32(0.8)
    brightest = float(rgb.max())
    haze = plasma[: size[0], : size[1], None]
    expected = (rgb + thickness * haze) * brightest / (brightest + thickness)
    assert np.abs(run("fog", rgb, severity) - expected).max() < 1e-5


@cases("severity", [1, 3, 5])
def test_fog_leaves_out_only_what_nobody_sees(severity, monkeypatch):
    rgb = flat((700, 1030), 0.5)
    rgb[0, 0] = 1
    quick = run("fog", rgb, severity)
    with monkeypatch.context() as patched:
        patched.setattr(fog, "_levels_seen", lambda levels, *_: levels)
        whole = run("fog", rgb, severity)
    assert 0 < np.abs(whole - quick).max() < 2.5 / 255
    assert np.sqrt(((whole - quick) ** 2).mean()) < 0.5 / 255


@pytest.mark.one_python
@cases("smoothness", [1.4, 2.0])
def test_fogs_haze_is_as_often_bright_as_dark(smoothness):
    ones = flat((20, 32), 1.0)
    hazes = [run("fog", ones, where=frame(k), thickness=1.0, smoothness=smoothness) * 2 - 1 for k in range(500)]
    means = [haze.mean() for haze in hazes]
    # Negated deviations are as likely, so the mean is 1/2 exactly.
    assert np.mean(means) == pytest.approx(0.5, abs=4 * float(np.std(means)) / math.sqrt(500))
    assert min(haze.min() for haze in hazes) > -1e-6
    assert max(haze.max() for haze in hazes) < 1 + 1e-6


def test_a_smaller_smoothness_makes_rougher_fog():
    ones = flat((64, 64), 1.0)
    rough = [
        np.abs(np.diff(run("fog", ones, thickness=1.0, smoothness=smoothness)[..., 0], axis=1)).mean()
        for smoothness in (1.0, 1.4, 2.0, 4.0)
    ]
    assert rough == sorted(rough, reverse=True)


def test_uniform_fog_is_the_papers_blend_with_a_grey():
    rgb = picture((9, 12))
    rgb[0, 0] = 1.0
    share = 2.5 / (1 + 2.5)
    assert np.abs(run("fog", rgb, uniform=True) - ((1 - share) * rgb + share * 0.5)).max() < 1e-6


def test_fog_over_darkness_is_dark_and_no_fog_is_nothing():
    assert not run("fog", flat((10, 10))).any()
    rgb = picture((10, 10))
    result = run("fog", rgb, thickness=0.0)
    assert np.array_equal(result, rgb)
    assert result is not rgb
    assert not run("fog", flat((10, 10)), thickness=0.0).any()


def test_fog_flows_to_the_right_without_an_edge():
    ones = flat((64, 64), 1.0)
    first = run("fog", ones, where=frame(0, "drift"), flow_px=4.0)
    for index in (1, 5, 1000):
        later = run("fog", ones, where=frame(index, "drift"), flow_px=4.0)
        assert np.abs(later - np.roll(first, 4 * index, axis=1)).max() < 1e-5


# Snow


def test_whitening_without_flakes():
    rgb = picture((9, 12))
    grey = rgb.astype(np.float64) @ [0.299, 0.587, 0.114]
    expected = 0.7 * rgb + 0.3 * np.maximum(rgb, 1.5 * grey[..., None] + 0.5)
    assert np.abs(run("snow", rgb, threshold=2.0, std=0.0) - expected).max() < 1e-5


def test_both_layers_of_flakes_are_clipped_and_added():
    assert np.abs(run("snow", flat((20, 30)), mean=0.6, std=0.0, threshold=0.5, blending_ratio=1.0) - 1.2).max() < 1e-5
    assert np.abs(run("snow", flat((20, 30)), mean=1.6, std=0.0, threshold=0.5, blending_ratio=1.0) - 2).max() < 1e-5


def test_the_layers_are_each_other_turned_by_180_degrees():
    flakes = run("snow", flat((61, 90)), blending_ratio=1.0)
    assert flakes.max() > 0.1
    assert np.abs(flakes - flakes[::-1, ::-1]).max() < 1e-6
    assert np.array_equal(flakes[..., 0], flakes[..., 1])
    assert np.array_equal(flakes[..., 0], flakes[..., 2])


@cases("severity", [1, 2, 3, 4, 5])
def test_as_much_snow_as_the_enlarged_noise_above_the_threshold_gives(severity):
    mean, std, scale, threshold, *_ = TABLE["snow"][severity - 1]
    size = (400, 600)
    cells = [math.ceil(length / scale) for length in size]
    expected = []
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(mean, std, cells)
        # Linear enlargement, end points on end points, one axis after the other.
        for axis, length in enumerate(size):
            places = np.linspace(0, cells[axis] - 1, length)
            low = np.minimum(np.floor(places).astype(int), cells[axis] - 2)
            share = (places - low).reshape([-1, 1] if axis == 0 else [1, -1])
            noise = np.take(noise, low, axis) * (1 - share) + np.take(noise, low + 1, axis) * share
        expected.append(2 * np.clip(np.where(noise < threshold, 0, noise), 0, 1).mean())
    drawn = [run("snow", flat(size), severity, frame(k), blending_ratio=1.0).mean(dtype=float) for k in range(6)]
    assert np.mean(drawn) == pytest.approx(np.mean(expected), rel=0.06)


def test_streaks_run_down_within_45_degrees():
    for index in range(6):
        flakes = run("snow", flat((240, 320)), where=frame(index), blending_ratio=1.0)[..., 0]
        # Along a streak the brightness changes least: the structure tensor's smaller eigenvector.
        along_x, along_y = cv2.Sobel(flakes, cv2.CV_64F, 1, 0), cv2.Sobel(flakes, cv2.CV_64F, 0, 1)
        tensor = np.array(
            [
                [(along_x**2).sum(), (along_x * along_y).sum()],
                [(along_x * along_y).sum(), (along_y**2).sum()],
            ]
        )
        streak = np.linalg.eigh(tensor)[1][:, 0]
        assert abs(streak[1]) > math.cos(math.radians(50))


def test_snow_falls():
    first, later = (
        run("snow", flat((300, 300)), where=frame(k, "drift"), blending_ratio=1.0, fall_px=4.0)[..., 0] for k in (2, 4)
    )
    (right, down), response = cv2.phaseCorrelate(first, later, cv2.createHanningWindow((300, 300), cv2.CV_32F))
    assert response > 0.3
    assert down == pytest.approx(8, abs=0.6)
    assert abs(right) < 8.6
