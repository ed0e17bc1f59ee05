# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto-exposure, white balance and flicker against their closed forms, in float64."""

import math

import numpy as np
import pytest
from cases import cases
from srgb import encoded, linear

from noisy_world.core.errors import InputError
from noisy_world.perturbations.kinds import EarlierFrame, earlier_than, small_light, small_of
from noisy_world.perturbations.execution import ColourWork, perturb_rgb
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import Shutter
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.auto_exposure import lag_span_s, lag_weights
from noisy_world.perturbations.shipped.auto_exposure import AutoExposure, decides, metered
from noisy_world.perturbations.shipped.flicker import Flicker, brightness
from noisy_world.perturbations.shipped.white_balance import WhiteBalance
from noisy_world.perturbations.shipped.white_balance import decides as balances

STAMPS_S = np.cumsum([0.0, 0.05, 0.05, 0.02, 0.08, *[0.05] * 60])


def seen_at(frame, light_of, stamps_s=STAMPS_S):
    """A frame's context: before it the sequence showed flat frames of some light."""

    def earlier(span_s):
        return tuple(
            EarlierFrame(float(stamps_s[k]), np.full((3, 4, 3), light_of(k), np.float32))
            for k in earlier_than(stamps_s, frame, span_s)
        )

    return FrameContext(frame, (1, "", ""), stamp_s=float(stamps_s[frame]), read_earlier=earlier)


def step(name, **values):
    (found,) = parse_steps([{name: values}], ConfigPath("test"), registry())
    return found


# --- auto-exposure ---


@cases("lag_s", [0.05, 0.3, 1.0])
@cases("lights", [(0.18, 0.02), (0.05, 0.6)])
def test_exposure_follows_a_step_of_light_as_the_formula_says(lag_s, lights):
    wide = AutoExposure(lag_s=lag_s, min_ms=1e-3, max_ms=1e4, max_gain_db=0)
    at = 20  # the first frame of the new light
    for frame in range(1, 60):
        found = math.log2(decides(wide, seen_at(frame, lambda k: lights[k >= at]))["exposure_ms"] / 10)
        before, after = (math.log2(0.18 / light) for light in lights)
        passed = max(STAMPS_S[frame] - STAMPS_S[at], 0)
        wanted = after + (before - after) * math.exp(-passed / lag_s)
        assert found == pytest.approx(wanted, abs=2e-4 * abs(after - before))


def test_it_is_the_closed_loop_of_a_camera():
    """t' = t (target / measured)^alpha, where the camera measures what it exposed itself: another way to the same."""
    lights = 0.05 + 0.2 * np.random.default_rng(1).random(60)
    stamps_s = np.arange(60) / 20
    own = AutoExposure(lag_s=0.2, min_ms=1e-3, max_ms=1e4)
    alpha = 1 - math.exp(-0.05 / 0.2)
    time_ms = 10 * 0.18 / lights[0]
    for frame in range(1, 60):
        time_ms *= (0.18 / (lights[frame - 1] * time_ms / 10)) ** alpha
        found = decides(own, seen_at(frame, lambda k: lights[k], stamps_s))
        assert found["exposure_ms"] == pytest.approx(time_ms, rel=2e-4)
        assert found["gain_db"] == 0


def test_the_shown_image_is_as_bright_as_it_aims():
    image = np.full((9, 11, 3), encoded(0.05), np.float32)
    shown = linear(apply(image, "auto_exposure"))
    assert shown == pytest.approx(0.18, rel=0.01), "an image alone has settled; it is metered in bytes"


def test_time_comes_before_gain_and_both_end():
    def at(light, **values):
        return decides(AutoExposure(max_ms=20.0, **values), seen_at(0, lambda _: light))

    assert at(0.18) == pytest.approx({"exposure_ms": 10.0, "gain_db": 0.0})
    assert at(0.09) == pytest.approx({"exposure_ms": 20.0, "gain_db": 0.0})
    assert at(0.045) == pytest.approx({"exposure_ms": 20.0, "gain_db": 20 * math.log10(2)})
    assert at(1e-6) == pytest.approx({"exposure_ms": 20.0, "gain_db": 24.0})
    assert at(0.0) == pytest.approx({"exposure_ms": 20.0, "gain_db": 24.0}), "darkness"
    assert at(0.18, light_stops=3.0) == pytest.approx({"exposure_ms": 10.0 / 8, "gain_db": 0.0})
    assert at(0.18, light_stops=8.0, min_ms=1.0) == pytest.approx({"exposure_ms": 1.0, "gain_db": 0.0})


def test_low_light_is_dark_when_gain_ends():
    image = np.full((5, 5, 3), encoded(0.18), np.float32)
    shown = linear(apply(image, "auto_exposure", light_stops=-10.0, max_ms=40.0, max_gain_db=12.0))
    stops = -10 + 2 + 12 / (20 * math.log10(2))
    assert shown == pytest.approx(0.18 * 2**stops, rel=0.01)


def test_gain_goes_to_the_sensors_noise():
    image = np.full((64, 64, 3), 118, np.uint8)
    spreads = []
    for light_stops in (0, -5):
        steps = parse_steps(
            [{"sensor_noise": {"severity": 1}}, {"auto_exposure": {"light_stops": light_stops}}],
            ConfigPath("t"),
            registry(),
        )
        assert [each.perturbation.name for each in steps] == ["auto_exposure", "sensor_noise"], "in any order"
        where = FrameContext(0, (1, "", ""), read_earlier=lambda _: (EarlierFrame(0.0, small_light(image)),))
        work = ColourWork.of(steps, where)
        made, _ = perturb_rgb(steps, image, where)
        assert made.mean() == pytest.approx(118, abs=3)
        spreads.append(made.std())
    assert work.decided["gain_db"] == pytest.approx(5 * 6.0206 - 20 * math.log10(3.3), rel=0.01)
    assert spreads[1] > 3 * spreads[0]


def test_what_is_brighter_than_white_reaches_the_sensor():
    """Exposed twofold and flickering to a half: what is left of it is clipped at the end alone."""
    image = np.full((4, 4, 3), encoded(0.75), np.float32)
    (up,) = parse_steps([{"auto_exposure": {"target": 1.0, "lag_s": 0}}], ConfigPath("t"), registry())
    down = step("flicker", modulation=1.0, exposure_ms=0.0)
    for seed in range(30):
        where = FrameContext(
            0, (seed, "", ""), read_earlier=lambda _: (EarlierFrame(0.0, np.full((1, 1, 3), 0.75 / 1.5, np.float32)),)
        )
        work = ColourWork.of((up, down), where)
        made, _ = perturb_rgb((up, down), image, where)
        wanted = min(0.75 * 2 * work.decided["flicker"], 1.0)
        assert linear(made / 255) == pytest.approx(wanted, abs=0.006)


@cases("meter", ["average", "centre"])
def test_metering(meter):
    light = np.zeros((24, 32, 3), np.float32)
    light[8:16, 11:21] = 1.0
    rows, columns = ((np.arange(n) + 0.5) / n - 0.5 for n in (24, 32))
    weights = np.exp(-8 * (rows[:, None] ** 2 + columns**2)) if meter == "centre" else np.ones((24, 32))
    wanted = weights[8:16, 11:21].sum() / weights.sum()
    assert metered(light, meter) == pytest.approx(wanted, rel=1e-6)


# --- the window ---


def test_the_window_leaves_out_what_weighs_nothing():
    lag_s = 0.1
    for frame in (1, 5, 30, 64):
        numbers = earlier_than(STAMPS_S, frame, lag_span_s(lag_s))
        weights = lag_weights(STAMPS_S[numbers], STAMPS_S[frame], lag_s)
        whole = lag_weights(STAMPS_S[:frame], STAMPS_S[frame], lag_s)
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert weights[1:] == pytest.approx(whole[numbers.start + 1 :], abs=1e-15)
        assert whole[: numbers.start].sum() < 1e-4
    assert earlier_than(STAMPS_S, 0, 9.0) == range(1)
    assert earlier_than(STAMPS_S, 3, 0.0) == range(2, 3), "the last one"
    assert list(lag_weights([0.0, 1.0], 2.0, 0.0)) == [0.0, 1.0]


@cases("size", [(1, 1), (480, 640), (5, 3), (1, 100), (681, 1201)])
def test_small_images_keep_the_mean_light(size):
    rgb = np.random.default_rng(0).integers(0, 256, (*size, 3)).astype(np.uint8)
    small = small_light(rgb)
    assert max(small.shape[:2]) <= 32
    assert small.dtype == np.float32
    assert small.mean() == pytest.approx(linear(rgb / 255).mean(), rel=0.01)
    assert np.array_equal(small, small_light((rgb / np.float32(255)).astype(np.float32)))
    lit = np.full((*size, 3), 7.0, np.float32)
    assert small_of(lit).mean() == pytest.approx(7.0)


# --- white balance ---


def test_a_grey_world_becomes_grey():
    tinted = np.array([0.4, 0.2, 0.1], np.float32)
    found = np.array(list(balances(WhiteBalance(strength=1.0), seen_at(0, lambda _: tinted)).values()))
    assert found * tinted == pytest.approx([found[1] * 0.2] * 3, rel=1e-6)
    assert found @ [0.2126, 0.7152, 0.0722] == pytest.approx(1.0)
    half = np.array(list(balances(WhiteBalance(strength=0.5), seen_at(0, lambda _: tinted)).values()))
    assert half[0] / half[1] == pytest.approx(math.sqrt(0.5))
    most = np.array(list(balances(WhiteBalance(strength=1, most_stops=0.25), seen_at(0, lambda _: tinted)).values()))
    assert most[2] / most[1] == pytest.approx(2**0.25)


def test_balance_follows_late_and_errs():
    own, at, tinted = WhiteBalance(strength=1.0, lag_s=0.5, warmth_stops=0.3, tint_stops=-0.1), 10, (0.4, 0.2, 0.1)
    for frame in (5, 10, 11, 20, 60):
        found = balances(own, seen_at(frame, lambda k: tinted if k >= at else (0.2, 0.2, 0.2)))
        passed = 1 - math.exp(-max(STAMPS_S[frame] - STAMPS_S[at], 0) / 0.5)
        red, blue = (math.log2(found[f"{name}_gain"] / found["green_gain"]) for name in ("red", "blue"))
        assert red == pytest.approx(-passed + 0.15 - 0.1, abs=3e-4)
        assert blue == pytest.approx(passed - 0.15 - 0.1, abs=3e-4)


def test_darkness_has_no_colour():
    found = balances(WhiteBalance(), seen_at(0, lambda _: 0.0))
    assert all(value == pytest.approx(1.0) for value in found.values())


# --- flicker ---


@cases("shutter", [Shutter(), Shutter.centred(0.004), Shutter.centred(0.013, 0.03), Shutter(0.0, 0.002, 0.02, "up")])
@cases("mains_hz", [50.0, 60.0])
def test_flicker_is_the_mean_of_the_lamps_while_a_line_is_exposed(shutter, mains_hz):
    own, lines = Flicker(mains_hz=mains_hz, modulation=0.4), 7
    found = brightness(own, shutter, 12.345, 0.7, lines)
    for line, middle_s in enumerate(shutter.line_times_s(lines)):
        times_s = 12.345 + middle_s + shutter.exposure_s * ((np.arange(20_000) + 0.5) / 20_000 - 0.5)
        wanted = (1 + 0.4 * np.cos(4 * np.pi * mains_hz * times_s + 0.7)).mean()
        assert found[line] == pytest.approx(wanted, abs=1e-8)


def test_whole_periods_do_not_flicker():
    found = brightness(Flicker(modulation=1.0), Shutter.centred(0.02, 0.03), 3.2, 0.1, 50)
    assert found == pytest.approx(1.0, abs=1e-12)


def test_bands_lie_across_the_readout():
    image = np.full((40, 30, 3), encoded(0.3), np.float32)
    (kind,) = (registry()["flicker"],)
    own = Flicker(modulation=0.5)
    seen = {
        direction: linear(kind.apply(image, own, FrameContext(0, (3, "", ""), stamp_s=0.4, shutter=shutter)))
        for direction in ("down", "up", "right", "left")
        for shutter in [Shutter.centred(0.001, 0.02, direction)]
    }
    assert np.ptp(seen["down"], axis=1).max() == 0
    assert np.ptp(seen["down"], axis=0).max() == pytest.approx(0.3, rel=0.05), "up and down by half, less the sinc"
    assert seen["up"] == pytest.approx(seen["down"][::-1], abs=1e-6)
    assert np.ptp(seen["right"], axis=0).max() == 0
    assert seen["left"] == pytest.approx(seen["right"][:, ::-1], abs=1e-6)
    whole = linear(kind.apply(image, own, FrameContext(0, (3, "", ""), stamp_s=0.4)))
    assert np.ptp(whole) == 0, "all lines at once"


# --- what contradicts itself ---


@cases(
    "steps, problem",
    [
        (
            [{"auto_exposure": {"min_ms": 40.0}}],
            "auto_exposure: min_ms is 40, more than max_ms, 33; change one of them",
        ),
        ([{"auto_exposure": {}}, {"auto_exposure": {}}], "auto_exposure is given twice; a camera has one of it"),
        ([{"flicker": {"mains_hz": 0}}], "mains_hz"),
        ([{"sensor_noise": {"bits": 17}}], "bits"),
    ],
)
def test_contradictions_are_one_line(steps, problem):
    with pytest.raises(InputError) as error:
        parse_steps(steps, ConfigPath("preset"), registry())
    assert problem in str(error.value)
    assert "\n" not in str(error.value)
