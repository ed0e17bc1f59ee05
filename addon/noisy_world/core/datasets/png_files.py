# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files by their parts (ISO/IEC 15948, 5.3): length (4), name (4), content, CRC-32 of name and content (4)."""

import zlib
from typing import BinaryIO

from .image_header import (
    UPRIGHT,
    DamagedImageError,
    ImageHeader,
    UnfitImageError,
    check_size,
    exif_orientation,
    read_exactly,
)

SIGNATURE = b"\x89PNG\r\n\x1a\n"

LARGEST_EXIF_BYTES = 2**16  # that are looked at; a JPEG cannot hold more

_GREY, _PALETTE = 0, 3
# By colour type (ISO/IEC 15948, table 11.1): channels without alpha, whether there is alpha, and possible bits.
_COLOUR_TYPES = {
    _GREY: (1, False, (1, 2, 4, 8, 16)),
    2: (3, False, (8, 16)),
    _PALETTE: (3, False, (1, 2, 4, 8)),
    4: (1, True, (8, 16)),
    6: (3, True, (8, 16)),
}
_CRITICAL = (b"IHDR", b"PLTE", b"IDAT", b"IEND")
_ANCILLARY = 0x20  # a small first letter: readers may pass the part over
_APART = "its parts do not follow one another"


def png_header(stream: BinaryIO) -> ImageHeader:
    """Return the header of a PNG, from the parts before its pixels. Raises UnfitImageError."""
    read_exactly(stream, len(SIGNATURE))
    length, name = _part(stream)
    if (length, name) != (13, b"IHDR"):
        raise DamagedImageError(_APART)
    content = read_exactly(stream, length)
    if zlib.crc32(name + content) != int.from_bytes(read_exactly(stream, 4), "big"):
        raise DamagedImageError(_wrong_checksum(name))
    width_px, height_px = (int.from_bytes(content[at : at + 4], "big") for at in (0, 4))
    bits, kind, *others = content[8:]
    channels, alpha, possible = _COLOUR_TYPES.get(kind, (0, False, ()))
    if bits not in possible or others[:2] != [0, 0] or others[2] > 1:
        raise DamagedImageError("its header is none of a PNG")
    check_size(width_px, height_px)
    orientation = UPRIGHT
    while name != b"IDAT":
        length, name = _part(stream)
        if name == b"eXIf":
            orientation = exif_orientation(read_exactly(stream, min(length, LARGEST_EXIF_BYTES)))
            stream.seek(length - min(length, LARGEST_EXIF_BYTES) + 4, 1)
        elif name != b"IDAT":
            alpha |= name == b"tRNS"
            stream.seek(length + 4, 1)
    return ImageHeader("png", width_px, height_px, channels, bits, alpha, kind == _PALETTE, orientation)


def whole_png(data: bytes, *, sums: bool = True) -> bytes:
    """Return what decides the pixels of a PNG: its file without comments, profiles, and what follows its end.

    sums: check the sum of each part. Raises DamagedImageError where a part is not in the file, has another sum, or
    stands in another place, and UnfitImageError for animations and for what readers do not know.
    """
    view = memoryview(data)
    kept, names = [view[: len(SIGNATURE)]], [b""]
    at = len(SIGNATURE)
    while at + 12 <= len(data):
        name, end = data[at + 4 : at + 8], at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            break
        if sums and zlib.crc32(view[at + 4 : end]) != int.from_bytes(view[end : end + 4], "big"):
            raise DamagedImageError(_wrong_checksum(name))
        _check_known(name)
        if (name == b"IHDR") != (len(names) == 1) or (name == b"IDAT" and b"IDAT" in names[:-1] and names[-1] != name):
            raise DamagedImageError(_APART)
        names.append(name)
        if name in (*_CRITICAL, b"tRNS"):
            kept.append(view[at : end + 4])
        at = end + 4
        if name == b"IEND":
            if b"IDAT" not in names:
                raise DamagedImageError("it holds no pixels")
            return data if sum(map(len, kept)) == len(data) else b"".join(kept)
    raise DamagedImageError("it is cut short")


def png_orientation(data: bytes) -> int:
    """Return the orientation of a whole PNG, whose Exif data may follow its pixels."""
    at = len(SIGNATURE)
    while (name := data[at + 4 : at + 8]) not in (b"IEND", b""):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if name == b"eXIf":
            return exif_orientation(data[at + 8 : end])
        at = end + 4
    return UPRIGHT


def _part(stream: BinaryIO) -> tuple[int, bytes]:
    start = read_exactly(stream, 8)
    return int.from_bytes(start[:4], "big"), start[4:]


def _check_known(name: bytes) -> None:
    if name == b"acTL":  # PNG, third edition, 11.3.6.1
        raise UnfitImageError("is an animation", "write its frames as images of their own")
    if name not in _CRITICAL and not name[0] & _ANCILLARY:
        raise UnfitImageError(f"holds a part {name.decode('latin-1')!a}, without which it cannot be read")


def _wrong_checksum(name: bytes) -> str:
    return f"the checksum of its part {name.decode('latin-1')!a} is wrong"
