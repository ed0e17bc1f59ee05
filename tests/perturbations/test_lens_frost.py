# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost on the lens against another implementation in float64, and against what frost does: grow, and stay."""

import numpy as np
import pytest
from cases import cases
from scipy import ndimage

from srgb import encoded, linear
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import lens_frost

PERTURBATION = lens_frost.PERTURBATION
SIZES = [(1, 1), (1, 9), (9, 1), (33, 57), (62, 48), (120, 40)]


def context(index=0, temporal="fresh", seed=3):
    return FrameContext(index, (seed, "scene", "setting", "lens_frost", 0), temporal)


def frosted(rgb, severity=3, where=None, **values):
    return PERTURBATION.apply(rgb, PERTURBATION.at_severity(severity, **values), where or context())


def picture(size, seed=0):
    rough = np.random.default_rng(seed).random((*size, 3))
    return (0.7 * ndimage.uniform_filter(rough, (5, 5, 1)) + 0.3 * rough).astype(np.float32)


def expected(rgb, values, pane):
    """The whole effect, pixel by pixel as the docstrings say it, in float64 and by scipy."""
    height, width = rgb.shape[:2]
    zoom = 680 / min(height, width)
    power = min(max(round(np.log2(zoom)), 0), 2)
    shrunk, top = 2**power, 1 + sum((320 >> k) + 1 for k in range(power))
    strip = lens_frost.atlas()[:, top : top + (320 >> power), : 3072 // shrunk] / 255
    strip = np.pad(strip, ((0, 0), (0, 200), (0, 0)), mode="edge")
    rows, columns = np.mgrid[:height, :width] + 0.5
    ways = (
        (columns, rows, width),
        (columns, height - rows, width),
        (rows, columns, height),
        (rows, width - columns, height),
    )
    sides = []
    for number, (along, inwards, length) in enumerate(ways):
        turned = length - along if pane.flipped[number] else along
        place = turned * zoom / shrunk + (pane.start_px + number * 768) // shrunk - 0.5
        deep = np.minimum(inwards * zoom / shrunk - 0.5, strip.shape[1] - 1)
        many = np.concatenate([strip, strip[:, :, :1]], axis=2)
        place %= strip.shape[2]
        ridge, since, body = (ndimage.map_coordinates(part, (deep, place), order=1, mode="nearest") for part in many)
        age = np.maximum(values.coverage * 1.12 - since, 0)
        sides.append((ridge * np.minimum(age / 0.12, 1), body * np.minimum(age / 0.9, 1)))
    ridge, body = np.max(sides, axis=0)
    relief = np.pad(ridge + 0.35 * body, ((0, 1), (0, 1)), mode="edge") / zoom
    right, down = relief[:-1, 1:] - relief[:-1, :-1], relief[1:, :-1] - relief[:-1, :-1]
    light = linear(rgb)
    where = rows - 0.5 + values.refraction_px * down, columns - 0.5 + values.refraction_px * right
    channels = [light[..., k] for k in range(3)]
    behind = np.dstack([ndimage.map_coordinates(part, where, order=1, mode="nearest") for part in channels])
    around = surroundings(light, values, rows, columns)
    seen = np.exp(-values.opacity * (ridge + body))
    lean = right * np.cos(pane.light_rad) + down * np.sin(pane.light_rad)
    white = (1 - seen) * (1 + np.clip(0.5 * lean, -0.2, 0.3)) * values.brightness
    white += values.glint * np.clip(4 * lean - 0.8, 0, 1) ** 2
    return encoded(behind * seen[..., None] + around * white[..., None])


def surroundings(light, values, rows, columns):
    small = light
    for _ in range(3):
        small = np.pad(small, ((0, small.shape[0] % 2), (0, small.shape[1] % 2), (0, 0)), mode="edge")
        small = (small[::2, ::2] + small[1::2, ::2] + small[::2, 1::2] + small[1::2, 1::2]) / 4
    sigma = 0.035 * min(light.shape[:2]) / 8
    mean = small.mean(axis=(0, 1))
    once, twice, five = (
        ndimage.gaussian_filter(small, (wide, wide, 0), mode="nearest", radius=int(np.ceil(3 * wide)))
        for wide in (sigma, 2 * sigma, 5 * sigma)
    )
    far = once + 0.6 * values.halo * (twice - once)
    small = 0.75 * (far + 0.4 * values.halo * (five - far)) + 0.25 * mean
    grey = (small @ [0.2126, 0.7152, 0.0722])[..., None]
    small = grey + values.tint * (small - grey)
    where = rows / 8 - 0.5, columns / 8 - 0.5
    return np.dstack([ndimage.map_coordinates(small[..., k], where, order=1, mode="nearest") for k in range(3)])


@cases("size, halo", [(size, 0.7 * (place % 2)) for place, size in enumerate(SIZES)])
def test_as_another_implementation_has_it(size, halo):
    rgb = picture(size)
    values = PERTURBATION.at_severity(5, refraction_px=25.0, tint=0.8, glint=3.0, coverage=0.9, halo=halo)
    pane = lens_frost.pane_of(context().pattern_stream().random(3))
    found = PERTURBATION.apply(rgb, values, context())
    assert found.dtype == np.float32
    assert np.abs(found - expected(rgb, values, pane)).max() < 4e-4


def test_the_quick_way_pixel_for_pixel_is_the_long_one():
    level = lens_frost.levels()[0]
    quick, long = (lens_frost._part(level, step, 3004, (300, 700)) for step in (1, 1 + 1e-9))
    assert quick.shape == long.shape == (3, 300, 700)
    assert np.abs(quick - long).max() < 1e-5


def test_from_the_border_inwards_and_the_middle_stays_clear():
    rgb = picture((170, 300))
    shares = []
    for severity in (1, 3, 5):
        changed = np.abs(frosted(rgb, severity) - rgb).max(axis=2) > 2 / 255
        shares.append(changed.mean())
        along = np.concatenate([changed[0], changed[-1], changed[:, 0], changed[:, -1]]).mean()
        assert (0.3 < along < 0.75) if severity == 1 else along > 0.9  # the first ice rings no frame
    assert shares[0] < shares[1] < shares[2]
    assert shares[0] < 0.6
    assert not (np.abs(frosted(rgb, 1) - rgb).max(axis=2) > 2 / 255)[65:105, 80:220].any()


@cases("values", [{"coverage": 0.0}, {"opacity": 0.0, "refraction_px": 0.0, "glint": 0.0}])
def test_without_ice_or_what_it_does_the_image_is_unchanged(values):
    rgb = picture((40, 60))
    assert np.abs(frosted(rgb, 5, **values) - rgb).max() < 1e-5


def test_ice_that_is_there_stays_while_it_grows():
    pane = lens_frost.FrostPane(1200, (True, False, True, False), -1.0)
    before = lens_frost.ice_on((90, 150), 0.0, pane)
    assert not np.any(before)
    for grown in (0.1, 0.3, 0.6, 1.0):
        now = lens_frost.ice_on((90, 150), grown, pane)
        assert all((new >= old).all() for new, old in zip(now, before, strict=True))
        assert now[1].sum() > 1.1 * before[1].sum()
        before = now


def test_it_grows_and_thaws_by_the_frames_time_alone():
    rgb = picture((50, 70))
    for index, rate, coverage in ((50, 0.1, 0.55), (50, -0.1, 0.05), (9000, 0.1, 1.0), (9000, -0.1, 0.0)):
        where = context(index, "drift")
        drifted = frosted(rgb, where=where, coverage=0.3, growth_per_s=rate)
        still = frosted(rgb, where=context(7, "fixed"), coverage=coverage)
        assert np.abs(drifted - still).max() < 1e-5


@cases("factor", [4.0, 20.0, 100.0])
def test_in_proportion_to_the_scene_s_light(factor):
    light = linear(picture((60, 80)))
    once = linear(frosted(encoded(light).astype(np.float32), 5, glint=2.0))
    many = linear(frosted(encoded(factor * light).astype(np.float32), 5, glint=2.0))
    assert np.abs(many / factor - once).max() < 2e-4 * once.max()


def test_a_frame_of_half_the_size_shows_the_same_ice():
    pane = lens_frost.FrostPane(40, (False, True, True, False), -1.0)
    whole, half = (lens_frost.ice_on(size, 0.8, pane) for size in ((340, 600), (170, 300)))
    for large, small in zip(whole, half, strict=True):
        mean = large.reshape(170, 2, 300, 2).mean(axis=(1, 3))
        assert np.abs(small - mean).mean() < 0.03
        assert np.corrcoef(small.ravel(), mean.ravel())[0, 1] > 0.97


def test_the_frame_s_levels_are_the_nearest_in_size():
    for zoom in np.geomspace(0.05, 700, 60):
        nearest = min((1, 2, 4), key=lambda shrunk: abs(np.log(zoom / shrunk)))
        assert lens_frost.level_of(float(zoom)).shrunk == nearest


def test_three_uniform_numbers_choose_part_turns_and_light():
    for uniform in ([0.0, 0.0, 0.0], [1 - 1e-16, 1 - 1e-16, 1 - 1e-16]):
        pane = lens_frost.pane_of(np.array(uniform))
        assert pane.start_px == pytest.approx(uniform[0] * 3068, abs=1)
        assert pane.flipped == (uniform[0] > 0,) * 4
        assert -2.36 < pane.light_rad < -0.78
