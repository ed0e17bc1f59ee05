# SPDX-License-Identifier: GPL-3.0-or-later
"""Sensor noise against the equations of EMVA Standard 1288, in float64, and against Poisson's law."""

import numpy as np
import pytest
from cases import cases
from scipy import stats
from srgb import encoded, linear

from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped.sensor_noise import grain
from noisy_world.perturbations.shipped.sensor_noise import PERTURBATION, hot_pixels

SIZE = (128, 160)
FLAT = {"hot_percent": 0.0, "row_noise_electrons": 0.0, "dark_electrons_per_s": 0.0}


def context(frame=0, **values):
    return FrameContext(frame, (7, "scene", "setting", "sensor_noise", 0), **values)


def numbers(light, frame=0, *, lit=False, rgb=None, full_at=1.0, decided=None, **values):
    """What a converter gives for a flat field of linear light, black at 0: the inverse of the image, in float64."""
    parameters = PERTURBATION.at_severity(3, **values)
    image = np.full((*SIZE, 3), encoded(light), np.float32) if rgb is None else rgb
    where = context(frame, lit=lit, read_decided=None if decided is None else lambda: decided)
    found = linear(PERTURBATION.apply(image, parameters, where)) / full_at
    last = 2**parameters.bits - 1
    black = round(parameters.black_level * last)
    return found * ((last - black) if parameters.subtract_black else last)


def slope_and_start(levels, black_level=0.25, **values):
    """EMVA's photon transfer: variance of pairs of flat fields over their mean, as a line; black is well above 0."""
    means, variances = [], []
    for number, level in enumerate(levels):
        one, two = (
            numbers(level, 2 * number + k, black_level=black_level, subtract_black=False, **values) for k in (0, 1)
        )
        means.append((one.mean() + two.mean()) / 2)
        variances.append(np.square(one - two).mean() / 2 - np.square(one.mean() - two.mean()) / 2)
    slope, start = np.polyfit(means, variances, 1, w=1 / np.array(variances))
    return slope, start, np.array(means), np.array(variances)


@cases("gain_db", [0.0, 10.4, 20.8, 31.2, 41.6])
@cases("bits", [10, 12])
def test_variance_over_mean_is_emvas_line(gain_db, bits):
    levels = np.linspace(0.0, 0.7, 15)  # up to 70 % of saturation, as the standard fits
    values = {**FLAT, "gain_db": gain_db, "bits": bits, "read_noise_electrons": 2.0}
    slope, _, means, variances = slope_and_start(levels, **values)
    last = 2**bits - 1
    black = round(0.25 * last)
    gain = (last - black) / (10_000 / 10 ** (gain_db / 20))  # K, numbers an electron
    read = gain**2 * 2.0**2 + 1 / 12
    wanted = read + gain * (means - black)
    print(gain_db, bits, slope / gain, np.abs(variances / wanted - 1).max())
    assert slope == pytest.approx(gain, rel=0.02)
    if gain > 0.3:  # below, a step holds several electrons, and the steps' own noise is no longer even
        spread = 5 * np.sqrt(2 / (3 * SIZE[0] * SIZE[1]))
        assert variances == pytest.approx(wanted, rel=0.02 + spread)
    assert means == pytest.approx(black + levels * (last - black), rel=2e-3)


def test_dark_current_adds_its_electrons_and_their_noise():
    values = {**FLAT, "gain_db": 20.0, "bits": 12, "read_noise_electrons": 0.0, "subtract_black": False}
    bright = {**values, "dark_electrons_per_s": 5000.0, "exposure_ms": 40.0}  # 200 electrons
    found = numbers(0.0, **bright)
    gain = (4095 - 256) / 1000
    assert found.mean() - 256 == pytest.approx(200 * gain, rel=0.01)
    assert found.var() == pytest.approx(gain**2 * 200 + 1 / 12, rel=0.03)
    longer = numbers(0.0, decided={"exposure_ms": 80.0, "gain_db": 0.0}, **bright)
    assert longer.mean() - 256 == pytest.approx(400 * gain, rel=0.01), "auto-exposure says how long"


@cases("electrons", [0.01, 0.4, 3.0, 7.9, 8.1, 40.0, 200.0])
def test_electrons_are_poissons(electrons):
    """Every electron is a number of the converter's here, so what comes out is counted."""
    values = {**FLAT, "gain_db": 0.0, "full_well_electrons": 1023.0, "read_noise_electrons": 0.0, "black_level": 0.0}
    found = np.rint(numbers(electrons / 1023, **values)).astype(int).ravel()
    if electrons < 8:  # below it Poisson's law itself is drawn
        counts = np.bincount(found)
        expected = stats.poisson.pmf(np.arange(len(counts)), electrons) * found.size
        often = expected > 5
        score = np.square(counts - expected)[often] / expected[often]
        assert score.sum() < stats.chi2.ppf(0.9999, often.sum())
    assert found.mean() == pytest.approx(electrons, abs=5 * np.sqrt(electrons / found.size))
    spread = 5 * np.sqrt((electrons + 2 * electrons**2) / found.size)
    assert found.var() == pytest.approx(electrons + (1 / 12 if electrons > 8 else 0), abs=spread)
    assert stats.skew(found) == pytest.approx(electrons**-0.5, rel=0.05, abs=0.05)


def test_more_gain_is_less_light_at_equal_brightness():
    one = numbers(0.3, gain_db=0.0, **FLAT)
    other = numbers(0.3, gain_db=0.0, decided={"exposure_ms": 10.0, "gain_db": 20.0}, **FLAT)
    assert other.mean() == pytest.approx(one.mean(), rel=2e-3)
    assert other.var() / one.var() == pytest.approx(10, rel=0.1), "auto-exposure's gain"


def test_white_is_clipped_and_black_cannot_be_negative():
    dark = numbers(0.0, read_noise_electrons=20.0, **FLAT)
    assert dark.min() == 0, "the black level is taken off, and no image is below 0"
    assert 0.4 < (dark == 0).mean() < 0.6, "half of the noise was below"
    kept = numbers(0.0, read_noise_electrons=20.0, subtract_black=False, **FLAT)
    assert kept.mean() == pytest.approx(64, rel=0.01)
    cut = numbers(0.0, read_noise_electrons=20.0, black_level=0.0, subtract_black=False, **FLAT)
    assert cut.mean() == pytest.approx(20 * (1023 / (10_000 / 10**1.04)) / np.sqrt(2 * np.pi), rel=0.05), "rectified"
    bright = numbers(1.0, gain_db=41.6, **FLAT)
    assert np.isclose(bright.max(), 959), "the last of 10 bits, less the black level"
    assert np.isclose(bright, 959).mean() == pytest.approx(0.5, abs=0.05)


@cases("bits", [1, 2, 4, 8, 16])
def test_there_are_as_many_steps_as_the_bits_say(bits):
    ramp = np.repeat(np.linspace(0, 1, 3 * SIZE[0] * SIZE[1], dtype=np.float32).reshape(*SIZE, 3), 1, axis=0)
    found = numbers(0, rgb=encoded(ramp).astype(np.float32), bits=bits, black_level=0.0, **FLAT)
    assert np.abs(found - np.rint(found)).max() < (0.05 if bits < 16 else 0.5)
    assert len(np.unique(np.rint(found))) <= 2**bits
    assert found.max() == pytest.approx(2**bits - 1)


def test_lit_scenes_have_headroom_above_white():
    lamp = np.full((*SIZE, 3), encoded(np.array(12.0)), np.float32)
    shown = linear(PERTURBATION.apply(lamp, PERTURBATION.at_severity(1, **FLAT), context(lit=True)))
    assert shown.mean() == pytest.approx(12.0, rel=1e-3), "four stops hold 16 times white"
    clipped = linear(PERTURBATION.apply(lamp, PERTURBATION.at_severity(1, **FLAT), context()))
    assert clipped.max() == pytest.approx(1.0, rel=1e-5)


def test_hot_pixels_are_the_sensors():
    places, rates = hot_pixels(7, 0, SIZE, 1.0)
    assert len(places) == len(set(places)) == round(SIZE[0] * SIZE[1] * 3 / 100)
    assert rates.mean() == pytest.approx(1.0, rel=0.15)
    values = {**FLAT, "hot_percent": 1.0, "hot_electrons_per_s": 1e5, "gain_db": 20.0, "subtract_black": False}
    hot = [numbers(0.0, frame, **values) for frame in (0, 1)]
    quiet = [found.ravel()[np.setdiff1d(np.arange(found.size), places)] for found in hot]
    assert all(part.max() < 64 + 12 for part in quiet)
    strong = places[rates > 0.2]
    assert all((found.ravel()[strong] > 64 + 30).all() for found in hot), "in every frame"
    other = PERTURBATION.at_severity(3, **values)
    elsewhere = FrameContext(0, (7, "other scene", "other setting", "sensor_noise", 0))
    seen = linear(PERTURBATION.apply(np.zeros((*SIZE, 3), np.float32), other, elsewhere)) * 1023
    assert (seen.ravel()[strong] > 64 + 30).all(), "and in every scene and setting"
    assert not np.array_equal(places, hot_pixels(7, 1, SIZE, 1.0)[0])
    assert not np.array_equal(places, hot_pixels(8, 0, SIZE, 1.0)[0])


def test_rows_share_their_noise():
    values = {**FLAT, "read_noise_electrons": 0.0, "row_noise_electrons": 30.0, "gain_db": 0.0, "bits": 14}
    found = numbers(0.25, **{**values, "full_well_electrons": 1e6})
    rows = found.mean(axis=(1, 2))
    gain = (2**14 - 1 - 1024) / 1e6
    assert rows.std() == pytest.approx(30 * gain, rel=0.25)
    assert np.abs(np.corrcoef(rows[:-1], rows[1:])[0, 1]) < 0.3


@cases("size_px", [1.5, 3.0, 8.0])
def test_grain_has_variance_one_and_its_size(size_px):
    field = grain(context(), (300, 320), size_px)
    assert field.std() == pytest.approx(1.0, rel=0.08)
    assert field[:4].std() == pytest.approx(1.0, rel=0.5), "at the border too"
    shift = max(1, round(size_px))
    found = (field[:, shift:] * field[:, :-shift]).mean() / field.var()
    sigma = size_px / 2
    assert found == pytest.approx(np.exp(-(shift**2) / (4 * sigma**2)), abs=0.06), "a Gaussian's own correlation"


def test_grain_keeps_the_line():
    values = {**FLAT, "gain_db": 20.8, "grain_px": 2.0, "bits": 14, "read_noise_electrons": 0.99}
    slope, *_ = slope_and_start(np.linspace(0.05, 0.7, 8), **values)
    assert slope == pytest.approx((16383 - 4096) / (10_000 / 10**1.04), rel=0.02)


@cases("size", [(1, 1), (1, 7), (7, 1), (33, 5)])
@cases("grain_px", [1.0, 64.0])
def test_any_size(size, grain_px):
    image = np.full((*size, 3), 0.5, np.float32)
    parameters = PERTURBATION.at_severity(5, grain_px=grain_px, hot_percent=100.0)
    found = PERTURBATION.apply(image, parameters, context())
    assert found.shape == image.shape
    assert np.isfinite(found).all()


def test_frames_are_drawn_apart():
    image = np.full((64, 64, 3), 0.5, np.float32)
    frames = [PERTURBATION.apply(image, PERTURBATION.parameters(), context(k)).ravel() for k in range(3)]
    apart = np.corrcoef(frames)
    assert np.abs(apart[~np.eye(3, dtype=bool)]).max() < 0.03
