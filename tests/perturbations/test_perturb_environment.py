# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog, frost, snow and spatter against closed forms, loops of their definitions and the published tables."""

import math
import tracemalloc
import warnings
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from cases import cases

from noisy_world.core.perturbing.kinds import FrameContext
from noisy_world.perturbations import _ice, fog, frost, snow, spatter

MODULES = {module.PERTURBATION.name: module for module in (fog, frost, snow, spatter)}
NAMES = sorted(MODULES)
SIZES = [(1, 1), (1, 7), (7, 1), (2, 3), (13, 17), (31, 8)]

# The paper's table "Specific configurations of the RGB imaging perturbations", severities 1 to 5.
TABLE = {
    "fog": [(1.5, 2.0), (2.0, 2.0), (2.5, 1.7), (2.5, 1.5), (3.0, 1.4)],
    "frost": [(1.0, 0.4), (0.8, 0.6), (0.7, 0.7), (0.65, 0.7), (0.6, 0.75)],
    "snow": [
        (0.1, 0.3, 3, 0.5, 10, 4, 0.8),
        (0.2, 0.3, 2, 0.5, 12, 4, 0.7),
        (0.55, 0.3, 4, 0.9, 12, 8, 0.7),
        (0.55, 0.3, 4.5, 0.85, 12, 8, 0.65),
        (0.55, 0.3, 2.5, 0.85, 12, 12, 0.55),
    ],
    "spatter": [
        (0.65, 0.3, 4, 0.69, 0.6, 0),
        (0.65, 0.3, 3, 0.68, 0.6, 0),
        (0.65, 0.3, 2, 0.68, 0.5, 0),
        (0.65, 0.3, 1, 0.65, 1.5, 1),
        (0.67, 0.4, 1, 0.65, 1.5, 1),
    ],
}
KEYS = {
    "fog": ("thickness", "smoothness"),
    "frost": ("intensity", "influence"),
    "snow": ("mean", "std", "scale", "threshold", "blur_radius_px", "blur_sigma_px", "blending_ratio"),
    "spatter": ("mean", "std", "sigma_px", "threshold", "scaling", "complexity"),
}


def picture(size, seed=0):
    return np.random.default_rng(seed).random((*size, 3), dtype=np.float32)


def flat(size, level=0.0):
    return np.full((*size, 3), level, dtype=np.float32)


def frame(index=0, temporal="fresh", seed=1):
    return FrameContext(index, (seed, "scene", "setting", "weather", 0), temporal)


def run(name, rgb, severity=3, where=None, **given):
    perturbation = MODULES[name].PERTURBATION
    return perturbation.apply(rgb, perturbation.at_severity(severity, **given), where or frame())


@cases("name", NAMES)
@cases("severity", [1, 2, 3, 4, 5])
def test_the_severities_are_the_papers(name, severity):
    parameters = MODULES[name].PERTURBATION.at_severity(severity)
    assert tuple(getattr(parameters, key) for key in KEYS[name]) == TABLE[name][severity - 1]


@cases("name", NAMES)
def test_the_default_is_severity_3(name):
    perturbation = MODULES[name].PERTURBATION
    assert perturbation.parameters() == perturbation.at_severity(3)


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
    for number in sorted(set(_ice.EQUALLY_OFTEN)):
        difference = cv2.matchTemplate(_ice.ice(number)[..., 0], ice[..., 0], cv2.TM_SQDIFF)
        y, x = np.unravel_index(np.argmin(difference), difference.shape)
        if np.array_equal(_ice.ice(number)[y : y + ice.shape[0], x : x + ice.shape[1]], ice):
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
    pictures = [_ice.ice(number) for number in _ice.EQUALLY_OFTEN]
    assert np.mean([picture.mean() for picture in pictures]) / 255 == pytest.approx(0.64, abs=0.04)
    for picture in pictures:
        grey = picture.mean(axis=2)
        assert 15 < grey.std() < 46
        assert abs(grey[:512].mean() - grey[512:].mean()) < 30


@cases("number", range(4))
def test_the_ice_is_its_grey_file_tinted(number):
    item, tinted = _ice.PICTURES[number], _ice.ice(number)
    grey = cv2.imread(str(_ice.picture_file(item.name)), cv2.IMREAD_GRAYSCALE)[..., None] / 255
    assert tinted.shape == (_ice.HEIGHT_PX, _ice.WIDTH_PX, 3)
    assert not tinted.flags.writeable
    expected = grey * (np.array(item.shadow_rgb) * (1 - grey) + np.array(item.light_rgb) * grey)
    assert np.abs(tinted - np.clip(expected, 0, 1) * 255).max() < 0.501


def test_frost_creeps_within_its_picture():
    black = flat((60, 90))
    frames = [run("frost", black, where=frame(k, "drift"), creep_px=3.0) for k in (0, 1, 2, 5000)]
    (right, down), _ = cv2.phaseCorrelate(frames[1][..., 1], frames[2][..., 1])
    assert math.hypot(right, down) == pytest.approx(3, abs=0.7)
    assert frames[3].std() > 0.01


# All four


@cases("name", NAMES)
def test_fresh_patterns_differ_fixed_stay_and_drifting_move_smoothly(name):
    rgb = picture((64, 80))
    fresh = [run(name, rgb, where=frame(k)) for k in range(2)]
    fixed = [run(name, rgb, where=frame(k, "fixed")) for k in (0, 1, 1234)]
    drift = [run(name, rgb, where=frame(k, "drift")) for k in (0, 1)]
    other = run(name, rgb, where=frame(0, "fixed", seed=2))
    assert not np.array_equal(*fresh)
    assert not np.array_equal(fixed[0], other)
    assert not np.array_equal(*drift)
    assert np.array_equal(fixed[0], fixed[1])
    assert np.array_equal(fixed[0], fixed[2])
    if name != "spatter":  # whose border is a torus' where it drifts
        assert np.array_equal(drift[0], fixed[0])


@cases("name", ["fog", "frost", "spatter"])
def test_a_step_of_drift_is_smaller_than_a_fresh_pattern(name):
    black = flat((120, 160), 0.5)
    drift = [run(name, black, where=frame(k, "drift")) for k in (7, 8)]
    fresh = [[run(name, black, where=frame(k, seed=seed)) for k in (7, 8)] for seed in range(6)]
    assert np.abs(drift[0] - drift[1]).mean() < 0.8 * np.mean([np.abs(a - b).mean() for a, b in fresh])


@cases("name", NAMES)
@cases("temporal", ["fresh", "fixed", "drift"])
def test_writing_to_a_result_changes_no_later_one(name, temporal):
    rgb = picture((30, 40))
    for index in (0, 3):
        first = run(name, rgb, where=frame(index, temporal))
        kept = first.copy()
        first[...] = 7
        assert np.array_equal(run(name, rgb, where=frame(index, temporal)), kept)


@cases("name", NAMES)
@cases("size", SIZES)
@cases("severity", [1, 2.5, 3.5, 5])
@cases("temporal", ["fresh", "drift"])
def test_any_size_without_a_warning(name, size, severity, temporal):
    for rgb in (picture(size), flat(size), flat(size, 1.0)):
        before = rgb.copy()
        with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
            warnings.simplefilter("error")
            result = run(name, rgb, severity, frame(2, temporal))
        assert result.shape == rgb.shape
        assert result.dtype == np.float32
        assert np.isfinite(result).all()
        assert result.min() > -1e-6
        assert np.array_equal(rgb, before)
        assert not np.shares_memory(rgb, result)


@cases("name", NAMES)
def test_a_frame_larger_than_the_reference(name):
    result = run(name, flat((1081, 1921), 0.5))
    assert result.shape == (1081, 1921, 3)
    assert np.isfinite(result).all()
    assert result.std() > 0.005


@cases("name", NAMES)
@cases("temporal", ["fresh", "drift"])
def test_same_bytes_alone_in_threads_and_with_any_number_of_cv2_threads(name, temporal):
    rgb, threads = picture((90, 130)), cv2.getNumThreads()
    alone = run(name, rgb, where=frame(5, temporal))
    try:
        for count in (1, 2, 4):
            cv2.setNumThreads(count)
            assert run(name, rgb, where=frame(5, temporal)).tobytes() == alone.tobytes()
    finally:
        cv2.setNumThreads(threads)
    with ThreadPoolExecutor(4) as pool:
        in_sequence = list(pool.map(lambda index: run(name, rgb, where=frame(index, temporal)), range(8)))
    assert in_sequence[5].tobytes() == alone.tobytes()


def test_kept_patterns_do_not_pile_up():
    def spatter_sequences(seeds):
        for seed in seeds:
            run("spatter", flat((200, 200)), where=frame(0, "fixed", seed=seed))

    tracemalloc.start()
    try:
        spatter_sequences(range(20))
        before, _ = tracemalloc.get_traced_memory()
        spatter_sequences(range(20, 60))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 2 * 200 * 200 * 4  # 40 more patterns were drawn
