# SPDX-License-Identifier: GPL-3.0-or-later
"""What an image's file says before anything is decoded: headers, and the segments of a JPEG."""

import struct
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

# Chosen: twice the pixels of 8K video. In float a colour image of as many is 0.8 GB, and a run holds some of them.
LARGEST_PIXELS = 2**26
LARGEST_SIDE_PX = 2**15 - 1  # SHRT_MAX, up to which OpenCV's remap takes images

UPRIGHT = 1  # of Exif's orientation: the first row is the top, the first column the left
_ORIENTATION_TAG, _SHORT = 0x0112, 3  # Exif 2.32, table 4; type 3 is an unsigned number of 16 bits


class UnfitImageError(ValueError):
    """An image that cannot be used as it is meant: what it is, as a sentence's end, and the remedy."""

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(problem)


class DamagedImageError(UnfitImageError):
    """The file of an image that is not whole. what: shows it."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(f"is damaged: {what}", "copy it again")


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What an image's file says of itself.

    channels: 1 grey, 3 colour, 4 CMYK; without alpha, those of the palette's colours where it has one. bits: of a
    value. alpha: whether pixels may be transparent. orientation: Exif's, 1 to 8. sequential: of a JPEG, that it holds
    one scan of all channels. sampling: of a JPEG, the horizontal and vertical factors of each channel. floating:
    whether values are floating point. kind: "exr", an EXR of R, G and B, is light as colour; "array" is one channel in
    an EXR of others, an NPY or an NPZ; "other" is what OpenCV alone reads: TIFF, BMP, WebP and more.
    """

    kind: Literal["png", "jpg", "exr", "array", "other"]
    width_px: int
    height_px: int
    channels: int
    bits: int
    alpha: bool = False
    palette: bool = False
    orientation: int = UPRIGHT
    sequential: bool = True
    sampling: tuple[tuple[int, int], ...] = ()
    floating: bool = False

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width_px, self.height_px

    @property
    def description(self) -> str:
        """What it is, in words."""
        colours = {1: "grey", 3: "colour", 4: "CMYK"}[self.channels]
        if self.kind == "exr":
            return "an EXR of scene-linear light"
        if self.kind == "array":
            return f"an array of {self.bits}-bit {'floating point' if self.floating else 'whole numbers'}"
        name = {"jpg": "a JPEG", "png": "a PNG"}.get(self.kind, "an image")
        floating = " floating point," if self.floating else ""
        return f"{name} of {self.bits}-bit{floating} {colours}{' with alpha' if self.alpha else ''}"

    @property
    def plainly(self) -> Literal["rgb", "grey"] | None:
        """What its bytes are, where every reader sees the same: 8-bit RGB or 8-bit grey; None for all else."""
        if self.bits != 8 or self.alpha or self.palette or self.channels == 4:
            return None
        return "grey" if self.channels == 1 else "rgb"


def check_size(width_px: int, height_px: int) -> None:
    """Raise UnfitImageError for a size that no image has, and for one beyond the limits."""
    if not width_px or not height_px:
        raise DamagedImageError(f"it says {width_px} x {height_px} pixels")
    if width_px * height_px > LARGEST_PIXELS or max(width_px, height_px) > LARGEST_SIDE_PX:
        most = f"at most {LARGEST_PIXELS} pixels are read, and {LARGEST_SIDE_PX} a side"
        raise UnfitImageError(f"says that it is {width_px} x {height_px} pixels; {most}")


def exif_orientation(tiff: bytes) -> int:
    """Return the orientation in Exif data, 1 to 8; 1 where none is said.

    The data are a TIFF: byte order (2), 42 (2), where the first directory is (4); it has a count (2), and for each
    entry tag (2), type (2), count (4) and value (4). Data that are no such thing say nothing, as for all viewers.
    """
    order: Literal["little", "big"] = "little" if tiff[:2] == b"II" else "big"
    if tiff[:2] not in (b"II", b"MM") or len(tiff) < 8:
        return UPRIGHT
    at = int.from_bytes(tiff[4:8], order)
    for entry in range(int.from_bytes(tiff[at : at + 2], order)):
        start = at + 2 + 12 * entry
        row = tiff[start : start + 12]
        if len(row) < 12:
            return UPRIGHT
        if int.from_bytes(row[:2], order) == _ORIENTATION_TAG and int.from_bytes(row[2:4], order) == _SHORT:
            value = int.from_bytes(row[8:10], order)
            return value if 1 <= value <= 8 else UPRIGHT
    return UPRIGHT


def read_exactly(stream: BinaryIO, count: int) -> bytes:
    """Return bytes of a stream. Raises DamagedImageError where it ends before."""
    data = stream.read(count)
    if len(data) < count:
        raise DamagedImageError("it is cut short")
    return data


# PNG files by their parts (ISO/IEC 15948, 5.3): length (4), name (4), content, CRC-32 of name and content (4).


PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

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
_DECIDING = (b"IDAT", *_CRITICAL, b"tRNS")
_START, _SUM = struct.Struct(">I4s"), struct.Struct(">I")
_ANCILLARY = 0x20  # a small first letter: readers may pass the part over
_APART = "its parts do not follow one another"


def png_header(stream: BinaryIO) -> ImageHeader:
    """Return the header of a PNG, from the parts before its pixels. Raises UnfitImageError."""
    read_exactly(stream, len(PNG_SIGNATURE))
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
    names: list[bytes] = []  # without repetitions: OpenCV writes pixels in parts of 8 kB, a hundred a file
    dropped: list[tuple[int, int]] = []
    at = len(PNG_SIGNATURE)
    while at + 12 <= len(data):
        length, name = _START.unpack_from(data, at)
        end = at + 12 + length
        if end > len(data):
            break
        if sums and zlib.crc32(view[at + 4 : end - 4]) != _SUM.unpack_from(data, end - 4)[0]:
            raise DamagedImageError(_wrong_checksum(name))
        if not names or name != names[-1]:
            _check_place(name, names)
            names.append(name)
        if name not in _DECIDING:
            dropped.append((at, end))
        at = end
        if name == b"IEND":
            return data if not dropped and end == len(data) else _without(view[:end], dropped)
    raise DamagedImageError("it is cut short")


def _check_place(name: bytes, before: list[bytes]) -> None:
    """Raise UnfitImageError where a part cannot stand behind others, or is none that can be read."""
    if name == b"acTL":  # PNG, third edition, 11.3.6.1
        raise UnfitImageError("is an animation", "write its frames as images of their own")
    if name not in _CRITICAL and not name[0] & _ANCILLARY:
        raise UnfitImageError(f"holds a part {name.decode('latin-1')!a}, without which it cannot be read")
    if (name == b"IHDR") != (not before) or (name == b"IDAT" and name in before):
        raise DamagedImageError(_APART)
    if name == b"IEND" and b"IDAT" not in before:
        raise DamagedImageError("it holds no pixels")


def _without(view: memoryview, dropped: list[tuple[int, int]]) -> bytes:
    """Return data without some of their parts, each from a place to another, in order."""
    starts, ends = [0, *(end for _, end in dropped)], [*(start for start, _ in dropped), len(view)]
    return b"".join(view[start:end] for start, end in zip(starts, ends, strict=True))


def png_orientation(data: bytes) -> int:
    """Return the orientation of a whole PNG, whose Exif data may follow its pixels."""
    at = len(PNG_SIGNATURE)
    while (name := data[at + 4 : at + 8]) not in (b"IEND", b""):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if name == b"eXIf":
            return exif_orientation(data[at + 8 : end])
        at = end + 4
    return UPRIGHT


def _part(stream: BinaryIO) -> tuple[int, bytes]:
    start = read_exactly(stream, 8)
    return int.from_bytes(start[:4], "big"), start[4:]


def _wrong_checksum(name: bytes) -> str:
    return f"the checksum of its part {name.decode('latin-1')!a} is wrong"


# JPEG files by their segments (ITU-T T.81, B.1): marker (2), length with itself (2), content; and what they hold.
#
# libjpeg fills in what is damaged inside a scan, and only warns; simplejpeg, which is libjpeg too, refuses it then.


JPEG_SIGNATURE = b"\xff\xd8"
START_OF_SCAN, END_OF_IMAGE, _APP1 = 0xDA, 0xD9, 0xE1
RESTARTS = range(0xD0, 0xD8)
FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # less Huffman tables, reserved, arithmetic conditioning
_PROGRESSIVE = 0xC2
_EXIF = b"Exif\0\0"
# Chosen: libjpeg's own progressive files have 10, and each takes as long as the size in the header asks for.
MOST_SCANS = 100
# That the strict decoder knows; with these it gives OpenCV's pixels. By channel, horizontally and vertically.
_STRICT_SAMPLINGS = {((1, 1),)} | {(luma, (1, 1), (1, 1)) for luma in ((1, 1), (2, 1), (1, 2), (2, 2), (4, 1), (1, 4))}


def jpeg_header(stream: BinaryIO) -> ImageHeader:
    """Return the header of a JPEG, from the segments before its first scan. Raises UnfitImageError."""
    read_exactly(stream, len(JPEG_SIGNATURE))
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
