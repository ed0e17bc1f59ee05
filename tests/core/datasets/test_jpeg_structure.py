# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEGs that are damaged as far as their structure tells, by the standard's tables, and sound ones of many encoders."""

import io
import itertools
import struct

import cv2
import numpy as np
import pytest
from refusals import refused
from cases import cases
from fuzz.jpegs import parts

from noisy_world.core.datasets.image_header import DamagedImageError, UnfitImageError
from noisy_world.core.datasets.jpeg_structure import check_structure

RNG = np.random.default_rng(4)
ROWS, COLUMNS = np.mgrid[:37, :53]
WAVES = np.stack([127 + 110 * np.sin(COLUMNS / 7 + k) * np.cos(ROWS / (5 + k)) for k in range(3)], -1)
PIXELS = np.clip(WAVES + RNG.normal(0, 12, WAVES.shape), 0, 255).astype(np.uint8)


def encoded(pixels=PIXELS, *, restart=0, progressive=0, optimised=0, sampling=0x221111, quality=90):
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    options += [cv2.IMWRITE_JPEG_RST_INTERVAL, restart, cv2.IMWRITE_JPEG_PROGRESSIVE, progressive]
    return cv2.imencode(".jpg", pixels, [*options, cv2.IMWRITE_JPEG_OPTIMIZE, optimised])[1].tobytes()


NOISE = RNG.integers(0, 256, (200, 200, 3), np.uint8)
DATA, RESTARTED, PROGRESSIVE = encoded(), encoded(restart=3), encoded(progressive=1)


def changed(data, marker, at, value, which=0):
    """The file with bytes of a segment's content replaced, from a place in it on. marker: 0xDB, or "scan"."""
    start = [part[1] for part in parts(data) if part[0] == marker][which] + (0 if marker == "scan" else 4)
    return data[: start + at] + value + data[start + at + len(value) :]


def spliced(data, marker, more, which=0):
    """The file with bytes before a segment."""
    start = [part[1] for part in parts(data) if part[0] == marker][which]
    return data[:start] + more + data[start:]


def without(data, marker, which=0):
    _, start, end = [part for part in parts(data) if part[0] == marker][which]
    return data[:start] + data[end:]


def test_sound_files_are_taken():
    odd = [(1, 1), (8, 8), (9, 17), (37, 53)]
    plain = [np.full((*size, 3), 7, np.uint8) for size in odd]
    noise = [RNG.integers(0, 256, (*size, 3), np.uint8) for size in odd]
    samplings = (0x411111, 0x221111, 0x211111, 0x121111, 0x111111)
    for pixels, quality, sampling in itertools.product([*plain, *noise, PIXELS], (1, 50, 100), samplings):
        for progressive, optimised, restart in ((0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 4), (0, 0, 65535)):
            keys = {"sampling": sampling, "quality": quality, "restart": restart}
            check_structure(encoded(pixels, progressive=progressive, optimised=optimised, **keys))
        check_structure(encoded(pixels[..., 0].copy(), quality=quality))


def test_sound_files_of_pillow_are_taken():
    image = pytest.importorskip("PIL.Image").fromarray(PIXELS)
    for mode, options in itertools.product(
        ("RGB", "L", "CMYK"),
        (
            {"quality": 1}, {"quality": 100, "subsampling": 0}, {"subsampling": 1}, {"progressive": True},
            {"restart_marker_rows": 1}, {"restart_marker_blocks": 2, "progressive": True}, {"optimize": True},
            {"icc_profile": b"\xff\xd9" * 40_000}, {"exif": b"Exif\0\0no tiff"}, {"comment": b"\xff\xda\xff\xd9"},
            {"dpi": (0, 0)}, {"qtables": [[1] * 64, [255] * 64]},
        ),
    ):  # fmt: skip
        file = io.BytesIO()
        image.convert(mode).save(file, "JPEG", **options)
        check_structure(file.getvalue())
        check_structure(file.getvalue() + b"what stands behind the end")


@cases(
    ("data", "told"),
    [
        (changed(DATA, 0xDB, 10, b"\0"), "a quantisation table has a step of 0"),
        (changed(DATA, 0xDB, 0, b"\x04"), "a quantisation table is none"),
        (changed(DATA, 0xDB, 0, b"\x10"), "a quantisation table is none"),
        (changed(DATA, 0xC4, 0, b"\x20"), "a Huffman table is none"),
        (changed(DATA, 0xC4, 1, b"\x01"), "a Huffman table is none"),
        (changed(DATA, 0xC4, 17, b"\x01"), "a Huffman table is none"),
        (changed(DATA, 0xC4, 17, b"\x0c"), "a Huffman table is none"),
        (changed(DATA, 0xC4, 17, b"\x0b", 1), "a Huffman table is none"),
        (changed(DATA, 0xC4, 17, b"\x10", 1), "a Huffman table is none"),
        (spliced(DATA, 0xDA, b"\xff\xc4\0\x15\x00" + bytes([2, *[0] * 15, 0, 1])), "a Huffman table is none"),
        (changed(DATA, 0xC0, 1, b"\x08\0"), "too few or too many bytes for an image of its size"),
        (changed(encoded(NOISE, quality=100), 0xC0, 1, b"\0\x01"), "too few or too many bytes for an image"),
        (changed(DATA, 0xC0, 7, b"\x50"), "its header contradicts itself"),
        (changed(DATA, 0xC0, 7, b"\x02"), "its header contradicts itself"),
        (changed(DATA, 0xC0, 7, b"\x44"), "the header of a scan does not fit"),
        (changed(DATA, 0xC0, 8, b"\x03"), "the header of a scan does not fit"),
        (changed(DATA, 0xC0, 9, b"\x01"), "its header contradicts itself"),
        (changed(DATA, 0xDA, 1, b"\x07"), "the header of a scan does not fit"),
        (changed(DATA, 0xDA, 2, b"\x22"), "the header of a scan does not fit"),
        (changed(DATA, 0xDA, 7, b"\x01"), "the header of a scan does not fit"),
        (changed(DATA, 0xDA, 8, b"\x3e"), "the header of a scan does not fit"),
        (changed(DATA, 0xDA, 9, b"\x10"), "the header of a scan does not fit"),
        (without(DATA, "scan"), "too few or too many bytes"),
        (without(DATA, 0xDA), "its parts do not follow one another"),
        (without(DATA, 0xDB), "the header of a scan does not fit"),
        (DATA[:-2], "it is cut short"),
        (DATA[:-2] + b"\xff\xc4", "it is cut short"),
        (spliced(DATA, 0xC4, b"\0\0"), "its parts do not follow one another"),
        (spliced(DATA, 0xDA, b"\xff\xd0"), "its parts do not follow one another"),
        (spliced(DATA, 0xD9, b"\xff\xd0"), "a scan has 1 restarts, where an image of its size has 0"),
        (changed(RESTARTED, 0xDD, 0, b"\0\2"), "a scan has 3 restarts, where an image of its size has 5"),
        (changed(RESTARTED, 0xC0, 1, b"\0\x10"), "a scan has 3 restarts, where an image of its size has 1"),
        (RESTARTED.replace(b"\xff\xd1", b"\xff\xd2", 1), "its restarts are not in their order"),
        (spliced(changed(RESTARTED, 0xDD, 0, b"\0\6"), 0xD9, b""), "a scan has 3 restarts, where an image"),
        (changed(PROGRESSIVE, 0xDA, 9, b"\x10"), "the header of a scan does not fit"),
        (changed(PROGRESSIVE, 0xDA, 3, b"\x00", 1), "the header of a scan does not fit"),
        (PROGRESSIVE[:-2] + PROGRESSIVE[PROGRESSIVE.rindex(b"\xff\xda") :], "the header of a scan does not fit"),
        (spliced(DATA, 0xDB, b"\xff\xee\0\x0eAdobe\0\x64\0\0\0\0\x09"), "says of its colours"),
    ],
)  # fmt: skip
def test_what_contradicts_the_standard_is_damaged(data, told):
    with pytest.raises(DamagedImageError) as error:
        check_structure(data)
    assert told in error.value.what


def test_steps_of_16_bits_are_none_of_0_either():
    table = b"\x10" + struct.pack(">64H", *[300] * 64)
    extended = DATA.replace(b"\xff\xc0", b"\xff\xc1", 1)
    wide = spliced(extended, 0xDA, b"\xff\xdb" + struct.pack(">H", len(table) + 2) + table)
    check_structure(wide)
    zero = wide.replace(struct.pack(">64H", *[300] * 64), struct.pack(">64H", *[300] * 63, 0))
    refused(check_structure, zero, names="step of 0", error=DamagedImageError)


def test_more_scans_than_any_encoder_writes():
    """An image of one grey block whose coefficients have a scan each, for three components."""

    def segment(marker, *content):
        return bytes([0xFF, marker]) + struct.pack(">H", len(bytes(content)) + 2) + bytes(content)

    one_code = (1, *[0] * 15, 0)  # a table with the value 0 alone, as the code 0
    head = b"\xff\xd8" + segment(0xDB, 0, *[1] * 64)
    head += segment(0xC2, 8, 0, 8, 0, 8, 3, *(part for k in (1, 2, 3) for part in (k, 0x11, 0)))
    head += segment(0xC4, 0x00, *one_code) + segment(0xC4, 0x10, *one_code)
    first = segment(0xDA, 3, 1, 0, 2, 0, 3, 0, 0, 0, 0) + b"\x1f"
    others = [segment(0xDA, 1, name, 0, k, k, 0) + b"\x7f" for k in range(1, 64) for name in (1, 2, 3)]
    few = head + first + b"".join(others[:99]) + b"\xff\xd9"
    check_structure(few)
    assert (cv2.imdecode(np.frombuffer(few, np.uint8), cv2.IMREAD_COLOR) == 128).all()
    many = head + first + b"".join(others) + b"\xff\xd9"
    refused(check_structure, many, names="100 scans", error=UnfitImageError)
