# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as bytes: nothing wraps, nothing shifts, colours keep their order."""

import io
import struct
import zlib
from fractions import Fraction
from importlib.util import find_spec

import cv2
import numpy as np
import pytest
from cases import cases
from refusals import refused

from noisy_world.images.pixels import (
    decode_png,
    decode_steps,
    encode_colour,
    encode_png,
    grey_bytes,
    quantise_depth,
    rgb_bytes,
)
from noisy_world.layouts import LAYOUTS


@pytest.mark.parametrize("scale", [6553.5, 5000.0])
def test_depth_is_within_half_a_step(scale):
    depth_m = np.random.default_rng(0).uniform(0.001, 65535 / scale, (300, 400)).astype(np.float32)
    steps = quantise_depth(depth_m, scale)
    assert steps.dtype == np.uint16
    assert np.abs(steps / scale - depth_m.astype(float)).max() <= 0.5 / scale + 1e-12


def test_what_does_not_fit_is_void():
    limit = 65535 / 6553.5
    odd = [0.0, -1.0, np.nan, np.inf, -np.inf, 1e10, limit + 1e-3, 12.0, 20.0, 0.4 / 6553.5]
    assert not quantise_depth(np.array([odd], np.float32), 6553.5).any()
    assert quantise_depth(np.array([[limit]], np.float32), 6553.5)[0, 0] == 65535
    assert quantise_depth(np.array([[0.6 / 6553.5]], np.float32), 6553.5)[0, 0] == 1


@cases(("dtype", "shape"), [(np.uint8, (37, 51)), (np.uint8, (37, 51, 3)), (np.uint16, (37, 51)),
                            (np.uint16, (37, 51, 3)), (np.uint16, (1, 1)), (np.uint16, (300, 2000))])  # fmt: skip
def test_png_is_lossless_whoever_reads_it(dtype, shape):
    rng = np.random.default_rng(0)
    noise = rng.integers(0, np.iinfo(dtype).max, shape, endpoint=True).astype(dtype)
    ramp = np.add.outer(np.arange(shape[0]) * 3, np.arange(shape[1]) * 5).astype(dtype)
    smooth = ramp if len(shape) == 2 else np.stack([ramp, ramp // 2, ramp // 3], axis=-1)
    for pixels in (noise, smooth, noise[::-1, ::-1], np.zeros(shape, dtype), np.full(shape, np.iinfo(dtype).max)):
        data = encode_png(pixels.astype(dtype, copy=False))
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(decoded[..., ::-1] if len(shape) == 3 else decoded, pixels)
        assert decoded.dtype == dtype
        ours = decode_png(data)
        assert ours.dtype == dtype
        assert np.array_equal(ours, pixels)
        (length,) = struct.unpack(">I", data[33:37])  # of the pixels, behind signature and header
        rows = np.frombuffer(zlib.decompress(data[41 : 41 + length]), np.uint8).reshape(shape[0], -1)
        assert (rows[:, 0] == 2).all()
        rows = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8)
        assert np.array_equal(rows.reshape(-1).view(np.dtype(dtype).newbyteorder(">")).reshape(shape), pixels)
        if find_spec("PIL") and (len(shape) == 2 or dtype == np.uint8):  # it reads no 16 bits of three channels
            from PIL import Image

            assert np.array_equal(np.asarray(Image.open(io.BytesIO(data))), pixels)
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    assert len(encode_png(smooth)) <= 1.1 * cv2.imencode(".png", smooth, options)[1].nbytes + 100


def test_what_another_wrote_or_damaged_is_left_to_opencv():
    pixels = np.arange(48, dtype=np.uint16).reshape(6, 8) * 1000
    for filters in (cv2.IMWRITE_PNG_FILTER_SUB, cv2.IMWRITE_PNG_FILTER_PAETH, cv2.IMWRITE_PNG_ALL_FILTERS):
        data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_FILTER, filters])[1].tobytes()
        assert decode_png(data) is None
        assert np.array_equal(decode_steps(data), pixels)
    unfiltered = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE])[1].tobytes()
    assert np.array_equal(decode_png(unfiltered), pixels)
    data = encode_png(pixels)
    for cut in range(len(data) - 4):
        assert decode_png(data[:cut]) is None
    for at in range(41, len(data) - 16):  # of the pixels, whose sum is checked
        assert decode_png(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]) is None
    refused(decode_steps, data[:-30], names="is no PNG of 16 bits", error=ValueError)


def test_rgb_keeps_its_order_and_rounds_to_nearest():
    rgb = np.zeros((2, 3, 3), np.float32)
    rgb[0, 0] = [1.0, 0.5, 0.0]
    rgb[0, 1] = [1.7, -0.2, 100.49 / 255]
    rgb[0, 2] = [100.51 / 255, np.float32(37) / 255, np.float32(254) / 255]
    pixels = rgb_bytes(rgb)
    assert pixels[0].tolist() == [[255, 128, 0], [255, 0, 100], [101, 37, 254]]
    decoded = cv2.imdecode(np.frombuffer(encode_colour(pixels, "png"), np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(decoded[..., ::-1], pixels)


def test_jpeg_adds_nothing_visible():
    rng = np.random.default_rng(0)
    smooth = cv2.resize(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)
    noisy = np.clip(smooth + rng.normal(0, 20, smooth.shape), 0, 255).astype(np.uint8)
    for pixels in (smooth, noisy):
        decoded = cv2.imdecode(np.frombuffer(encode_colour(pixels, "jpg"), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        error = decoded.astype(float) - pixels
        assert 10 * np.log10(255**2 / (error**2).mean()) > 40  # chroma subsampling alone brings the noisy one to 18


@pytest.mark.parametrize("grey", [False, True])
def test_noisy_jpegs_have_tables_of_their_own_and_the_same_pixels(grey):
    rng = np.random.default_rng(0)
    smooth = cv2.resize(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)
    noisy = np.clip(smooth + rng.normal(0, 20, smooth.shape), 0, 255).astype(np.uint8)
    for image, fitted in ((smooth, False), (noisy, True)):
        pixels = image[..., 0].copy() if grey else image
        data, plain = encode_colour(pixels, "jpg"), encode_colour(pixels, "jpg", fit_tables=False)
        assert (data != plain) is fitted
        # Annex K.3 of ITU-T T.81: the codes of the luminance's DC coefficients have these lengths.
        assert (b"\0\x00\x01\x05\x01\x01\x01\x01\x01\x01" in data) is not fitted
        assert len(data) < 0.9 * len(plain) or not fitted
        assert np.array_equal(
            *(cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR) for file in (data, plain))
        )


def test_one_pixel():
    assert cv2.imdecode(np.frombuffer(encode_colour(np.full((1, 1, 3), 7, np.uint8), "png"), np.uint8), 1).tolist() == [
        [[7] * 3]
    ]
    assert encode_png(np.ones((1, 1), np.uint16))
    assert cv2.imdecode(np.frombuffer(encode_colour(np.full((1, 2), 7, np.uint8), "jpg"), np.uint8), 0).tolist() == [
        [7] * 2
    ]


def test_names_sort_as_numbers():
    frames = [0, 9, 10, 99999, 100000]
    for layout in [layout for name, layout in LAYOUTS.items() if name != "scannet"]:  # whose readers sort by numbers
        names = (
            [layout.rgb_name(k, k * 10**7, "png") for k in frames],
            [layout.depth_name(k, k * 10**7) for k in frames],
        )
        for found in names:
            assert sorted(found) == found
            assert len(set(found)) == len(frames)


def test_bytes_are_the_nearest_and_what_lies_outside_is_clipped():
    steps = np.arange(256, dtype=np.float64)
    values = np.concatenate([steps, steps + 0.499, steps - 0.499, [-40, 300, -np.inf, np.inf]]) / 255
    wanted = np.clip(np.rint(values * 255), 0, 255)
    for shape in ((-1, 1, 1), (1, -1), (4, -1, 1)):
        found = rgb_bytes(values.astype(np.float32).reshape(shape))
        assert found.dtype == np.uint8
        assert np.array_equal(found.ravel(), wanted)


def exact_grey(rgb):
    """BT.601's weights on bytes, in fractions, half a byte rounded up."""
    weights = Fraction(299, 1000), Fraction(587, 1000), Fraction(114, 1000)
    rows = np.asarray(rgb).reshape(-1, 3).tolist()
    values = [sum(weight * value for weight, value in zip(weights, row, strict=True)) for row in rows]
    return np.array([int(value + Fraction(1, 2)) for value in values]).reshape(np.shape(rgb)[:-1])


def test_grey_is_the_weighted_sum_of_encoded_values():
    by_hand = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [1, 2, 3], [200, 100, 50]]
    # 76.245, 149.685, 29.07, 255, 0, 1.815, 59.8 + 58.7 + 5.7 = 124.2
    assert grey_bytes(np.array([by_hand], np.uint8)).tolist() == [[76, 150, 29, 255, 0, 2, 124]]
    rgb = np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8)
    rgb[:10] = rgb[:10, :, :1]  # grey stays what it is
    found = grey_bytes(rgb)
    assert found.dtype == np.uint8
    assert np.array_equal(found, exact_grey(rgb))
    assert np.array_equal(found[:10], rgb[:10, :, 0])
    # OpenCV's own has the same weights in fewer digits.
    assert np.abs(found.astype(int) - cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)).max() <= 1


def test_grey_of_floats_is_rounded_once():
    rgb = np.array([[[10.4, 10.4, 12.4], [300, -7, 0], [255, 255, 255]]], np.float32) / np.float32(255)
    # By way of bytes it would be 10, 10 and 12: 10.228. 300 is clipped to 255.
    assert grey_bytes(rgb).tolist() == [[11, 76, 255]]
    rgb = np.random.default_rng(1).random((40, 50, 3)).astype(np.float32)
    exact = 255 * (rgb.astype(float) @ [0.299, 0.587, 0.114])
    assert np.abs(grey_bytes(rgb) - exact).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("image", ["png", "jpg"])
def test_grey_is_one_channel_on_disk(tmp_path, image):
    grey = np.random.default_rng(0).integers(0, 256, (20, 30)).astype(np.uint8)
    path = tmp_path / f"grey.{image}"
    path.write_bytes(encode_colour(grey, image))
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found.shape == (20, 30)
    assert found.dtype == np.uint8
    if image == "png":
        assert np.array_equal(found, grey)
        header = path.read_bytes()[:33]  # signature, then the chunk IHDR: width, height, depth of bits, kind of colour
        assert header[12:16] == b"IHDR"
        assert (header[24], header[25]) == (8, 0)


def test_what_lies_beyond_is_void_or_the_farthest():
    limit_m = 65535 / 5000
    depth_m = np.array([[limit_m, limit_m + 1e-3, 1e10, np.inf, 0.0, -1.0, np.nan, -np.inf, 1.0]], np.float32)
    assert quantise_depth(depth_m, 5000.0, "void").tolist() == [[65535, 0, 0, 0, 0, 0, 0, 0, 5000]]
    assert quantise_depth(depth_m, 5000.0, "farthest").tolist() == [[65535, 65535, 65535, 65535, 0, 0, 0, 0, 5000]]
