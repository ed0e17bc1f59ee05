# SPDX-License-Identifier: GPL-3.0-or-later
"""What colour says of a camera over time and over its files: known in, known out."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from noisy_world.core.schema import ConfigPath
from noisy_world.measure.coding import coding
from noisy_world.measure.colour_noise import colour_noise
from noisy_world.measure.fixed_noise import fixed_noise
from noisy_world.measure.footage import footage_of
from noisy_world.measure.recorded_light import light_figures, light_of
from noisy_world.perturb import apply
from noisy_world.sources.recording import read_recording

RNG = np.random.default_rng(8)
SAMPLINGS = {
    "jpeg_420_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    "jpeg_422_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "jpeg_444_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
}


def jpeg(quality, sampling=cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, chroma=None):
    image = RNG.integers(0, 255, (16, 32, 3)).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    if chroma is not None:
        options += [cv2.IMWRITE_JPEG_LUMA_QUALITY, quality, cv2.IMWRITE_JPEG_CHROMA_QUALITY, chroma]
    return cv2.imencode(".jpg", image, options)[1].tobytes()


def coded(*files):
    """What files of colour say of their coding: figures by name, and remarks."""
    opened = SimpleNamespace(encoded_colour=lambda frame: files[frame])
    found = coding(SimpleNamespace(opened=opened), range(len(files)))
    return {figure.name: figure for figure in found.figures}, " ".join(found.remarks)


@pytest.mark.parametrize("quality", [1, 25, 49, 50, 51, 80, 95, 100])
@pytest.mark.parametrize("share", SAMPLINGS)
def test_quality_and_sampling_of_a_jpeg_are_exact(quality, share):
    figures, _ = coded(jpeg(quality, SAMPLINGS[share]))
    assert figures["jpeg_quality"].value == quality
    assert figures["jpeg_tables_apart_share"].value == 0
    assert {name: figures[name].value for name in SAMPLINGS} == dict.fromkeys(SAMPLINGS, 0) | {share: 1}


def test_tables_of_another_encoder_are_said_to_be():
    figures, remark = coded(jpeg(90, chroma=40))
    assert 40 < figures["jpeg_quality"].value < 95
    assert figures["jpeg_tables_apart_share"].value > 0.1
    assert "not those of libjpeg" in remark


def test_qualities_that_differ_are_said_to_and_what_is_no_jpeg_is_told():
    figures, remark = coded(jpeg(60), jpeg(70), jpeg(80))
    assert [getattr(figures["jpeg_quality"], name) for name in ("low", "value", "high")] == [60.5, 70, 79.5]
    assert "60 to 80" in remark
    figures, _ = coded(cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    assert figures["jpeg_quality"].value is None
    assert "JPEG" in figures["jpeg_quality"].untold


@pytest.mark.parametrize("quality", [50, 80])
def test_a_jpeg_takes_the_noise_that_is_said(quality):
    """Of a grey image with white noise of the deviation that the remark names, a tenth of the variance is left."""
    _, remark = coded(jpeg(quality))
    std = float(remark.split("less than ")[1].split()[0])
    image = np.clip(np.rint(128 + RNG.normal(0, std, (256, 256))), 0, 255).astype(np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    left = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).astype(float).var()
    rounded = 1 / 12  # what whole numbers add, before and after
    assert left - rounded == pytest.approx(0.1 * (std**2 + rounded), rel=0.2)


FRAMES = 60
RATE_HZ = 30.0  # of which lamps of 100 Hz are seen at 10, and lamps of 120 Hz not at all


@pytest.fixture(scope="module")
def clean(walk):
    """Colour of the clean walk, and its camera."""
    source = read_recording(walk / "clean/room", ConfigPath("test"))
    with footage_of("walk", source, source.camera(None)) as footage:
        return [footage.colour(frame).copy() for frame in range(FRAMES)], footage.camera


def lit(clean, change, jitter_s=0.0):
    """Figures of the walk's light; change: of a frame, its number and its stamp. jitter_s: of what stamps say of it."""
    images, camera = clean
    stamps_s = np.arange(FRAMES) / RATE_HZ
    made = [change(image, number, float(stamps_s[number])) for number, image in enumerate(images)]
    off_s = jitter_s * np.random.default_rng(1).standard_normal(FRAMES)
    stamps = SimpleNamespace(rgb=SimpleNamespace(seconds=stamps_s + off_s))
    footage = SimpleNamespace(colour=lambda frame: made[frame], camera=camera, stamps=stamps)
    return {figure.name: figure for figure in light_figures(light_of(footage, [range(FRAMES)]))}


def exposed(image, stops):
    """An image with its linear light times 2^stops, by channel, by the standard's curve (IEC 61966-2-1)."""
    encoded = image / 255.0
    light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4) * 2.0 ** np.array(stops)
    again = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.clip(np.rint(255 * again), 0, 255).astype(np.uint8)


def test_light_that_stays_is_said_to_stay(clean):
    found = lit(clean, lambda image, *_: image)
    for name in ("exposure_range_stops", "white_balance_range_stops", "vignetting_corner_loss"):
        assert found[name].low <= 0 <= found[name].high, name
    assert found["flicker_swing_100_hz"].value < 0.005
    assert "same of it" in found["flicker_swing_120_hz"].untold


def test_exposure_and_white_balance(clean):
    found = lit(clean, lambda image, number, _: exposed(image, np.array([-0.8, -0.4, 0]) * number / (FRAMES - 1)))
    assert found["white_balance_range_stops"].value == pytest.approx(0.8, rel=0.1)
    assert found["exposure_range_stops"].value == pytest.approx(0.4, abs=0.06)


@pytest.mark.parametrize("lag_s", [0.15, 0.6])
def test_lag_of_auto_exposure(clean, lag_s):
    """A camera that begins a stop too dark goes 1 - exp(-gap / lag) of what lacks to its target from frame to frame."""
    stops = [-1.0]

    def metered(image, *_):
        shown = exposed(image, stops[-1])
        light = (((shown / 255.0 + 0.055) / 1.055) ** 2.4).mean(axis=(0, 1)) @ [0.2126, 0.7152, 0.0722]
        stops.append(stops[-1] + (1 - np.exp(-1 / RATE_HZ / lag_s)) * np.log2(0.25 / light))
        return shown

    figure = lit(clean, metered)["auto_exposure_lag_s"]
    assert figure.value == pytest.approx(lag_s, rel=0.1)
    assert figure.low < lag_s < figure.high


def test_exposure_that_follows_nothing_has_no_lag(clean):
    assert "stays" in lit(clean, lambda image, *_: image)["auto_exposure_lag_s"].untold
    swung = lit(clean, lambda image, number, _: exposed(image, 0.4 * np.sin(number / 3)))
    assert "does not follow" in swung["auto_exposure_lag_s"].untold


@pytest.mark.parametrize(("readout_ms", "jitter_s"), [(0.0, 0.0), (18.0, 0.0), (0.0, 0.0025)])
def test_flicker(clean, readout_ms, jitter_s):
    """Also where lines are read one by one, and where stamps jitter by a quarter of the lamps' period."""

    def under_lamps(image, number, stamp_s):
        given = {"modulation": 0.2, "exposure_ms": 4.0, "readout_ms": readout_ms}
        return apply(image, "flicker", **given, stamp_s=stamp_s, seed=3, frame=number)

    figures = lit(clean, under_lamps, jitter_s)
    swing, readout = figures["flicker_swing_100_hz"], figures["flicker_readout_ms"]
    assert swing.value == pytest.approx(0.2 * np.sinc(0.4), rel=0.05)
    assert swing.low < 0.2 * np.sinc(0.4) < swing.high
    if readout_ms:
        assert readout.value == pytest.approx(readout_ms, rel=0.05)
        assert readout.low < readout_ms < readout.high
    else:
        assert "not seen" in readout.untold


def test_stamps_that_jitter_hide_what_no_clock_shows(clean):
    hidden = lit(clean, lambda image, *_: image, jitter_s=0.004)["flicker_swing_100_hz"]
    assert "jitter" in hidden.untold


def test_vignetting(clean):
    loss = lit(clean, lambda image, *_: apply(image, "vignetting", corner_loss=0.5, intrinsics=clean[1]))
    figure = loss["vignetting_corner_loss"]
    assert figure.value == pytest.approx(0.5, rel=0.05)
    assert figure.low < 0.5 < figure.high


def fixed(images):
    return fixed_noise(SimpleNamespace(colour=lambda frame: images[frame]), range(len(images)))


def noisy(images, *parts):
    return [np.clip(np.rint(image + sum(part() for part in parts)), 0, 255).astype(np.uint8) for image in images]


def test_hot_pixels_stay_while_the_camera_moves(clean):
    images = clean[0][::4]
    shape = images[0].shape
    hot = np.zeros((*shape[:2], 1))
    hot[5::20, 7::20] = 60
    share = np.count_nonzero(hot) / hot.size
    found, *_ = fixed(noisy(images, lambda: hot, lambda: RNG.normal(0, 3, shape)))
    assert found.value == pytest.approx(share, rel=0.15)
    assert found.low < share < found.high
    assert fixed(images)[0].value < 1e-4
    assert "stands still" in fixed([images[0]] * 12)[0].untold
    assert "noise hides" in fixed(noisy(images, lambda: hot, lambda: RNG.normal(0, 22, shape)))[0].untold


def test_a_jpeg_hides_pixels_of_their_own_and_the_law_of_noise():
    images = [RNG.normal(level, 12, (192, 256, 3)).astype(np.uint8) for level in np.linspace(60, 190, 8)]
    looks = [SimpleNamespace(colour=image) for image in images]
    footage = SimpleNamespace(look=looks.__getitem__, colour=images.__getitem__)
    assert "JPEG" in fixed_noise(footage, range(8), jpeg=True)[0].untold
    found = colour_noise(footage, range(8), jpeg=True)
    assert found.curve
    assert "JPEG" in found.gaussian_std.untold
    assert "JPEG" in found.per_photon.untold


@pytest.mark.parametrize("turned", [False, True])
def test_noise_of_rows_and_of_columns(clean, turned):
    images = clean[0][::4]
    high, wide, _ = images[0].shape
    size = (1, wide, 1) if turned else (high, 1, 1)
    _, *found = fixed(noisy(images, lambda: RNG.normal(0, 3, size), lambda: RNG.normal(0, 2, images[0].shape)))
    along, across = found[::-1] if turned else found
    assert along.value == pytest.approx(3 / 255, rel=0.2)
    assert along.low < 3 / 255 < along.high
    assert across.low < 0
