# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth perturbations against closed forms and plain loops."""

import math

import numpy as np
import pytest
from cases import cases

from noisy_world.images.pixels import quantise_depth
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations import registry

pytestmark = pytest.mark.filterwarnings("error")

DEPTH = ("depth_gaussian_noise", "depth_edge_erosion", "depth_random_missing", "depth_range_clipping")
# The table of the paper, written out again.
TABLES = {
    "depth_gaussian_noise": {"scale": [0.1, 0.2, 0.3, 0.4, 0.5]},
    "depth_edge_erosion": {"rate": [0.015, 0.02, 0.025, 0.03, 0.035]},
    "depth_random_missing": {"missing_percent": [10, 15, 20, 25, 30]},
    "depth_range_clipping": {"min_m": [0.2, 0.3, 0.4, 0.5, 0.6], "max_m": [4.4, 4.2, 4.0, 3.8, 3.6]},
}


def perturbed(name, depth_m, severity=3, frame=0, temporal="fresh", **given):
    item = registry()[name]
    kept = depth_m.copy()
    result = item.apply(depth_m, item.at_severity(severity, **given), FrameContext(frame, ("test", 3), temporal))
    assert result.dtype == np.float32
    assert result.shape == depth_m.shape
    np.testing.assert_array_equal(depth_m, kept)
    assert np.isfinite(result).all()
    assert (result >= 0).all()
    assert not result[~((depth_m > 0) & (depth_m < np.inf))].any()  # void stays void
    return result


def room(height=680, width=1200):
    """A slanted wall, a box in front of it, and a hole."""
    y, x = np.mgrid[:height, :width]
    depth = (2 + x / width + 0.5 * y / height).astype(np.float32)
    depth[height // 4 : height // 2, width // 3 : width // 2] = 1.25
    depth[-height // 5 :, : width // 6] = 0
    return depth


@cases("name", DEPTH)
def test_severities_are_the_papers_and_the_default_is_the_third(name):
    item = registry()[name]
    for key, table in TABLES[name].items():
        assert [getattr(item.at_severity(level), key) for level in range(1, 6)] == table
        assert getattr(item.at_severity(2.5), key) == pytest.approx((table[1] + table[2]) / 2)
    assert item.parameters() == item.at_severity(3)


@cases("severity", [1, 3, 5])
def test_noise_is_normal_in_proportion_to_the_spread_of_the_valid_depths(severity):
    depth = room(900, 1400) + np.float32(3)
    depth[:50] = 0
    valid = depth > 0
    std = TABLES["depth_gaussian_noise"]["scale"][severity - 1] * depth[valid].astype(np.float64).std()
    z = ((perturbed("depth_gaussian_noise", depth, severity).astype(np.float64) - depth) / std)[valid]
    n = z.size
    assert n > 1e6
    assert abs(z.mean()) < 4 / math.sqrt(n)
    assert abs(z.var() - 1) < 4 * math.sqrt(2 / n)
    z = np.sort(z)
    sampled = z[:: n // 20000]
    cdf = np.array([0.5 * (1 + math.erf(value / math.sqrt(2))) for value in sampled])
    assert np.abs(np.searchsorted(z, sampled) / n - cdf).max() < 1.63 / math.sqrt(n)


def test_noise_is_uncorrelated_between_neighbours_and_frames_over_lags_0_to_64():
    depth = np.tile(np.array([4, 6], np.float32), (200, 100))
    noise = [perturbed("depth_gaussian_noise", depth, frame=k).astype(np.float64) - depth for k in range(66)]
    limit = 4.5 / math.sqrt(depth.size) * noise[0].var()
    for a, b in ((noise[0][1:], noise[0][:-1]), (noise[0][:, 1:], noise[0][:, :-1])):
        assert abs((a * b).mean()) < limit
    first, second = noise[0].ravel(), noise[1].ravel()
    for lag in range(65):
        assert abs((first[lag:] * second[: second.size - lag]).mean()) < limit
        assert abs((second[lag:] * first[: first.size - lag]).mean()) < limit
        assert abs((noise[0] * noise[lag + 1]).mean()) < limit


def test_noise_that_leaves_nothing_positive_is_void():
    depth = np.tile(np.array([0.1, 4], np.float32), (300, 100))
    noisy = perturbed("depth_gaussian_noise", depth, 5)
    std = 0.5 * 1.95
    share = 0.5 * (1 + math.erf(-0.1 / std / math.sqrt(2)))
    assert abs(np.mean(noisy[:, ::2] == 0) - share) < 4 * math.sqrt(share * (1 - share) / 30000)
    assert (noisy[noisy != 0] > 0).all()


def test_bias_adds_the_published_offset():
    depth = room(60, 80)
    mean = depth[depth > 0].astype(np.float64).mean()
    valid = depth > 0
    plain, biased = (perturbed("depth_gaussian_noise", depth, 1, bias=bias) for bias in (False, True))
    np.testing.assert_allclose((biased - plain)[valid], 0.1 * mean, atol=1e-5)


def edges_by_loops(depth):
    height, width = depth.shape
    edges = np.zeros(depth.shape, bool)
    for y in range(height):
        for x in range(width):
            here = float(depth[y, x])
            for b, a in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if here > 0 and 0 <= b < height and 0 <= a < width:
                    there = float(depth[b, a])
                    edges[y, x] |= there == 0 or abs(here - there) > 0.05 * min(here, there)
    return edges


def grown(mask, reach):
    result = np.zeros_like(mask)
    for y, x in zip(*np.nonzero(mask), strict=True):
        result[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1] = True
    return result


def scene(seed):
    random = np.random.default_rng(seed)
    depth = random.uniform(2, 2.05, (47, 61)).astype(np.float32)
    depth[10:30, 20:40] *= 1.2
    depth[35:, 5:9] = 0
    depth[random.integers(47, size=4), random.integers(61, size=4)] = 0
    return depth


def test_full_rate_erodes_seven_by_seven_around_every_edge_pixel():
    depth = scene(1)
    lost = grown(edges_by_loops(depth), 3)
    np.testing.assert_array_equal(perturbed("depth_edge_erosion", depth, rate=1.0), np.where(lost, 0, depth))


@cases(("ratio", "is_edge"), [(1.0495, False), (1.0505, True), (1 / 1.0495, False), (1 / 1.0505, True)])
def test_an_edge_is_more_than_5_percent_of_the_nearer_depth(ratio, is_edge):
    depth = np.full((9, 30), 2, np.float32)
    depth[:, 15:] *= np.float32(ratio)
    for image in (depth, np.ascontiguousarray(depth.T)):
        assert (perturbed("depth_edge_erosion", image, rate=1.0) == 0).any() == is_edge


def test_rate_0_loses_nothing_or_the_edges_alone():
    depth = scene(2)
    np.testing.assert_array_equal(perturbed("depth_edge_erosion", depth, rate=0.0), depth)
    expected = np.where(edges_by_loops(depth), 0, depth)
    np.testing.assert_array_equal(perturbed("depth_edge_erosion", depth, rate=0.0, erase_edges=True), expected)


@cases("severity", [1, 3, 5, 2.5])
def test_blocks_lie_on_the_share_of_the_edge_pixels(severity):
    depth = np.full((1, 4000), 2, np.float32)
    depth[0, ::100] = 3  # each with three edge pixels in a row, the first with two
    rate = float(np.interp(severity, range(1, 6), TABLES["depth_edge_erosion"]["rate"]))
    lost = perturbed("depth_edge_erosion", depth, severity)[0] == 0
    ends = np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]]).astype(int)))
    starts, lengths = ends[::2], ends[1::2] - ends[::2]
    np.testing.assert_array_equal((starts + 53) % 100 < 50 + lengths, True)
    count = round(rate * (3 * 40 - 1))
    blocks = np.where(starts == 0, 1, lengths - 6)  # a run of 6 + n pixels holds n neighbours' blocks, or two of three
    assert abs(blocks.sum() - count) <= 1


def test_which_edges_erode_is_uniform_and_fresh():
    depth = np.full((40, 40), 2, np.float32)
    depth[:, 20:] = 3
    hits = np.zeros(40)
    frames = 400
    for frame in range(frames):
        hits += perturbed("depth_edge_erosion", depth, frame=frame, rate=0.0125)[:, 20] == 0  # one of 80 edge pixels
    expected = np.array([min(y, 3) + min(39 - y, 3) + 1 for y in range(40)]) / 40 * frames
    assert (np.abs(hits - expected) < 4.5 * np.sqrt(expected)).all()


def test_slanted_walls_have_no_edges():
    depth = np.multiply.outer(1.04 ** np.arange(30), 1.04 ** np.arange(20)).astype(np.float32)
    np.testing.assert_array_equal(perturbed("depth_edge_erosion", depth, rate=1.0), depth)


@pytest.mark.one_python
@cases("shape", [(32, 32), (33, 47), (120, 160), (680, 1200)])
@cases("percent", [0, 3, 10, 15, 20, 25, 30, 60, 90])
def test_the_share_that_is_missing(shape, percent):
    for frame in range(5):
        missing = perturbed(
            "depth_random_missing", np.ones(shape, np.float32), frame=frame, missing_percent=float(percent)
        )
        assert abs(np.mean(missing == 0) * 100 - percent) < 0.3


def test_patches_are_a_tenth_by_a_tenth():
    lost = perturbed("depth_random_missing", np.ones((200, 400), np.float32), missing_percent=1.0) == 0
    rows, columns = np.flatnonzero(lost.any(axis=1)), np.flatnonzero(lost.any(axis=0))
    assert (rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1) == (20, 40)
    assert lost[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()


def test_void_that_is_there_counts_for_nothing():
    depth = np.ones((200, 300), np.float32)
    plain = perturbed("depth_random_missing", depth)
    depth[:100] = 0
    np.testing.assert_array_equal(perturbed("depth_random_missing", depth)[100:], plain[100:])


@pytest.mark.one_python
def test_patches_fall_everywhere_alike():
    lost = sum(perturbed("depth_random_missing", np.ones((40, 40), np.float32), frame=k) == 0 for k in range(1500))
    inside = lost[4:-4, 4:-4].astype(float)
    assert abs(inside[:16].mean() / inside[16:].mean() - 1) < 0.05
    assert abs(inside[:, :16].mean() / inside[:, 16:].mean() - 1) < 0.05
    assert np.ptp(inside) / inside.mean() < 0.5


@cases("severity", [1, 2, 3, 4, 5])
def test_range(severity):
    low, high = (np.float32(TABLES["depth_range_clipping"][key][severity - 1]) for key in ("min_m", "max_m"))
    below, above = np.nextafter(low, np.float32(0)), np.nextafter(high, np.float32(9))
    depth = np.array([[0, below, low, 1, high, above, 9, 1e-30]], np.float32)
    np.testing.assert_array_equal(
        perturbed("depth_range_clipping", depth, severity), np.array([[0, 0, low, 1, high, 0, 0, 0]], np.float32)
    )


@cases("name", DEPTH)
def test_what_is_no_depth_becomes_void_and_spoils_nothing(name):
    depth = room(68, 120)
    expected = depth.copy()
    dirty = depth.copy()
    for value, at in ((np.nan, 5), (np.inf, 6), (-np.inf, 7), (-2, 8)):
        dirty[at, 3], expected[at, 3] = value, 0
    np.testing.assert_array_equal(perturbed(name, dirty), perturbed(name, expected))


@cases("name", DEPTH)
def test_the_ends_of_the_formats(name):
    farthest = np.float32(65535 / 6553.5)
    depth = np.tile(np.array([1 / 6553.5, farthest], np.float32), (64, 32))
    steps = quantise_depth(perturbed(name, depth, 5), 6553.5)
    if name == "depth_gaussian_noise":
        far = steps[:, 1::2]
        assert 0.4 < np.mean(far == 0) < 0.6  # half of the noise lies beyond, and there is void, not what it wraps to
        assert far[far > 0].min() > 65535 * 0.01
    huge = np.tile(np.array([1e-38, 3e38], np.float32), (8, 8))
    perturbed(name, huge, 5)
    perturbed(name, np.full((8, 8), 1e-45, np.float32), 5)
