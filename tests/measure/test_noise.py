# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that is put on clean frames comes back from the frames alone: known in, known out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from noisy_world.core.schema import ConfigPath
from noisy_world.measure.colour_noise import colour_noise
from noisy_world.measure.depth_noise import depth_noise
from noisy_world.measure.footage import Look, footage_of
from noisy_world.measure.imu_noise import imu_noise
from noisy_world.sources.recording import read_recording

COUNT = 16
HIGH, WIDE = 144, 192
RNG = np.random.default_rng(5)


class Looks(list):
    """Looks at frames, as footage gives them."""

    def look(self, frame):
        return self[frame]


@pytest.fixture(scope="module")
def clean(walk):
    """Some looks at the clean walk."""
    source = read_recording(walk / "clean/room", ConfigPath("test"))
    with footage_of("walk", source, source.camera(None)) as footage:
        return Looks(footage.look(frame) for frame in range(0, 6 * COUNT, 6))


def with_colour(looks, noise):
    """The looks with noise, a function of full scale to full scale, on their colour."""
    made = [np.clip(np.rint(255 * noise(look.colour / 255.0)), 0, 255).astype(np.uint8) for look in looks]
    return Looks(replace(look, colour=colour) for look, colour in zip(looks, made, strict=True))


def plain(clean):
    """The looks as a lens out of focus shows them: without the texture of single pixels, which hides noise."""
    return Looks(replace(look, colour=gaussian_filter(look.colour, (2, 2, 0))) for look in clean)


@pytest.mark.parametrize("std", [0.02, 0.06])
def test_gaussian_noise_of_colour(clean, std):
    found = colour_noise(with_colour(plain(clean), lambda x: x + RNG.normal(0, std, x.shape)), range(COUNT))
    assert found.gaussian_std.value == pytest.approx(std, rel=0.1)
    hidden = colour_noise(with_colour(clean, lambda x: x + RNG.normal(0, std, x.shape)), range(COUNT)).gaussian_std
    assert hidden.low < std < hidden.high
    assert abs(found.correlation.value) < 0.15
    assert found.remark == ""


@pytest.mark.parametrize("photons", [25, 100])
def test_shot_noise_of_colour(clean, photons):
    found = colour_noise(with_colour(plain(clean), lambda x: RNG.poisson(x * photons) / photons), range(COUNT))
    slope = found.per_photon
    assert slope.value == pytest.approx(1 / photons, rel=0.1)
    assert slope.low < 1 / photons < slope.high


def test_noise_that_was_smoothed_is_said_to_be(clean):
    smoothed = with_colour(clean, lambda x: gaussian_filter(x + RNG.normal(0, 0.08, x.shape), (1, 1, 0)))
    found = colour_noise(smoothed, range(COUNT))
    assert "denoised" in found.remark
    assert found.correlation.value > 0.4
    assert "denoised" in colour_noise(clean, range(COUNT)).remark
    assert colour_noise(clean, range(COUNT)).gaussian_std.value is None


def walls(noise, count=COUNT):
    """Looks at a wall that is seen at a slant, at 1 to 4 m, with noise in metres: a function of depth."""
    grey, colour = np.full((HIGH, WIDE), 128, np.uint8), np.full((HIGH, WIDE, 3), 128, np.uint8)
    v, u = np.mgrid[:HIGH, :WIDE]
    made = Looks()
    for _ in range(count):
        depth_m = 1 / (1 - 0.74 * (0.9 * u / WIDE + 0.1 * v / HIGH))
        made.append(Look(grey, (depth_m + noise(depth_m)).astype(np.float32), grey, colour))
    return made


def test_depth_noise_by_distance():
    found = depth_noise(walls(lambda z: RNG.normal(0, 1, z.shape) * (0.001 + 0.0015 * z**2)), range(COUNT))
    assert len(found.curve) >= 7
    for z, figure in found.curve:
        assert figure.value == pytest.approx(0.001 + 0.0015 * z**2, rel=0.1)
    offset, quadratic = found.law
    assert quadratic.value == pytest.approx(0.0015, rel=0.1)
    assert offset.value == pytest.approx(0.001, rel=0.25)
    assert all(abs(figure.value) < 0.03 for figure in found.correlation[:3])
    assert found.correlation[3].value == pytest.approx(0.25, abs=0.03)


def test_correlation_of_depth_noise():
    sigma_px = 1.2  # of the filter: neighbours at d are correlated by exp(-d^2 / 4 sigma^2)

    def smooth(z):
        white = gaussian_filter(RNG.normal(0, 1, z.shape), sigma_px)
        return white / white.std() * 0.002 * z**2

    found = depth_noise(walls(smooth), range(COUNT))
    for lag, figure in zip((1, 2, 4), found.correlation[:3], strict=True):
        assert figure.value == pytest.approx(np.exp(-(lag**2) / (4 * sigma_px**2)), abs=0.05)
    assert abs(found.correlation[4].value) < 0.05  # each frame draws its own


def test_steps_of_depth():
    step_per_m = 0.003
    noisy = walls(lambda z: RNG.normal(0, 0.002, z.shape) * z**2)
    disparity = Looks(
        replace(look, depth_m=(1 / (np.rint(1 / look.depth_m / step_per_m) * step_per_m)).astype(np.float32))
        for look in noisy
    )
    _, per_m = depth_noise(disparity, range(COUNT)).steps
    assert per_m.value == pytest.approx(step_per_m, rel=0.05)
    even = Looks(replace(look, depth_m=(np.rint(look.depth_m / 0.004) * 0.004).astype(np.float32)) for look in noisy)
    smallest, per_m = depth_noise(even, range(COUNT)).steps
    assert smallest.value == pytest.approx(0.004, rel=0.01)
    assert per_m.value is None


def test_holes_by_what_they_are_beside():
    looks = walls(lambda z: 0 * z)
    for look in looks:
        look.depth_m[:, :8] = 0  # the border
        look.depth_m[20:30, 60:70] = 0
    dark = Looks(replace(look, grey=np.where(look.depth_m > 0, look.grey, 10).astype(np.uint8)) for look in looks)
    shares = [figure.value for figure in depth_noise(looks, range(COUNT)).holes]
    frame = HIGH * WIDE
    # What is void in each frame at the same place is taken for the border.
    assert sum(shares) == pytest.approx((8 * HIGH + 100) / frame)
    assert shares[0] == pytest.approx((8 * HIGH + 100) / frame)
    moved = Looks(dark)
    for number, look in enumerate(moved):
        moved[number] = replace(
            look, depth_m=np.roll(look.depth_m, 3 * number, axis=0), grey=np.roll(look.grey, 3 * number, axis=0)
        )
    shares = [figure.value for figure in depth_noise(moved, range(COUNT)).holes]
    assert shares[0] == pytest.approx(8 * HIGH / frame)
    assert sum(shares[1:]) == pytest.approx(100 / frame)


def test_white_noise_of_an_imu(walk):
    # The walk's IMU is a bmi055: 1.28e-4 rad/s/sqrt(Hz) and 8.4e-4 m/s^2/sqrt(Hz), by VINS-Mono's thread 472.
    imu = read_recording(walk / "clean/room", ConfigPath("test")).capabilities.imu
    gyro, accel = imu_noise(imu)
    assert gyro.value == pytest.approx(1.28e-4, rel=0.1)
    assert accel.value == pytest.approx(8.4e-4, rel=0.1)
    few = SimpleNamespace(samples=replace(imu.samples, stamps_ns=imu.samples.stamps_ns[:50]))
    assert imu_noise(few)[0].value is None
    assert "too few" in imu_noise(few)[0].untold
