# SPDX-License-Identifier: GPL-3.0-or-later
"""The sensor's noises against their closed forms."""

import math

import numpy as np
import pytest
from cases import cases

from noisy_world.images.pixels import rgb_bytes
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import gaussian_noise, impulse_noise, shot_noise, speckle_noise
from noisy_world.perturbations import registry

pytestmark = pytest.mark.filterwarnings("error")

NOISES = ("gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise")
SIDE = 600  # 600 x 600 x 3 = 1.08e6 values
# The tables of the paper, written out again.
TABLES = {
    "gaussian_noise": ("std", [0.08, 0.12, 0.18, 0.26, 0.38]),
    "shot_noise": ("photons", [60, 25, 12, 5, 3]),
    "impulse_noise": ("amount", [0.03, 0.06, 0.09, 0.17, 0.27]),
    "speckle_noise": ("std", [0.15, 0.2, 0.35, 0.45, 0.6]),
}


def perturbed(name, rgb, severity=3, frame=0, temporal="fresh", **given):
    item = registry()[name]
    kept = rgb.copy()
    apply = item.apply if rgb.dtype == np.float32 else item.apply_bytes
    noisy = apply(rgb, item.at_severity(severity, **given), FrameContext(frame, ("test", 7), temporal))
    assert noisy.dtype == rgb.dtype
    assert noisy.shape == rgb.shape
    np.testing.assert_array_equal(rgb, kept)
    return noisy


def constant(value, side=SIDE):
    return np.full((side, side, 3), value, np.float32)


def kolmogorov(samples, cdf):
    """The largest distance between the samples' distribution function and a closed one, on both sides of each step."""
    values, counts = np.unique(samples, return_counts=True)
    empirical = np.concatenate([[0], np.cumsum(counts)]) / samples.size
    expected = np.array([cdf(float(value)) for value in values])
    return max(np.abs(empirical[1:] - expected).max(), np.abs(empirical[:-1] - expected).max())


def normal_cdf(z):
    return 0.5 * (1 + math.erf(z / math.sqrt(2)))


def poisson(mean, count):
    return math.exp(count * math.log(mean) - mean - math.lgamma(count + 1)) if mean else float(count == 0)


def correlation(a, b):
    a, b = (np.asarray(x, np.float64).ravel() for x in (a, b))
    a, b = a - a.mean(), b - b.mean()
    return (a * b).sum() / math.sqrt((a * a).sum() * (b * b).sum())


@cases("name", NOISES)
def test_severities_are_the_papers_and_the_default_is_the_third(name):
    key, table = TABLES[name]
    item = registry()[name]
    assert [getattr(item.at_severity(level), key) for level in range(1, 6)] == table
    assert item.parameters() == item.at_severity(3)
    assert getattr(item.at_severity(2.5), key) == pytest.approx((table[1] + table[2]) / 2)


def is_standard_normal(z):
    z = np.asarray(z, np.float64).ravel()
    n = z.size
    assert abs(z.mean()) < 4 / math.sqrt(n)
    assert abs(z.var() - 1) < 2.5 * math.sqrt(2 / n)
    assert abs((z**3).mean()) < 4 * math.sqrt(15 / n)
    assert abs((z**4).mean() - 3) < 4 * math.sqrt(96 / n)
    assert kolmogorov(z, normal_cdf) < 1.63 / math.sqrt(n)  # the test's 1 % limit
    assert 4.2 < np.abs(z).max() < 6


@cases("severity", [1, 5])
def test_gaussian_noise_is_normal(severity):
    std = TABLES["gaussian_noise"][1][severity - 1]
    is_standard_normal((perturbed("gaussian_noise", constant(0.5), severity) - np.float32(0.5)) / std)


@cases("severity", [1, 5])
def test_speckle_noise_is_normal_in_proportion_to_the_value(severity):
    std = TABLES["speckle_noise"][1][severity - 1]
    for value in (0.125, 0.9):
        is_standard_normal((perturbed("speckle_noise", constant(value), severity) / np.float32(value) - 1) / std)
    assert not perturbed("speckle_noise", constant(0, 20), severity).any()


@cases("severity", [1, 2, 3, 4, 5, 2.5])
def test_impulses_have_their_share_half_white_half_black_each_channel_on_its_own(severity):
    amount = float(np.interp(severity, range(1, 6), TABLES["impulse_noise"][1]))
    noisy = perturbed("impulse_noise", constant(0.25), severity)
    n = noisy.size
    for value in (0, 1):
        share = np.mean(noisy == value)
        assert abs(share - amount / 2) < 4 * math.sqrt(amount / 2 * (1 - amount / 2) / n) + 1 / 65536
    assert set(np.unique(noisy)) == {0, np.float32(0.25), 1}
    pixels = np.mean((noisy != 0.25).all(axis=2))
    assert abs(pixels - amount**3) < 4 * math.sqrt(amount**3 / (n / 3))


def test_every_value_an_impulse_and_none():
    noisy = perturbed("impulse_noise", constant(0.25, 100), amount=1.0)
    assert set(np.unique(noisy)) == {0, 1}
    np.testing.assert_array_equal(perturbed("impulse_noise", noisy, amount=0.0), noisy)


@pytest.mark.one_python
@cases("photons", [3, 12, 60, 0.5, 18.5, 256])
@cases("value", [0, 1 / 255, 0.02, 10 / 255, 0.2, 0.5, 0.7, 1])
def test_photons_are_poisson(photons, value):
    mean = photons * float(np.float32(value))
    noisy = perturbed("shot_noise", constant(value, 360), photons=photons).ravel()
    counts = np.rint(noisy.astype(np.float64) * photons)
    below = noisy < 1  # what reaches full scale is clipped there
    np.testing.assert_allclose(noisy[below] * photons, counts[below], atol=1e-3)
    n = counts.size
    full = math.ceil(photons)
    expected = np.array([poisson(mean, count) for count in range(full)]) * n
    seen = np.bincount(counts[below].astype(int), minlength=full)
    expected, seen = np.append(expected, n - expected.sum()), np.append(seen, n - below.sum())
    enough = expected >= 5
    expected = np.append(expected[enough], max(expected[~enough].sum(), 1e-3))
    seen = np.append(seen[enough], seen[~enough].sum())
    assert seen[-1] <= expected[-1] + 5 * math.sqrt(expected[-1]) + 1
    chi2 = ((seen - expected) ** 2 / np.maximum(expected, 1))[:-1].sum()
    freedom = enough.sum()
    assert chi2 < freedom * (1 - 2 / (9 * freedom) + 4 * math.sqrt(2 / (9 * freedom))) ** 3  # Wilson and Hilferty


@cases("photons", [256, 18.5, 3, 0.01])
def test_the_codes_of_each_byte_are_shared_as_poisson_says(photons):
    tables = (table.reshape(256, 256).astype(int) for table in shot_noise._alias_tables(photons))
    for level, (threshold, first, second) in enumerate(zip(*tables, strict=True)):
        codes = np.bincount(first, threshold, 600) + np.bincount(second, 256 - threshold, 600)
        expected = np.cumsum([poisson(photons * level / 255, count) for count in range(600)])
        assert np.abs(np.cumsum(codes) / 65536 - expected).max() < 1 / 131072


@cases(("value", "photons"), [(0.2, 60), (51 / 255, 60), (0.01, 12), (0.05, 3), (0.3, 256)])
def test_photons_have_the_mean_the_variance_and_the_distribution_function(value, photons):
    noisy = perturbed("shot_noise", constant(value), photons=photons).astype(np.float64)
    n, variance = noisy.size, value / photons
    assert abs(noisy.mean() - value) < 4 * math.sqrt(variance / n)
    fourth = 3 * variance**2 + variance / photons**2
    assert abs(noisy.var() - variance) < 4 * math.sqrt((fourth - variance**2) / n)
    counts = np.rint(noisy * photons).astype(int).ravel()
    empirical = np.cumsum(np.bincount(counts)) / n
    expected = np.cumsum([poisson(value * photons, count) for count in range(empirical.size)])
    assert np.abs(empirical - expected).max() < 1.63 / math.sqrt(n)


def test_no_light_and_no_photons_are_black():
    for dtype in (np.float32, np.uint8):
        assert not perturbed("shot_noise", np.zeros((20, 20, 3), dtype)).any()
        assert not perturbed("shot_noise", np.full((20, 20, 3), 1, dtype), photons=0.0).any()
        assert not perturbed("shot_noise", np.full((20, 20, 3), 1, dtype), photons=1e-300).any()


@cases("name", NOISES)
def test_neighbours_and_channels_are_uncorrelated(name):
    noise = perturbed(name, constant(0.3))
    limit = 4 / math.sqrt(noise.size / 3)
    assert abs(correlation(noise[:, 1:], noise[:, :-1])) < limit
    assert abs(correlation(noise[1:], noise[:-1])) < limit
    assert abs(correlation(noise[1:, 1:], noise[:-1, :-1])) < limit
    for a, b in ((0, 1), (1, 2), (0, 2)):
        assert abs(correlation(noise[..., a], noise[..., b])) < limit


@cases("name", NOISES)
@cases("value", [0.3, 77 / 255])
def test_frames_are_uncorrelated_over_lags_0_to_64(name, value):
    frames = [perturbed(name, constant(value, 60), frame=k).ravel() for k in range(66)]
    n = frames[0].size
    lags = [correlation(frames[0][lag:], frames[1][: n - lag]) for lag in range(65)]
    lags += [correlation(frames[1][lag:], frames[0][: n - lag]) for lag in range(65)]
    assert np.abs(lags).max() < 4.5 / math.sqrt(n)
    assert np.abs([correlation(frames[0], other) for other in frames[1:]]).max() < 4.5 / math.sqrt(n)
    assert abs(np.mean(lags)) < 4 / math.sqrt(n * len(lags))


@pytest.mark.one_python
@cases(("name", "module"), [("gaussian_noise", gaussian_noise), ("speckle_noise", speckle_noise)])
@cases("std", [0.0137, 0.18, 2.0])
def test_bytes_are_the_rounded_floats_for_every_byte_and_every_code(monkeypatch, name, module, std):
    codes = np.arange(65535, dtype=np.uint16).reshape(1, -1, 3)  # in every row
    monkeypatch.setattr(module, "uniform_codes", lambda _, shape: np.repeat(codes, shape[0], axis=0))
    for first in range(0, 256, 64):
        rgb = np.repeat(np.arange(first, first + 64, dtype=np.uint8), 65535).reshape(64, -1, 3)
        floats = perturbed(name, rgb / np.float32(255), std=std)
        np.testing.assert_array_equal(perturbed(name, rgb, std=std), rgb_bytes(floats))


@cases("name", [name for name in NOISES if name != "shot_noise"])  # photons come singly at any number
def test_nothing_asked_for_is_the_identity(name):
    rgb = np.random.default_rng(2).random((31, 17, 3), np.float32)
    np.testing.assert_array_equal(perturbed(name, rgb, **{TABLES[name][0]: 0.0}), rgb)


def test_tables_do_not_pile_up():
    for module in (gaussian_noise._tables, impulse_noise._impulses, speckle_noise._gains, shot_noise._alias_tables):
        assert 0 < module.cache_info().maxsize <= 16
