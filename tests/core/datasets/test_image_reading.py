# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of recordings as several encoders write them, read as OpenCV reads them, or refused in a line that says why.

PNG files are written here by hand, part by part; JPEG files by OpenCV and, where it is there, by Pillow.
"""

import dataclasses
import hashlib
import io
import itertools
import os
import struct
import zlib

import cv2
import numpy as np
import OpenEXR
import pytest
from refusals import refused

from noisy_world.images.image_files import check_whole, read_header, whole_image
from noisy_world.images import array_files
from noisy_world.images.image_header import (
    LARGEST_PIXELS,
    UnfitImageError,
    check_scans,
    exif_orientation,
    jpeg_header,
    png_header,
)
from noisy_world.images.image_files import metres, read_colour, read_steps

RNG = np.random.default_rng(11)
WIDE, HIGH = 21, 19
SIZE = (WIDE, HIGH)
ROWS, COLUMNS = np.mgrid[:HIGH, :WIDE]
PIXELS = np.stack([COLUMNS * 11, ROWS * 12, (COLUMNS + ROWS) * 6], -1).astype(np.uint8)
SAMPLINGS = [getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{name}") for name in (411, 420, 422, 440, 444)]
# ISO/IEC 15948, 8.2: where each pass begins, and its steps.
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}


def part(name, content):
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(colour_type, bits, *, interlaced=False, before=b"", after=b"", raw=None, cut=2):
    """A PNG of random pixels and filters, its pixels in two parts."""
    passes = ADAM7 if interlaced else ((0, 0, 1, 1),)
    if raw is None:
        raw = b"".join(rows(-(-(WIDE - x) // dx), -(-(HIGH - y) // dy), bits * SAMPLES[colour_type]) for x, y, dx, dy in passes)  # noqa: E501  # fmt: skip
    data = zlib.compress(raw)
    pixels = part(b"IDAT", data[: len(data) // cut]) + part(b"IDAT", data[len(data) // cut :])
    palette = part(b"PLTE", RNG.bytes(3 * 2**bits)) if colour_type == 3 else b""
    header = part(b"IHDR", struct.pack(">IIBBBBB", WIDE, HIGH, bits, colour_type, 0, 0, interlaced))
    return b"\x89PNG\r\n\x1a\n" + header + before + palette + after + pixels + part(b"IEND", b"")


def rows(wide, high, bits_a_pixel):
    line = (wide * bits_a_pixel + 7) // 8
    return b"".join(bytes([int(RNG.integers(5))]) + RNG.bytes(line) for _ in range(high))


def read(tmp_path, data, size=SIZE):
    path = tmp_path / "image"
    path.write_bytes(data)
    return read_colour(path, size)


def as_opencv(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


# --- sound files ---


def test_every_kind_of_png_is_read_as_opencv_reads_it(tmp_path, capfd):
    kinds = {0: (1, 2, 4, 8), 2: (8, 16), 3: (1, 2, 4, 8)}
    profile = part(b"iCCP", b"x\0\0" + zlib.compress(b"no profile"))  # of which libpng would print a warning
    others = part(b"gAMA", struct.pack(">I", 45455)) + part(b"sRGB", b"\0"), part(b"tEXt", b"a\0b")
    for colour_type, widths in kinds.items():
        for bits, interlaced, extra in itertools.product(widths, (False, True), (False, True)):
            before, after = others if extra else (b"", b"")
            data = png(colour_type, bits, interlaced=interlaced, before=before, after=after)
            found = read(tmp_path, data + b"trailing" * extra)
            if bits < 16:
                assert found.dtype == np.uint8
                assert np.array_equal(found, as_opencv(data))
                assert np.array_equal(found, read(tmp_path, data[:33] + profile + data[33:]))
            else:  # kept: 16 bits as they stand in the file
                steps = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)[..., ::-1]
                assert found.dtype == np.float32
                assert np.array_equal(found, (steps / 65535).astype(np.float32))
    assert capfd.readouterr() == ("", "")


def test_jpeg_as_opencv_writes_it(tmp_path):
    for sampling, progressive, restart, optimised in itertools.product(SAMPLINGS, (0, 1), (0, 2), (0, 1)):
        options = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling, cv2.IMWRITE_JPEG_PROGRESSIVE, progressive]
        options += [cv2.IMWRITE_JPEG_RST_INTERVAL, restart, cv2.IMWRITE_JPEG_OPTIMIZE, optimised]
        data = cv2.imencode(".jpg", PIXELS, options)[1].tobytes()
        assert np.array_equal(read(tmp_path, data), as_opencv(data))
    grey = cv2.imencode(".jpg", PIXELS[..., 0].copy())[1].tobytes()
    assert np.array_equal(read(tmp_path, grey), as_opencv(grey))
    for more in (b"\0" * 100, data, b"\xff"):
        assert np.array_equal(read(tmp_path, data + more), as_opencv(data))


def test_jpeg_as_pillow_writes_it(tmp_path):
    image = pytest.importorskip("PIL.Image").fromarray(PIXELS)
    upright = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x01\0\0\0\0\0\0"
    for options in (
        {"subsampling": 0}, {"subsampling": 1}, {"progressive": True}, {"optimize": True}, {"keep_rgb": True},
        {"comment": b"\xff\xd9"}, {"icc_profile": b"x" * 70_000}, {"exif": upright}, {"exif": b"Exif\0\0no tiff"},
        {"restart_marker_rows": 1}, {"restart_marker_blocks": 2}, {"qtables": "web_high"}, {"quality": 1},
    ):  # fmt: skip
        file = io.BytesIO()
        image.save(file, "JPEG", **options)
        assert np.array_equal(read(tmp_path, file.getvalue()), as_opencv(file.getvalue())), options
    file = io.BytesIO()
    image.convert("CMYK").save(file, "JPEG")
    assert np.array_equal(read(tmp_path, file.getvalue()), as_opencv(file.getvalue()))
    assert read_header(tmp_path / "image").plainly is None


def test_png_as_pillow_writes_it(tmp_path):
    image = pytest.importorskip("PIL.Image").fromarray(PIXELS)
    made = [image.convert(mode) for mode in ("1", "L", "P", "RGB", "RGBA", "LA")]
    made += [image.quantize(2**bits) for bits in (1, 2, 4, 8)]
    for one, options in itertools.product(made, ({}, {"optimize": True}, {"compress_level": 0})):
        file = io.BytesIO()
        one.save(file, "PNG", **options)
        assert np.array_equal(read(tmp_path, file.getvalue()), as_opencv(file.getvalue())), (one.mode, options)


def frames_by_ffmpeg(folder, code, mark):
    """PIXELS, two by two, and the three images of a video of it, which begin with a mark."""
    path = folder / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), 10, (WIDE * 2, HIGH * 2))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no such video")
    wide = np.ascontiguousarray(np.tile(PIXELS, (2, 2, 1)))
    for _ in range(3):
        writer.write(wide)
    writer.release()
    frames = [mark + frame for frame in path.read_bytes().split(mark)[1:]]
    assert len(frames) == 3
    return wide, frames


def test_png_as_ffmpeg_writes_it(tmp_path):
    wide, frames = frames_by_ffmpeg(tmp_path, "MPNG", b"\x89PNG")
    for frame in frames:
        assert np.array_equal(read(tmp_path, frame, (WIDE * 2, HIGH * 2)), wide[..., ::-1])


def test_motion_jpeg_as_ffmpeg_writes_it(tmp_path):
    for frame in frames_by_ffmpeg(tmp_path, "MJPG", b"\xff\xd8\xff")[1]:
        assert np.array_equal(read(tmp_path, frame, (WIDE * 2, HIGH * 2)), as_opencv(frame))


# --- what is kept, and what is refused ---


def test_alpha_is_left_out_where_nothing_is_transparent(tmp_path):
    for dtype in (np.uint8, np.uint16):
        most = np.iinfo(dtype).max
        pixels = RNG.integers(0, most, (HIGH, WIDE, 4)).astype(dtype)
        pixels[..., 3] = most
        data = cv2.imencode(".png", pixels)[1].tobytes()
        found = read(tmp_path, data)
        wanted = pixels[..., 2::-1] if dtype == np.uint8 else (pixels[..., 2::-1] / 65535).astype(np.float32)
        assert np.array_equal(found, wanted)
        assert read_header(tmp_path / "image").plainly is None
        pixels[3, 4, 3] -= 1
        refused(read, tmp_path, cv2.imencode(".png", pixels)[1].tobytes(), names=("image: ", "transparent", "lay it"))
    # One colour of which nothing says that it is seen through: grey 1, and palette's every colour.
    same = b"\0" + b"\1" * WIDE
    for colour_type, told, row in (
        (0, b"\0\1", same),
        (2, b"\0\1" * 3, b"\0" + b"\1" * 3 * WIDE),
        (3, b"\0" * 256, same),
    ):
        data = png(colour_type, 8, after=part(b"tRNS", told), raw=row * HIGH)
        refused(read, tmp_path, data, names=("image: ", "transparent"))


def exif(value, order=">"):
    return {">": b"MM\0*", "<": b"II*\0"}[order] + struct.pack(f"{order}IHHHIHHI", 8, 1, 0x112, 3, 1, value, 0, 0)


def test_an_orientation_is_refused(tmp_path):
    jpg = cv2.imencode(".jpg", PIXELS)[1].tobytes()
    for value, order in itertools.product(range(1, 9), "<>"):
        told = b"Exif\0\0" + exif(value, order)
        files = {
            "jpg": jpg[:2] + b"\xff\xe1" + struct.pack(">H", len(told) + 2) + told + jpg[2:],
            "png": png(2, 8, before=part(b"eXIf", exif(value, order))),
            "later": png(2, 8)[:-12] + part(b"eXIf", exif(value, order)) + part(b"IEND", b""),
        }
        for name, data in files.items():
            if value == 1:
                assert np.array_equal(read(tmp_path, data), as_opencv(data)), name
                continue
            refused(read, tmp_path, data, names=("image: ", f"orientation {value}"))


def huge(wide, high):
    return png(2, 8)[:8] + part(b"IHDR", struct.pack(">IIBBBBB", wide, high, 8, 2, 0, 0, 0)) + png(2, 8)[33:]


def test_limits_before_memory(tmp_path):
    for data in (huge(60_000, 60_000), huge(1, 40_000), huge(2**31 - 1, 2**31 - 1)):
        refused(read, tmp_path, data, names=("image: ", f"at most {LARGEST_PIXELS} pixels"))
    jpg = bytearray(cv2.imencode(".jpg", PIXELS)[1].tobytes())
    at = jpg.index(b"\xff\xc0") + 5
    jpg[at : at + 4] = b"\xff\xff\xff\xff"
    refused(read, tmp_path, bytes(jpg), names=("image: ", "65535 x 65535 pixels"))
    path = tmp_path / "large.png"
    with path.open("wb") as file:
        file.truncate(2**31)
    refused(read_header, path, names=("large.png: ", "2147483648 bytes", "at most"))
    os.mkfifo(tmp_path / "pipe.png")
    refused(read_header, tmp_path / "pipe.png", names=("pipe.png: ", "is a pipe"))


WRONG = {
    "other parts between those of the pixels": (
        lambda: (data := png(2, 8))[: (at := data.rindex(b"IDAT") - 4)] + part(b"tEXt", b"a\0b") + data[at:],
        "its parts",
    ),
    "an animation": (lambda: png(2, 8, before=part(b"acTL", struct.pack(">II", 2, 0))), "animation"),
    "a part that nobody knows": (lambda: png(2, 8, before=part(b"ABCD", b"")), "'ABCD'"),
    "no pixels": (lambda: png(2, 8)[:33] + part(b"IEND", b""), "no pixels"),
    "the header is not first": (lambda: png(2, 8)[:8] + part(b"tEXt", b"a\0b") + png(2, 8)[8:], "its parts"),
    "bits that no grey has": (lambda: png(2, 8)[:8] + part(b"IHDR", struct.pack(">IIBBBBB", 3, 3, 3, 0, 0, 0, 0)) + png(2, 8)[33:], "its header"),  # noqa: E501
    "no size": (lambda: huge(0, 3), "0 x 3 pixels"),
    "another kind": (lambda: b"GIMP" * 99, "no image that can be read"),
    "an array": (lambda: npy(np.zeros((HIGH, WIDE), np.float32)), "32-bit floating point"),
    "nothing": (lambda: b"", "empty"),
    "16-bit grey": (lambda: png(0, 16), "16-bit grey"),
}  # fmt: skip


def test_what_is_no_colour_image(tmp_path):
    for make, named in WRONG.values():
        refused(read, tmp_path, make(), names=("image: ", named))


def test_what_is_no_depth_image(tmp_path):
    path = tmp_path / "depth"
    steps = RNG.integers(0, 65536, (HIGH, WIDE), dtype=np.uint16)
    for data, named in (
        (png(0, 8), "PNG of 8-bit grey"),
        (png(2, 16), "PNG of 16-bit colour"),
        (png(4, 16), "PNG of 16-bit grey with alpha"),
        (cv2.imencode(".jpg", PIXELS)[1].tobytes(), "JPEG of 8-bit colour"),
    ):
        path.write_bytes(data)
        refused(read_steps, path, SIZE, names=("depth: ", named, "has to be a PNG of 16-bit grey"))
    for data in (*(png(0, 16, interlaced=each) for each in (False, True)), cv2.imencode(".png", steps)[1].tobytes()):
        path.write_bytes(data)
        assert np.array_equal(read_steps(path, SIZE), cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
    refused(read_steps, path, (21, 20), names=("depth: ", "21 x 19", "21 x 20"))


def npy(values, save=np.save):
    stream = io.BytesIO()
    save(stream, values)
    return stream.getvalue()


def tiff(values):
    return cv2.imencode(".tiff", values)[1].tobytes()


def exr(values):
    stream = io.BytesIO()
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"R": values}).write(stream)
    return stream.getvalue()


METRES = RNG.uniform(0.5, 9, (HIGH, WIDE)).astype(np.float32)
METRES[0, :4] = np.nan, np.inf, -1, 0


@pytest.mark.parametrize(
    ("make", "values"),
    [
        (tiff, METRES),
        (exr, METRES),
        (npy, METRES),
        (npy, METRES.astype(np.float16)),
        (npy, METRES[..., None]),
        (lambda values: npy(values, np.savez_compressed), METRES),
        (tiff, np.nan_to_num(METRES * 1000, nan=0, posinf=0).clip(0).astype(np.uint16)),
    ],
)
def test_depth_is_read_from_what_holds_one_channel(tmp_path, make, values):
    (tmp_path / "depth").write_bytes(make(values))
    scale_per_m = 1000 if values.dtype == np.uint16 else 1
    found = metres(read_steps(tmp_path / "depth", SIZE), scale_per_m)
    expected = np.nan_to_num(METRES, nan=0, posinf=0).clip(0)
    np.testing.assert_allclose(
        found, expected, atol={np.float32: 0, np.float16: 4e-3, np.uint16: 1e-3}[values.dtype.type]
    )


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (npy(np.zeros((HIGH, WIDE), np.uint8)), "8-bit whole numbers"),
        (npy(np.zeros((HIGH, WIDE, 3), np.float32)), "height and width"),
        (npy(np.array([["a"]])), "an image holds numbers"),
        (npy(METRES)[:-9], "damaged"),
        (npy(METRES)[:40], "damaged"),
        (npy(METRES, np.savez)[:-9], "damaged"),
        (tiff(np.zeros((HIGH, WIDE), np.uint8)), "8-bit grey"),
    ],
)
def test_what_is_no_depth_array_is_one_line(tmp_path, data, named):
    (tmp_path / "depth").write_bytes(data)
    refused(read_steps, tmp_path / "depth", SIZE, names=("depth: ", named))


@pytest.mark.parametrize("suffix", [".bmp", ".tiff", ".webp", ".ppm"])
def test_colour_is_read_from_what_opencv_decodes(tmp_path, suffix):
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == ".webp" else []  # above 100: without loss
    (tmp_path / "image").write_bytes(cv2.imencode(suffix, PIXELS, options)[1].tobytes())
    assert np.array_equal(read_colour(tmp_path / "image", SIZE), PIXELS[..., ::-1])


# --- damage ---


def test_a_scan_that_is_damaged_is_refused_whether_its_pixels_are_asked_for_or_not(tmp_path):
    pixels = np.clip(np.kron(PIXELS, np.ones((4, 4, 1))) + RNG.normal(0, 9, (HIGH * 4, WIDE * 4, 3)), 0, 255)
    path, size = tmp_path / "image", (WIDE * 4, HIGH * 4)
    data = cv2.imencode(".jpg", pixels.astype(np.uint8))[1].tobytes()
    start = data.index(b"\xff\xda") + 20
    for at in range(start, len(data) - 200, (len(data) - start) // 20):
        refused(read, tmp_path, data[:at] + b"\xff\xd9", size, names=("image: ", "is damaged: its decoder says"))
        refused(check_whole, path, names=("image: ", "is damaged: its decoder says"))
    path.write_bytes(data)
    assert check_whole(path)[1] == hashlib.sha256(data).hexdigest()


def test_more_scans_than_any_encoder_writes(tmp_path):
    """An image of one grey block whose coefficients have a scan each, for three components."""

    def segment(marker, *content):
        return bytes([0xFF, marker]) + struct.pack(">H", len(bytes(content)) + 2) + bytes(content)

    one_code = (1, *[0] * 15, 0)  # a table with the value 0 alone, as the code 0
    head = b"\xff\xd8" + segment(0xDB, 0, *[1] * 64)
    head += segment(0xC2, 8, 0, 8, 0, 8, 3, *(item for k in (1, 2, 3) for item in (k, 0x11, 0)))
    head += segment(0xC4, 0x00, *one_code) + segment(0xC4, 0x10, *one_code)
    first = segment(0xDA, 3, 1, 0, 2, 0, 3, 0, 0, 0, 0) + b"\x1f"
    others = [segment(0xDA, 1, name, 0, k, k, 0) + b"\x7f" for k in range(1, 64) for name in (1, 2, 3)]
    few = head + first + b"".join(others[:99]) + b"\xff\xd9"
    assert (read(tmp_path, few, (8, 8)) == 128).all()
    many = head + first + b"".join(others) + b"\xff\xd9"
    refused(read, tmp_path, many, (8, 8), names="100 scans")


def test_a_file_is_held_against_what_was_written(tmp_path):
    path = tmp_path / "colour.png"
    data = cv2.imencode(".png", PIXELS)[1].tobytes()
    path.write_bytes(data)
    digest = hashlib.sha256(data).hexdigest()
    assert np.array_equal(read_colour(path, SIZE, digest), PIXELS[..., ::-1])
    path.write_bytes(cv2.imencode(".png", PIXELS + 1)[1].tobytes())
    refused(read_colour, path, SIZE, digest, names=("colour.png: ", "frames.jsonl has another SHA-256", "copy it"))
    path.write_bytes(data[:-30])
    refused(read_colour, path, SIZE, digest, names=("colour.png: ", "cut short"))


def test_sums_that_are_known_already_are_not_checked_again():
    data = bytearray(png(2, 8))
    data[-1] ^= 1
    assert whole_image(bytes(data), sums=False)[0].size_px == SIZE


def segment(marker, content):
    return bytes([0xFF, marker]) + struct.pack(">H", len(content) + 2) + content


def frame_of(channels, length=None):
    """The start of a JPEG's frame, of 21 x 19 pixels."""
    rows_of = b"".join(bytes([number, 0x11, 0]) for number in range(channels))
    return segment(0xC0, (bytes([8]) + struct.pack(">HH", HIGH, WIDE) + bytes([channels]) + rows_of)[:length])


SCAN = segment(0xDA, bytes([3, 0, 0]))
APART = "its parts do not follow one another"


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        (b"\xff\xd9", APART),  # an end before any scan
        (frame_of(3) + frame_of(3) + SCAN, APART),
        (SCAN, APART),  # no frame
        (b"\xff\xe0\0\1", APART),  # a length that does not hold itself
        (b"\x12\x34", APART),
        (frame_of(3, length=5) + SCAN, APART),
        (frame_of(3, length=12) + SCAN, APART),
        (frame_of(2) + SCAN, "is a JPEG of 2 channels"),
        (frame_of(3), "cut short"),
    ],
)
def test_segments_of_a_jpeg_that_do_not_follow_one_another(parts, told):
    refused(jpeg_header, io.BytesIO(b"\xff\xd8" + parts), names=told, error=UnfitImageError)


def test_a_segment_of_another_kind_says_no_orientation_of_a_jpeg():
    xmp = segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + exif(6))
    found = jpeg_header(io.BytesIO(b"\xff\xd8" + xmp + frame_of(3) + SCAN))
    assert (found.width_px, found.height_px, found.channels, found.orientation) == (WIDE, HIGH, 3, 1)
    turned = segment(0xE1, b"Exif\0\0" + exif(6))
    assert jpeg_header(io.BytesIO(b"\xff\xd8" + turned + frame_of(3) + SCAN)).orientation == 6


def test_a_png_whose_header_is_another_part_or_has_another_sum():
    whole = png(2, 8)
    refused(png_header, io.BytesIO(whole[:8] + whole[33:]), names=APART, error=UnfitImageError)
    damaged = bytearray(whole)
    damaged[19] ^= 1  # the width
    refused(png_header, io.BytesIO(bytes(damaged)), names="the checksum of its part 'IHDR'", error=UnfitImageError)


@pytest.mark.parametrize("order", "<>")
def test_an_orientation_is_looked_for_among_other_entries(order):
    entry, end = f"{order}HHIHH", {">": b"MM\0*\0\0\0\x08", "<": b"II*\0\x08\0\0\0"}[order]
    other, turned = struct.pack(entry, 0x100, 3, 1, 5, 0), struct.pack(entry, 0x112, 3, 1, 8, 0)
    count = struct.pack(f"{order}H", 2)
    assert exif_orientation(end + count + other + turned) == 8
    assert exif_orientation(end + count + other + other) == 1  # none says it
    assert exif_orientation(end + count + other + turned[:-1]) == 1  # cut short
    assert exif_orientation(end[:7]) == 1


def test_only_samplings_that_the_strict_decoder_knows_are_held_to_it():
    pytest.importorskip("simplejpeg")
    header = jpeg_header(io.BytesIO(b"\xff\xd8" + frame_of(3) + SCAN))
    refused(check_scans, header, b"no scan", names="its decoder says", error=UnfitImageError)
    unknown = dataclasses.replace(header, sampling=((3, 1), (1, 1), (1, 1)))
    assert check_scans(unknown, b"no scan") is None


def test_an_npz_holds_one_array_of_less_than_a_gigabyte(monkeypatch):
    file = io.BytesIO()
    np.savez(file, one=METRES, other=METRES)
    refused(array_files.array_values, file.getvalue(), names="is an NPZ of 2 parts", error=UnfitImageError)
    refused(array_files.array_values, b"", names="is no image that can be read", error=UnfitImageError)
    one = npy(METRES, np.savez)
    assert np.array_equal(array_files.array_values(one), METRES, equal_nan=True)
    monkeypatch.setattr(array_files, "LARGEST_BYTES", METRES.nbytes)  # its header is more
    refused(array_files.array_values, one, names="is an NPZ of a gigabyte", error=UnfitImageError)
