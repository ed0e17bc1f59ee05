# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of a picture is known before memory is taken for it."""

import struct
import tracemalloc

import cv2
import numpy as np
import pytest
from refusals import refused
from cases import cases
from rooms_in_formats import black_png

from noisy_world.core.errors import InputError
from noisy_world.scenes.textures import header_size_px
from noisy_world.scenes.textures import read_picture

PIXELS = np.random.default_rng(3).integers(0, 256, (37, 300, 3), np.uint8)


def encoded(suffix, *options):
    return cv2.imencode(suffix, PIXELS, options)[1].tobytes()


def bmp(width_px, height_px):
    return b"BM" + struct.pack("<IIIIiiHHIIIIII", 54, 0, 54, 40, width_px, height_px, 1, 24, 0, 0, 0, 0, 0, 0)


@cases(
    "data",
    [
        encoded(".png"),
        encoded(".jpg"),
        encoded(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 4),
        encoded(".bmp"),
        encoded(".tiff"),
        encoded(".webp"),
        encoded(".webp", cv2.IMWRITE_WEBP_QUALITY, 101),  # without losses
        cv2.imencode(".webp", np.dstack([PIXELS, PIXELS[..., :1]]))[1].tobytes(),  # with alpha: the long header
    ],
)
def test_sizes_of_every_kind(tmp_path, data):
    assert header_size_px(data) == (300, 37)
    (tmp_path / "a.img").write_bytes(data)
    assert read_picture(tmp_path / "a.img")[0].shape == (37, 300, 3)
    for length in (1, 4, 13, 20, 25):
        (tmp_path / "a.img").write_bytes(data[:length])
        with pytest.raises(InputError):
            read_picture(tmp_path / "a.img")


@cases("data", [black_png(32_000, 32_000), black_png(40_000, 10), bmp(32_000, -32_000), bmp(-(2**31), 1)])
def test_a_small_file_of_a_large_picture_is_not_decoded(tmp_path, data):
    (tmp_path / "a.png").write_bytes(data)
    tracemalloc.start()
    refused(read_picture, tmp_path / "a.png", names=("a.png: ", "at most 268435456 pixels", "scale it down"))
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


def test_other_kinds_are_refused(tmp_path):
    for suffix in (".ppm", ".jp2", ".hdr"):
        (tmp_path / "a.png").write_bytes(encoded(suffix))
        refused(read_picture, tmp_path / "a.png", names=("a.png: ", "PNG, JPEG, BMP, TIFF and WebP"))
