# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog, fog by depth and snow as node groups: closed forms, and the references' statistics."""

import math

import numpy as np
import pytest

from cases import cases
from group_tools import by_nodes, by_reference, ks_distance, levels_apart, picture, spectrum_ratios
from srgb import encoded, linear


def flat(height, width, value):
    return np.full((height, width, 3), value, np.float32)


# --- fog by depth ---


def koschmieder(value, depth_m, visibility_m, airlight):
    seen = math.exp(math.log(0.05) * depth_m / visibility_m) if depth_m > 0 else 0.0
    return encoded(linear(value) * seen + linear(airlight) * (1 - seen))


DEPTHS_M = np.array([0, 1e-6, 0.5, 1, 2, 3, 4.5, 6, 15, 50, 1e4, 1e10, np.inf, np.nan], np.float32)


@cases("make", [by_nodes, by_reference])
@cases(("severity", "visibility_m"), list(zip((1, 2, 3, 4, 5), (50, 25, 15, 10, 6), strict=True)))
def test_fog_by_depth_is_koschmieders_law(make, severity, visibility_m):
    depth_m = np.repeat(DEPTHS_M[None], 9, axis=0)
    values = np.linspace(0, 1, 9, dtype=np.float32)
    rgb = np.repeat(np.repeat(values[:, None, None], depth_m.shape[1], axis=1), 3, axis=2)
    (found,) = make("fog_depth", rgb, severity=severity, depth_m=depth_m)
    for row, value in enumerate(values):
        expected = [koschmieder(float(value), float(depth), visibility_m, 0.8) for depth in DEPTHS_M]
        assert np.abs(found[row] - np.array(expected)[:, None]).max() < 0.1 / 255


@cases("make", [by_nodes, by_reference])
def test_at_the_visibility_five_percent_of_the_contrast_are_left(make):
    rgb = flat(4, 4, 0.0)
    rgb[:2] = 1
    depth_m = np.full((4, 4), 12.0, np.float32)
    (found,) = make("fog_depth", rgb, depth_m=depth_m, visibility_m=12.0, airlight=0.6)
    assert linear(found[0, 0, 0]) - linear(found[3, 0, 0]) == pytest.approx(0.05, abs=1e-4)
    assert linear(found[3, 0, 0]) == pytest.approx(0.95 * linear(0.6), abs=1e-4)


def test_fog_by_depth_keeps_to_the_reference_everywhere():
    rgb = picture(61, 93)
    depth_m = np.random.default_rng(1).uniform(0.2, 9, (61, 93)).astype(np.float32)
    depth_m[:20, :30] = 0
    for severity in (1, 3, 5):
        pair = [make("fog_depth", rgb, severity=severity, depth_m=depth_m)[0] for make in (by_nodes, by_reference)]
        assert levels_apart(*pair)[0] < 0.1


# --- fog ---


def new_points(field):
    """What is new on the finest of the points: how far centres and edges' middles are from the mean of four."""
    corners = sum(np.roll(field, shift, (0, 1)) for shift in ((1, 1), (1, -1), (-1, 1), (-1, -1))) / 4
    crosses = sum(np.roll(field, shift, (0, 1)) for shift in ((1, 0), (-1, 0), (0, 1), (0, -1))) / 4
    edges = field - crosses
    return np.concatenate([(field - corners)[1::2, 1::2].ravel(), edges[1::2, ::2].ravel(), edges[::2, 1::2].ravel()])


@cases("smoothness", [1.4, 2.0])
def test_fogs_plasma_is_diamond_and_square_with_uniform_deviations(smoothness):
    images = by_nodes("fog", flat(64, 64, 1.0), range(6), thickness=1.0, smoothness=smoothness)
    fine, coarse = [], []
    for image in images:
        field = image[..., 0].astype(np.float64) * 2 - 1
        assert field.min() == pytest.approx(0, abs=1e-5)
        assert field.max() == pytest.approx(1, abs=1e-5)
        news = [new_points(part) for part in (field, field[::2, ::2], field[::4, ::4])]
        largest = np.abs(news[0]).max()
        for k, new in enumerate(news):  # uniform, and smoothness^2 stronger with each coarser level
            assert np.abs(new).max() / largest == pytest.approx(smoothness ** (2 * k), rel=0.06)
        fine.append(news[0] / largest)
        coarse.append(news[1] / largest / smoothness**2)
    uniform = np.linspace(-1, 1, 100001)
    for new in (np.concatenate(fine), np.concatenate(coarse)):
        assert ks_distance(new, uniform) < 1.63 / math.sqrt(new.size)
        grid = np.abs(np.corrcoef(new[:-1], new[1:])[0, 1])
        assert grid < 4 / math.sqrt(new.size)


def test_fog_is_scaled_by_the_brightest():
    rgb = picture(20, 30) * np.float32(0.7)
    brightest = float(rgb.max())
    (found,) = by_nodes("fog", rgb, thickness=2.0, uniform=True)
    assert np.abs(found - (rgb + 1.0) * brightest / (brightest + 2.0)).max() < 1e-5
    (found,) = by_nodes("fog", rgb, thickness=2.0)
    (white,) = by_nodes("fog", flat(20, 30, 1.0), thickness=2.0)
    haze = white * 3.0 - 1.0  # thickness 2, brightest 1
    assert np.abs(found - (rgb + haze) * brightest / (brightest + 2.0)).max() < 1e-5
    assert np.array_equal(by_nodes("fog", rgb, thickness=0.0)[0], rgb)
    assert not by_nodes("fog", flat(33, 17, 0.0), severity=5)[0].any()


def test_fog_has_the_references_statistics():
    rgb, count = flat(85, 150, 1.0), 40
    made = [np.array(make("fog", rgb, range(count), severity=5)) for make in (by_nodes, by_reference)]
    means = [item.mean(axis=(1, 2, 3)) for item in made]
    spread = math.hypot(*(item.std() for item in means)) / math.sqrt(count)
    assert abs(means[0].mean() - means[1].mean()) < 4 * spread
    steps = [np.diff(item[..., 0].astype(np.float64), axis=1) for item in made]
    assert steps[0].std() / steps[1].std() == pytest.approx(1, abs=0.12)


def test_fog_flows_to_the_right_around_a_torus():
    rgb = flat(40, 64, 1.0)
    frames = by_nodes("fog", rgb, (0, 1, 21), temporal="drift", flow_px=3.0)
    assert np.abs(np.roll(frames[0], 3, axis=1) - frames[1]).max() < 1e-4
    assert np.abs(np.roll(frames[0], 63, axis=1) - frames[2]).max() < 1e-4


# --- snow ---


def test_where_no_flake_is_the_image_is_whitened():
    rgb = picture(33, 47)
    (found,) = by_nodes("snow", rgb, mean=-1.0, std=0.0, threshold=0.5, blending_ratio=0.6)
    grey = rgb @ np.array([0.299, 0.587, 0.114])
    white = np.maximum(rgb, (grey * 1.5 + 0.5)[..., None])
    assert np.abs(found - np.clip(0.6 * rgb + 0.4 * white, 0, 1)).max() < 1e-5


def test_flakes_have_the_brightness_of_the_thresholded_normal():
    given = {"mean": 0.1, "std": 0.1, "scale": 1.0, "threshold": 0.2, "blending_ratio": 1.0}
    found = np.array(by_nodes("snow", flat(200, 300, 0.0), range(3), blur_radius_px=6, blur_sigma_px=4.0, **given))
    # E[x; x > mean + std] of a normal; two layers; 180,000 numbers a layer.
    expected = 2 * (0.1 * 0.5 * math.erfc(1 / math.sqrt(2)) + 0.1 * math.exp(-0.5) / math.sqrt(2 * math.pi))
    assert found.mean() == pytest.approx(expected, abs=4 * 2 * 0.1 / math.sqrt(180000))


def test_a_flake_without_a_streak_is_a_point():
    given = {"mean": 0.1, "std": 0.1, "scale": 1.0, "threshold": 0.3, "blending_ratio": 1.0}
    (found,) = by_nodes("snow", flat(120, 180, 0.0), blur_radius_px=0, blur_sigma_px=1.0, **given)
    layer = found[..., 0]
    # Of two layers, each beyond two standard deviations.
    assert (layer > 0.05).mean() == pytest.approx(math.erfc(2 / math.sqrt(2)), abs=0.006)
    below = layer[1:] - layer.mean()
    assert abs((below * (layer[:-1] - layer.mean())).mean() / layer.var()) < 0.05


def test_snow_has_the_references_spectrum():
    check_spectrum(2)


@pytest.mark.long
@cases("values", [{"severity": 5}, {"severity": 3, "coarse": True}])
def test_heavy_snow_has_the_references_spectrum(values):
    check_spectrum(**values)


def check_spectrum(severity, **values):
    rgb = flat(340, 600, 0.0)
    ratios = spectrum_ratios("snow", rgb, 8, severity=severity, blending_ratio=1.0, **values)
    # So few draws of the direction: 15 % holds over hundreds of them.
    assert np.abs(np.log(ratios[3:-1])).max() < math.log(1.25)
    assert np.abs(np.log(ratios)).max() < math.log(1.7)


def test_flakes_fall_along_their_streaks():
    rgb = flat(160, 240, 0.0)
    given = {"fall_px": 10.0, "temporal": "drift", "blending_ratio": 1.0}
    before, after = (image[..., 0] for image in by_nodes("snow", rgb, (0, 1), severity=3, **given))

    def likeness(rows, columns):
        one = before[20 : 140 - rows, 30 + max(-columns, 0) : 210 - max(columns, 0)]
        other = after[20 + rows : 140, 30 + max(-columns, 0) + columns : 210 - max(columns, 0) + columns]
        return np.corrcoef(one.ravel(), other.ravel())[0, 1]

    found = {(rows, columns): likeness(rows, columns) for rows in range(16) for columns in range(-12, 13)}
    best = max(found, key=found.get)
    assert abs(best[0] - 10) <= 1
    assert found[best] > 0.9


# --- all of them ---


@cases(("name", "bar"), [("fog", 0.995), ("snow", 0.995)])
def test_a_small_preview_shows_the_same_pattern(name, bar):
    full = by_nodes(name, flat(136, 240, 0.4), severity=4)[0][..., 0]
    small = by_nodes(name, flat(68, 120, 0.4), severity=4, reference_width=240)[0][..., 0]
    shrunk = full.reshape(68, 2, 120, 2).mean(axis=(1, 3))
    assert np.corrcoef(small.ravel(), shrunk.ravel())[0, 1] > bar
