# SPDX-License-Identifier: GPL-3.0-or-later
"""The lens's blurs against float64 loops, closed forms and the published tables."""

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from weather import SIZES, frame, picture, run

from noisy_world.perturbations.shipped import defocus_blur, gaussian_blur, glass_blur, motion_blur
from noisy_world.perturbations.shipped._arrays import correlate, disk_kernel, line_kernel

MODULES = {module.PERTURBATION.name: module for module in (defocus_blur, gaussian_blur, glass_blur, motion_blur)}
NAMES = sorted(MODULES)

# The paper's table "Specific configurations of the RGB imaging perturbations", severities 1 to 5.
TABLE = {
    "defocus_blur": [(3, 0.1), (4, 0.5), (6, 0.5), (8, 0.5), (10, 0.5)],
    "glass_blur": [(0.7, 1, 2), (0.9, 2, 1), (1.0, 2, 3), (1.1, 3, 2), (1.5, 4, 2)],
    "motion_blur": [(10, 3), (15, 5), (15, 8), (15, 12), (20, 15)],
    "gaussian_blur": [(1,), (2,), (3,), (4,), (6,)],
}
KEYS = {
    "defocus_blur": ("radius_px", "alias_sigma_px"),
    "glass_blur": ("sigma_px", "max_delta_px", "iterations"),
    "motion_blur": ("radius_px", "sigma_px"),
    "gaussian_blur": ("sigma_px",),
}


def pixel(rgb, row, column):
    """The value at a place that may lie outside: then the border's."""
    return rgb[min(max(row, 0), rgb.shape[0] - 1), min(max(column, 0), rgb.shape[1] - 1)].astype(np.float64)


def correlated(rgb, taps):
    """Sum of weight * value at (row + down, column + right), pixel by pixel, in float64."""
    expected = np.zeros(rgb.shape)
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            expected[row, column] = sum(
                weight * pixel(rgb, row + down, column + right) for (down, right), weight in taps.items()
            )
    return expected


@cases("name", NAMES)
@cases("severity", [1, 2, 3, 4, 5])
def test_the_severities_are_the_papers(name, severity):
    parameters = MODULES[name].PERTURBATION.at_severity(severity)
    assert tuple(getattr(parameters, key) for key in KEYS[name]) == TABLE[name][severity - 1]


@cases("size", SIZES)
@cases("sigma", [0.7, 1.0, 3.0])
def test_gaussian_blur_is_a_gaussian_cut_at_four_sigma(size, sigma):
    reach = int(4 * sigma + 0.5)
    weights = [math.exp(-(k**2) / (2 * sigma**2)) for k in range(-reach, reach + 1)]
    rgb = picture(size).astype(np.float64)
    for axis in (0, 1):
        padded = np.pad(rgb, [(reach, reach) if axis == side else (0, 0) for side in range(3)], mode="edge")
        shifted = [np.take(padded, range(k, k + size[axis]), axis) for k in range(2 * reach + 1)]
        rgb = sum(weight * part for weight, part in zip(weights, shifted, strict=True)) / sum(weights)
    assert np.abs(run("gaussian_blur", picture(size), sigma_px=sigma) - rgb).max() < 2e-6


@cases("size", SIZES)
@cases(("radius", "alias"), [(3, 0.1), (4, 0.5), (2.5, 0.5), (1, 0)])
def test_defocus_blur_is_a_softened_disk(size, radius, alias):
    inside = [(y, x) for y in range(-5, 6) for x in range(-5, 6) if y * y + x * x <= radius**2]
    soft = {k: math.exp(-(k**2) / (2 * alias**2)) if alias else float(k == 0) for k in range(-2, 3)}
    softening = {
        (down, right): above * beside / sum(soft.values()) ** 2
        for (down, above), (right, beside) in itertools.product(soft.items(), repeat=2)
    }
    expected = correlated(correlated(picture(size), softening), dict.fromkeys(inside, 1 / len(inside)))
    result = run("defocus_blur", picture(size), radius_px=radius, alias_sigma_px=alias)
    assert np.abs(result - expected).max() < 1e-5


@cases("radius", [3, 4, 6, 8, 10])
def test_the_disk_keeps_the_light_and_has_a_disks_spread(radius):
    point = np.zeros((61, 61, 3), dtype=np.float32)
    point[30, 30] = 1
    kernel = run("defocus_blur", point, radius_px=float(radius), alias_sigma_px=0.5)[..., 1].astype(np.float64)
    offsets = np.arange(-30, 31)
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    # Of a disk r^2 / 4, of the Gaussian sigma^2; the raster's disk differs from the round one by a few percent.
    assert (kernel.sum(axis=0) * offsets**2).sum() == pytest.approx(radius**2 / 4 + 0.25, rel=0.08)
    assert np.abs(kernel - kernel.T).max() < 1e-6
    assert np.abs(kernel - kernel[::-1]).max() < 1e-6
    assert disk_kernel(radius).sum(dtype=np.float64) == pytest.approx(1, abs=1e-6)


@cases("size", [5, 15, 21])
def test_a_dense_kernel_is_correlated_as_a_sparse_one(size):
    kernel = np.random.default_rng(size).random((size, size), dtype=np.float32) / size**2
    middle = size // 2
    taps = {(y - middle, x - middle): float(weight) for (y, x), weight in np.ndenumerate(kernel)}
    assert np.abs(correlate(picture((11, 9)), kernel) - correlated(picture((11, 9)), taps)).max() < 1e-5


def trail(radius, sigma, angle_deg):
    """Ten lines after the definition: one pixel further along the line for each step, rounded half down."""
    taps, angle = Counter(), math.radians(angle_deg)
    total = sum(math.exp(-(k**2) / (2 * sigma**2)) for k in range(2 * radius + 1))
    for k in range(2 * radius + 1):
        place = math.ceil(k * math.sin(angle) - 0.5), math.ceil(k * math.cos(angle) - 0.5)
        taps[place] += math.exp(-(k**2) / (2 * sigma**2)) / total
    return taps


@cases("size", SIZES)
@cases("severity", [1, 3, 5])
def test_motion_blur_is_a_one_sided_trail(size, severity):
    angle = frame().pattern_stream().uniform(-45, 45)
    expected = correlated(picture(size), trail(*TABLE["motion_blur"][severity - 1], angle))
    assert np.abs(run("motion_blur", picture(size), severity) - expected).max() < 1e-5


@cases("angle", [-135, -90, -45, -20, 0, 30, 45, 90, 170])
def test_a_trail_in_any_direction(angle):
    rgb = picture((9, 33))
    expected = correlated(rgb, trail(12, 8.0, angle))
    assert np.abs(correlate(rgb, line_kernel(12, 8.0, angle)) - expected).max() < 1e-5
    grey = np.ascontiguousarray(rgb[..., 0])
    assert np.abs(correlate(grey, line_kernel(12, 8.0, angle)) - expected[..., 0]).max() < 1e-5


def test_the_trails_angle_is_uniform_and_new_in_each_frame():
    point = np.zeros((41, 41, 3), dtype=np.float32)
    point[20, 20] = 1
    rows, columns = np.mgrid[-20:21, -20:21]
    angles = []
    for index in range(400):
        spread = run("motion_blur", point, where=frame(index), radius_px=9, sigma_px=100.0)[..., 0]
        angles.append(math.degrees(math.atan2((spread * rows).sum(), (spread * columns).sum())))
    # The point is smeared to the left: what is right of a pixel is what it sees later.
    turned = np.array([(angle + 180 + 180) % 360 - 180 for angle in angles])
    assert np.abs(turned).max() < 47
    below = np.array([(turned < limit).mean() for limit in range(-40, 41, 10)])
    uniform = (np.arange(-40, 41, 10) + 45) / 90
    assert np.abs(below - uniform).max() < 1.63 / math.sqrt(400) + 0.02  # Kolmogorov-Smirnov at 1 %, and the raster


def offsets_of_the_loop(delta, side, seed):
    """Run the published loop on a picture of places: last pixel first, in place, copies from [-delta, delta)."""
    generator = np.random.default_rng(seed)
    places = [[(row, column) for column in range(side)] for row in range(side)]
    moves = generator.integers(-delta, delta, (side, side, 2)).tolist()
    for row in range(side - delta, delta, -1):
        for column in range(side - delta, delta, -1):
            right, down = moves[row][column]
            places[row][column] = places[row + down][column + right]
    inner = range(12 * delta, side - 12 * delta)
    return Counter((places[row][column][0] - row, places[row][column][1] - column) for row in inner for column in inner)


@pytest.mark.one_python
@cases("delta", [1, 2, 3, 4])
def test_glass_blur_draws_what_the_published_loop_gives(delta):
    counted = Counter()
    for seed in range(3):
        counted += offsets_of_the_loop(delta, 200 + 20 * delta, seed)
    total = sum(counted.values())
    shares = glass_blur.offset_shares(delta)
    reach = shares.shape[0] // 2
    assert shares.sum() == pytest.approx(1, abs=1e-3)
    difference = sum(
        abs(counted[row - reach, column - reach] / total - share) for (row, column), share in np.ndenumerate(shares)
    )
    kinds = sum(share > 0.5 / total for share in shares.ravel())
    assert difference < 3 * math.sqrt(kinds / total)  # the sum of the counts' errors, neighbours sharing their chains
    for axis in (0, 1):
        spread = sum(count * key[axis] ** 2 for key, count in counted.items()) / total
        drawn = (shares.sum(axis=1 - axis) * (np.arange(-reach, reach + 1) ** 2)).sum()
        assert spread == pytest.approx(drawn, rel=0.06)


@cases("delta", [1, 2, 4])
def test_glass_blur_takes_whole_pixels_from_where_it_says(delta):
    places = np.zeros((120, 150, 3), dtype=np.float32)
    places[..., 0], places[..., 1] = np.arange(120)[:, None] / 256, np.arange(150) / 256
    result = run("glass_blur", places, sigma_px=0.0, max_delta_px=delta, iterations=1)
    rows = (result[..., 0] * 256 - np.arange(120)[:, None])[30:-30, 30:-30]
    columns = (result[..., 1] * 256 - np.arange(150))[30:-30, 30:-30]
    assert np.array_equal(rows, np.rint(rows))
    assert np.array_equal(columns, np.rint(columns))
    shares = glass_blur.offset_shares(delta)
    reach = shares.shape[0] // 2
    steps = np.arange(-reach, reach + 1)
    for drawn, marginal in ((rows, shares.sum(axis=1)), (columns, shares.sum(axis=0))):
        mean, spread = (marginal * steps).sum(), (marginal * steps**2).sum()
        assert drawn.mean() == pytest.approx(mean, abs=5 * math.sqrt(spread / drawn.size))
        assert (drawn.astype(np.float64) ** 2).mean() == pytest.approx(spread, rel=0.15)
    neighbours = np.corrcoef(rows[:, :-1].ravel(), rows[:, 1:].ravel())[0, 1]
    assert abs(neighbours) < 5 / math.sqrt(rows.size)


@cases("delta", [1, 2, 3, 4, 7, 10])
def test_the_glass_table_has_65536_entries(delta):
    offsets = glass_blur._offsets(delta)
    assert offsets.shape == (65536,)
    assert not offsets.flags.writeable


@cases("name", NAMES)
@cases("severity", [1, 2, 2.5, 3, 4, 5])
@cases("level", [0.0, 0.37, 1.0])
def test_a_constant_frame_stays_as_it_is(name, severity, level):
    flat = np.full((23, 40, 3), level, dtype=np.float32)
    assert np.abs(run(name, flat, severity) - np.float32(level)).max() < 1e-6


@cases("name", NAMES)
def test_no_light_is_lost(name):
    point = np.zeros((151, 151, 3), dtype=np.float32)
    point[60:91, 60:91] = picture((31, 31))
    result = run(name, point, 5)
    # Glass takes pixels at random: its light is kept on average only.
    assert result.sum(dtype=np.float64) == pytest.approx(
        point.sum(dtype=np.float64), rel=0.1 if name == "glass_blur" else 1e-5
    )


def test_without_a_shuffle_glass_is_two_blurs():
    rgb = picture((20, 30))
    parameters = replace(glass_blur.PERTURBATION.at_severity(3), max_delta_px=0)
    twice = run("gaussian_blur", run("gaussian_blur", rgb, sigma_px=1.0), sigma_px=1.0)
    assert np.array_equal(glass_blur.apply(rgb, parameters, frame()), twice)
