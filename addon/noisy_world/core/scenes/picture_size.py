# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of an image in pixels by its file's header, before memory is taken for it."""

import io
import struct
from collections.abc import Callable
from typing import Literal, TypeAlias

from ..datasets.image_header import DamagedImageError, read_exactly
from ..datasets.jpeg_files import END_OF_IMAGE, FRAMES, SIGNATURE, START_OF_SCAN, next_segment
from ..errors import InputError

LARGEST_PIXELS = 2**28  # 16384 x 16384, the largest texture that graphics cards are sure to take: 0.8 GB as RGB
LARGEST_SIDE_PX = 32768
KINDS = "PNG, JPEG, BMP, TIFF and WebP"

SizePx: TypeAlias = tuple[int, int]


def header_size_px(data: bytes) -> SizePx | None:
    """Return width and height as a picture's header says them; None for a file of another kind than KINDS.

    Raises ValueError where the header is damaged.
    """
    for begins, size in _READERS:
        if begins(data):
            try:
                return size(data)
            except (struct.error, IndexError) as error:
                raise ValueError("cut short: its header has no end") from error
            except DamagedImageError as error:
                raise ValueError(f"damaged: {error.what}") from error
    return None


def check_size_px(file: object, size_px: SizePx) -> None:
    """Raise InputError for a picture that is larger than those that are read."""
    width_px, height_px = size_px
    if width_px * height_px > LARGEST_PIXELS or max(size_px) > LARGEST_SIDE_PX:
        most = f"at most {LARGEST_PIXELS} pixels (16384 x 16384) are read, and {LARGEST_SIDE_PX} a side"
        problem = f"says that it is {width_px} x {height_px} pixels; {most}"
        raise InputError(str(file), problem, remedy="scale it down, or split the mesh and its texture")


def _png(data: bytes) -> SizePx:
    return struct.unpack_from(">II", data, 16)


def _jpeg(data: bytes) -> SizePx:
    """Walk the segments to the frame's start, which has bits (1), height (2) and width (2)."""
    stream = io.BytesIO(data)
    stream.seek(len(SIGNATURE))
    while True:
        marker, length = next_segment(stream)
        if marker in FRAMES:
            height_px, width_px = struct.unpack(">xHH", read_exactly(stream, 5))
            return width_px, height_px
        if marker in (START_OF_SCAN, END_OF_IMAGE):
            raise DamagedImageError("its size is missing")
        stream.seek(length, io.SEEK_CUR)


def _bmp(data: bytes) -> SizePx:
    if struct.unpack_from("<I", data, 14)[0] == 12:  # of OS/2
        return struct.unpack_from("<HH", data, 18)
    width_px, height_px = struct.unpack_from("<ii", data, 18)
    return abs(width_px), abs(height_px)


def _tiff(data: bytes) -> SizePx:
    """Return the largest size of all directories, whose rows are tag (2), type (2), count (4) and value (4)."""
    order: Literal["<", ">"] = "<" if data[:2] == b"II" else ">"
    if struct.unpack_from(f"{order}H", data, 2)[0] != 42:
        raise ValueError("is a BigTIFF, which is not read")
    sizes, seen = [(0, 0)], set[int]()
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    while at and at not in seen:
        seen.add(at)
        (count,) = struct.unpack_from(f"{order}H", data, at)
        sides = {256: 0, 257: 0}
        for row in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind = struct.unpack_from(f"{order}HH", data, row)
            if tag in sides:
                (sides[tag],) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", data, row + 8)
        sizes.append((sides[256], sides[257]))
        (at,) = struct.unpack_from(f"{order}I", data, at + 2 + 12 * count)
    return max(sizes, key=lambda each: (each[0] * each[1], max(each)))


def _webp(data: bytes) -> SizePx:
    match data[12:16]:
        case b"VP8 ":
            width_px, height_px = struct.unpack_from("<HH", data, 26)
            return width_px & 0x3FFF, height_px & 0x3FFF
        case b"VP8L":
            (bits,) = struct.unpack_from("<I", data, 21)
            return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
        case b"VP8X":
            sides = (int.from_bytes(data[start : start + 3], "little") + 1 for start in (24, 27))
            return next(sides), next(sides)
        case _:
            raise ValueError("is a WebP without a picture")


_READERS: tuple[tuple[Callable[[bytes], bool], Callable[[bytes], SizePx]], ...] = (
    (lambda data: data.startswith(b"\x89PNG\r\n\x1a\n"), _png),
    (lambda data: data.startswith(b"\xff\xd8\xff"), _jpeg),
    (lambda data: data.startswith(b"BM"), _bmp),
    (lambda data: data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    (lambda data: data[:4] == b"RIFF" and data[8:12] == b"WEBP", _webp),
)
