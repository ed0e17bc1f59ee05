# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups of sensor noise, contrast and pixelate against closed forms, loops and distributions."""

import math
from statistics import NormalDist

import numpy as np
import pytest
from cases import cases
from group_tools import by_nodes, by_reference, ks_bar, ks_distance, levels_apart, picture
from pixelating import pixelated

NOISES = ("gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise")
SHAPES = [(1, 1), (1, 7), (7, 1), (33, 41)]


def flat(value, height=680, width=1200):
    return np.full((height, width, 3), value, np.float32)


def colours(*shape):
    return np.random.default_rng(5).random((*shape, 3), np.float32)


def normal_distance(values):
    """The Kolmogorov-Smirnov distance from the standard normal, times the root of the number of values."""
    values = np.sort(values, axis=None)
    share = np.array([NormalDist().cdf(item) for item in values[::97]])
    place = np.arange(values.size)[::97] / values.size
    return np.abs(share - place).max() * math.sqrt(values.size)


def poisson(mean, most):
    """The probabilities of 0 to most - 1, and of all from `most` up."""
    likelihood = [math.exp(k * math.log(mean) - mean - math.lgamma(k + 1)) for k in range(most)]
    return np.array([*likelihood, 1 - sum(likelihood)])


# --- noise ---


@cases("quick", [False, True])
def test_gaussian_noise_is_normal_in_bulk_and_tails(quick):
    noise = (by_nodes("gaussian_noise", flat(0.5), std=0.05, coarse=quick)[0].astype(np.float64) - 0.5) / 0.05
    assert abs(noise.mean()) < 4 / math.sqrt(noise.size)
    assert noise.std() == pytest.approx(1, abs=4 / math.sqrt(2 * noise.size))
    assert normal_distance(noise) < 1.63  # at 1 %
    for sigmas in (2, 3, 4):
        expected = noise.size * NormalDist().cdf(-sigmas)
        for side in (noise > sigmas, noise < -sigmas):
            assert side.sum() == pytest.approx(expected, abs=4 * math.sqrt(expected))
    assert 4.8 < np.abs(noise).max() < 6.5


@cases(("name", "quick"), [("gaussian_noise", True), ("speckle_noise", False)])
def test_channels_neighbours_and_frames_are_independent(name, quick):
    made = by_nodes(name, flat(0.5, 300, 500), (3, 4), severity=1, coarse=quick)
    first, second = (item - item.mean() for item in made)
    pairs = [(first[..., 0], first[..., 1]), (first[..., 1], first[..., 2]), (first[..., 2], first[..., 0])]
    pairs += [(first[1:], first[:-1]), (first[:, 1:], first[:, :-1]), (first, second)]
    for one, other in pairs:
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4 / math.sqrt(one.size)


def test_speckle_noise_is_a_normal_gain():
    made = by_nodes("speckle_noise", flat(0.4), std=0.15, coarse=True)[0].astype(np.float64)
    assert normal_distance((made / 0.4 - 1) / 0.15) < 1.63
    assert not by_nodes("speckle_noise", flat(0, 20, 30), std=0.6)[0].any()


@cases(("photons", "value"), [(60, 1), (60, 0.1), (25, 0.02), (12, 0.5), (5, 0.9), (3, 0.3)])
def test_shot_noise_is_poisson(photons, value):
    counts = by_nodes("shot_noise", flat(value, 400, 600), photons=photons)[0] * photons
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-4)
    seen = np.bincount(np.rint(counts).astype(int).ravel(), minlength=photons + 1)
    expected = poisson(value * photons, photons) * counts.size
    assert np.abs(np.cumsum(seen - expected)).max() / math.sqrt(counts.size) < 1.63
    often = expected > 5
    freedom = often.sum() - 1
    excess = ((seen - expected)[often] ** 2 / expected[often]).sum() - freedom
    assert excess < 3.5 * math.sqrt(2 * freedom)
    assert counts.mean() == pytest.approx(
        (expected * np.arange(photons + 1)).sum() / counts.size, abs=4 * math.sqrt(value * photons / counts.size)
    )


def test_no_photons_are_darkness():
    assert not by_nodes("shot_noise", flat(1, 9, 9), photons=0.0)[0].any()


@cases("amount", [0.0, 0.03, 0.27, 1.0])
def test_impulses_are_as_many_as_asked_for_half_of_them_white(amount):
    made = by_nodes("impulse_noise", flat(0.5), amount=amount)[0]
    salt, pepper = made == 1, made == 0
    assert np.all(salt | pepper | (made == 0.5))
    for share in (salt, pepper):
        spread = math.sqrt(amount / 2 / share.size)
        assert share.mean() == pytest.approx(amount / 2, abs=max(4 * spread, 1e-6))
        assert share[..., 0].mean() == pytest.approx(amount / 2, abs=max(8 * spread, 1e-6))
    both = (salt | pepper).all(axis=2).mean()  # each channel on its own
    assert both == pytest.approx(amount**3, abs=max(5 * math.sqrt(amount**3 / made[..., 0].size), 1e-6))


@cases("name", NOISES)
@cases("severity", [1, 5])
def test_a_frame_of_noise_is_distributed_as_the_references(name, severity):
    image = picture(500, 700, 3)
    made, expected = (
        by_nodes(name, image, severity=severity, coarse=severity == 5)[0],
        by_reference(name, image, severity=severity)[0],
    )
    assert ks_distance(made, expected) < ks_bar(made, expected)
    shift, expected_shift = ((item - image).mean() * 255 for item in (made, expected))
    assert shift == pytest.approx(expected_shift, abs=0.5)
    ratio = ((made - image) ** 2).mean() / ((expected - image) ** 2).mean()
    assert abs(10 * math.log10(ratio)) < 0.05


@cases("name", NOISES)
def test_a_preview_shows_the_noise_of_the_pixels_it_shows(name):
    values = {"severity": 3, "coarse": name in NOISES[:2]}
    whole = by_nodes(name, flat(0.5, 40, 60), **values)[0]
    half = by_nodes(name, flat(0.5, 20, 30), reference_width=60, **values)[0]
    np.testing.assert_array_equal(half, whole[1::2, 1::2])


@cases("shape", SHAPES)
def test_darkness_has_no_noise_of_light_and_a_constant_frame_stays(shape):
    for name, values in {"contrast": (0, 1), "pixelate": (0, 1), "shot_noise": (0,), "speckle_noise": (0,)}.items():
        for value in values:
            np.testing.assert_allclose(by_nodes(name, flat(value, *shape), severity=5)[0], value, atol=1e-5)


# --- saturate ---


@cases("severity", [1, 3, 4, 5])
def test_saturate_is_its_reference(severity):
    image = picture(67, 93)  # with black and white
    image[10:20, 30:60] = 0.5  # grey has no hue
    made, expected = (
        by_nodes("saturate", image, severity=severity)[0],
        by_reference("saturate", image, severity=severity)[0],
    )
    assert levels_apart(made, expected)[0] < 0.01


# --- contrast ---


@cases("shape", [*SHAPES, (680, 1200)])
@cases("factor", [0.05, 0.4])
def test_contrast_scales_about_each_channels_mean(shape, factor):
    image = colours(*shape) * np.array([1, 0.9, 0.25], np.float32)
    means = image.astype(np.float64).mean(axis=(0, 1))
    made = by_nodes("contrast", image, factor=factor)[0]
    assert levels_apart(made, means + factor * (image - means))[0] < 0.1


# --- pixelate ---


@cases("factor", [0.6, 0.5, 0.4, 0.3, 0.25])
@cases("shape", [(20, 30), (100, 140), (39, 119)])
def test_pixelate_is_pils_box_down_and_nearest_up(factor, shape):
    image = colours(*shape)
    assert levels_apart(by_nodes("pixelate", image, factor=factor)[0], pixelated(image, factor))[0] < 0.1


@cases("severity", [1, 2, 3, 4, 5])
def test_pixelate_is_the_references_at_every_severity(severity):
    image = picture(204, 360)
    made, expected = (make("pixelate", image, severity=severity)[0] for make in (by_nodes, by_reference))
    assert levels_apart(made, expected)[0] < 0.1


@cases("factor", [1.0, 0.77, 0.6, 0.5, 0.4, 0.37, 0.3, 0.25, 0.06])
def test_any_factor_pixelates(factor):
    image = colours(53, 71)
    made, expected = (make("pixelate", image, factor=factor)[0] for make in (by_nodes, by_reference))
    assert levels_apart(made, expected)[0] < 0.1


def test_blocks_of_any_size_are_meaned_about():
    image = colours(300, 500)
    made = by_nodes("pixelate", image, factor=0.001)[0]
    assert np.ptp(made, axis=(0, 1)).max() < 1e-6
    np.testing.assert_allclose(made[0, 0], image.mean(axis=(0, 1)), atol=5 * 0.29 / 20)


def test_a_centre_on_a_border_shows_one_of_its_two_blocks():
    image = colours(1, 7)
    made = by_nodes("pixelate", image, factor=0.4)[0][0]
    before, after = image[0, :4].mean(axis=0), image[0, 4:].mean(axis=0)
    np.testing.assert_allclose(made[:3], np.tile(before, (3, 1)), atol=1e-5)
    np.testing.assert_allclose(made[4:], np.tile(after, (3, 1)), atol=1e-5)
    assert min(np.abs(made[3] - block).max() for block in (before, after)) < 1e-5


def test_a_preview_keeps_the_blocks_in_their_places():
    image = colours(40, 60).repeat(2, axis=0).repeat(2, axis=1)
    whole = by_nodes("pixelate", image, factor=0.25)[0]
    half = by_nodes("pixelate", image[::2, ::2], factor=0.25, reference_width=120)[0]
    assert levels_apart(half.repeat(2, axis=0).repeat(2, axis=1), whole)[0] < 0.1


def test_a_frame_larger_than_the_reference_is_meaned_whole():
    image = colours(40, 60)
    made = by_nodes("pixelate", image, factor=0.5, reference_width=30)[0]
    means = image.reshape(10, 4, 15, 4, 3).mean(axis=(1, 3))
    assert levels_apart(made, means.repeat(4, axis=0).repeat(4, axis=1))[0] < 0.1
