# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEG files by their segments (ITU-T T.81, B.1): marker (2), length with itself (2), content; and what they hold.

libjpeg fills in what is damaged inside a scan, and only warns; simplejpeg, which is libjpeg too, refuses it then.
"""

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .image_header import (
    UPRIGHT,
    DamagedImageError,
    ImageHeader,
    UnfitImageError,
    check_size,
    exif_orientation,
    read_exactly,
)

SIGNATURE = b"\xff\xd8"
START_OF_SCAN, END_OF_IMAGE, _APP1 = 0xDA, 0xD9, 0xE1
RESTARTS = range(0xD0, 0xD8)
FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # less Huffman tables, reserved, arithmetic conditioning
_PROGRESSIVE = 0xC2
_EXIF = b"Exif\0\0"
_APART = "its parts do not follow one another"
# Chosen: libjpeg's own progressive files have 10, and each takes as long as the size in the header asks for.
MOST_SCANS = 100
# That the strict decoder knows; with these it gives OpenCV's pixels. By channel, horizontally and vertically.
_STRICT_SAMPLINGS = {((1, 1),)} | {(luma, (1, 1), (1, 1)) for luma in ((1, 1), (2, 1), (1, 2), (2, 2), (4, 1), (1, 4))}


def jpeg_header(stream: BinaryIO) -> ImageHeader:
    """Return the header of a JPEG, from the segments before its first scan. Raises UnfitImageError."""
    read_exactly(stream, len(SIGNATURE))
    frame: tuple[int, bytes] | None = None
    orientation = UPRIGHT
    while True:
        marker, length = next_segment(stream)
        if marker == START_OF_SCAN:
            break
        if marker == END_OF_IMAGE:
            raise DamagedImageError(_APART)
        if marker == _APP1:
            content = read_exactly(stream, length)
            if content.startswith(_EXIF):
                orientation = exif_orientation(content[len(_EXIF) :])
        elif marker in FRAMES:
            if frame is not None:
                raise DamagedImageError(_APART)
            frame = marker, read_exactly(stream, length)
        else:
            stream.seek(length, 1)
    scanned = read_exactly(stream, length)
    if frame is None or not scanned:
        raise DamagedImageError(_APART)
    return _header(*frame, orientation, scanned[0])


def next_segment(stream: BinaryIO) -> tuple[int, int]:
    """Return the marker of the next segment and the length of its content, where the stream then is.

    The end of the image has no content. Raises DamagedImageError where no segment follows.
    """
    start = read_exactly(stream, 2)
    while start == b"\xff\xff":  # fill bytes may stand before a marker
        start = b"\xff" + read_exactly(stream, 1)
    marker = start[1]
    if start[0] != 0xFF or not marker or marker in RESTARTS:
        raise DamagedImageError(_APART)
    if marker == END_OF_IMAGE:
        return marker, 0
    length = int.from_bytes(read_exactly(stream, 2), "big")
    if length < 2:
        raise DamagedImageError(_APART)
    return marker, length - 2


def _header(marker: int, content: bytes, orientation: int, scanned: int) -> ImageHeader:
    """Read a frame's start: bits (1), height (2), width (2), channels (1), for each its name, factors and table (3).

    scanned: the channels of the first scan.
    """
    if len(content) < 6 or len(content) != 6 + 3 * content[5]:
        raise DamagedImageError(_APART)
    bits, channels = content[0], content[5]
    height_px, width_px = (int.from_bytes(content[start : start + 2], "big") for start in (1, 3))
    if channels not in (1, 3, 4):
        raise UnfitImageError(f"is a JPEG of {channels} channels", "convert it to RGB")
    check_size(width_px, height_px)
    return ImageHeader(
        "jpg",
        width_px,
        height_px,
        channels,
        bits,
        orientation=orientation,
        sequential=marker != _PROGRESSIVE and scanned == channels,
        sampling=tuple((content[row + 1] >> 4, content[row + 1] & 15) for row in range(6, len(content), 3)),
    )


# --- whole files ---


def check_ends(data: bytes) -> None:
    """Raise DamagedImageError where a JPEG has no end, UnfitImageError where it has more scans than encoders write."""
    scan = bytes([0xFF, START_OF_SCAN])
    if data.find(bytes([0xFF, END_OF_IMAGE]), data.find(scan)) < 0:
        raise DamagedImageError("it is cut short")
    if data.count(scan) > MOST_SCANS:  # in a scan 0xFF is followed by 0
        raise UnfitImageError(f"has more than {MOST_SCANS} scans", "write it again with fewer")


def check_scans(header: ImageHeader, data: bytes) -> None:
    """Raise DamagedImageError where the decoder meets damage, decoding to an eighth of the size.

    That takes two thirds of the time and sees the same. What has factors of sampling that it does not know is taken.
    """
    if header.sampling in _STRICT_SAMPLINGS:
        _strictly(data, colorspace="GRAY", min_factor=8, min_width=1, min_height=1)


def decode_strictly(header: ImageHeader, data: bytes) -> NDArray[np.uint8] | None:
    """Return the pixels (H, W, 3) of a JPEG, RGB, as OpenCV has them; None where its sampling is not known.

    Raises DamagedImageError where the decoder meets damage.
    """
    return _strictly(data, colorspace="RGB") if header.sampling in _STRICT_SAMPLINGS else None


def _strictly(data: bytes, **options: Any) -> NDArray[np.uint8]:
    import simplejpeg

    try:
        return simplejpeg.decode_jpeg(data, strict=True, **options)
    except ValueError as error:
        raise DamagedImageError(f"its decoder says {str(error)!r}") from None
