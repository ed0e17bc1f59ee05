# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged images: every cut and every bit of a PNG, every cut of a JPEG."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from refusals import refused

from noisy_world.images.image_files import damage
from noisy_world.layouts.stored_recording import StoredFrame

RNG = np.random.default_rng(3)
COLOUR = cv2.GaussianBlur(RNG.integers(0, 256, (12, 17, 3), dtype=np.uint8), (0, 0), 3)
STEPS = RNG.integers(0, 65536, (12, 17), dtype=np.uint16)


def encoded(kind, pixels, *options):
    return cv2.imencode(kind, pixels, options)[1].tobytes()


WHOLE = {
    "colour.png": encoded(".png", COLOUR),
    "depth.png": encoded(".png", STEPS),
    "baseline.jpg": encoded(".jpg", COLOUR),
    "progressive.jpg": encoded(".jpg", COLOUR, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restarts.jpg": encoded(".jpg", COLOUR, cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
    "large.jpg": encoded(".jpg", RNG.integers(0, 256, (90, 120, 3), dtype=np.uint8)),
}


def text_chunk(text):
    content = b"tEXt" + text
    return struct.pack(">I", len(text)) + content + struct.pack(">I", zlib.crc32(content))


@pytest.mark.parametrize("name", WHOLE)
def test_whole_files(name):
    data = WHOLE[name]
    assert damage(data) == ""
    assert damage(data + b"\0\0 what a camera appends") == ""
    if name.endswith("png"):
        assert damage(data[:-12] + text_chunk(b"a\0b") + data[-12:]) == ""
    else:
        assert damage(data[:2] + b"\xff\xfe\x00\x06\xff\xd9ab" + data[2:]) == ""  # a comment that holds an end
        assert damage(data[:2] + b"\xff\xff\xff" + data[2:]) == ""  # fill bytes


@pytest.mark.one_python
@pytest.mark.parametrize("name", WHOLE)
def test_every_cut_is_seen(name):
    data = WHOLE[name]
    for length in range(8, len(data)):
        assert damage(data[:length])


@pytest.mark.parametrize("name", ["colour.png", "depth.png"])
def test_every_wrong_bit_of_a_png_is_seen(name):
    data = bytearray(WHOLE[name])
    for at in range(8, len(data)):
        for bit in range(8):
            data[at] ^= 1 << bit
            assert damage(bytes(data))
            data[at] ^= 1 << bit


def test_other_files_are_left_to_the_decoder():
    for data in (b"", b"\x89PNG", b"\xff", b"no image", encoded(".bmp", COLOUR)):
        assert damage(data) == ""


def test_a_frame_that_is_damaged_is_refused_at_once(tmp_path):
    # OpenCV believes a chunk of 3.8 GB in a file of a few hundred bytes, and needs a minute to refuse it.
    long = bytearray(WHOLE["colour.png"])
    long[33:37] = b"\xe6\x98\x00\xa1"
    for name, data, words in (
        ("rgb.png", bytes(long), "is damaged: it is cut short"),
        ("rgb.png", WHOLE["colour.png"].replace(b"IDAT", b"IDAX"), ("is damaged: the checksum", "'IDAX'")),
        ("rgb.jpg", WHOLE["large.jpg"][:-200], "is damaged: it is cut short"),
        ("rgb.jpg", WHOLE["large.jpg"].replace(b"\xff\xc4", b"ab\xff\xc4", 1), "its parts"),
        ("r" * 300, b"", "is not there or no image"),
    ):
        path = tmp_path / name
        if data:
            path.write_bytes(data)
        refused(lambda path=path: StoredFrame(path, path, 5000.0, (17, 12)).rgb, names=words)
