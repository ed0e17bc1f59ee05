# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of textures: where they lie, their size by the header, and reading them."""

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..images.image_header import (
    END_OF_IMAGE,
    FRAMES,
    JPEG_SIGNATURE,
    START_OF_SCAN,
    DamagedImageError,
    next_segment,
    read_exactly,
)
from .mesh_formats import is_file, place_inside

# The size of an image in pixels by its file's header, before memory is taken for it.


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
    stream.seek(len(JPEG_SIGNATURE))
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


@dataclass(frozen=True)
class TextureFile:
    """A texture's file. name: as the mesh gives it. path: where it lies, or should. moved: not where the name leads."""

    name: str
    path: Path
    moved: bool

    @property
    def exists(self) -> bool:
        """Whether there is such a file."""
        return is_file(self.path)


def locate_texture(mesh_path: Path, name: str) -> TextureFile:
    """Return where the texture of a mesh lies: inside the mesh's folder, whatever the name says.

    Names with the folders of another machine, or that lead out of the mesh's folder, are looked for beside the mesh.
    """
    posix = PurePosixPath(name.replace("\\", "/"))
    beside = mesh_path.parent / (posix.name or name)
    inside = place_inside(mesh_path.parent, name)
    if inside is None or (len(posix.parts) > 1 and not is_file(inside) and is_file(beside)):
        return TextureFile(name, beside, moved=True)
    return TextureFile(name, inside, moved=False)


def check_picture(file: object, data: bytes) -> None:
    """Raise InputError for what is none of the kinds of pictures that are read, or larger than they may be.

    file: for messages. data: from its beginning, at least as far as the header.
    """
    try:
        size_px = header_size_px(data)
    except ValueError as error:
        raise InputError(str(file), f"cannot be decoded: {error}", remedy=_REMEDY) from error
    if size_px is None:
        raise InputError(str(file), f"is no image of a kind that is read: {KINDS}", remedy=_REMEDY)
    check_size_px(file, size_px)


def read_picture(path: Path) -> tuple[NDArray[np.uint8], bool]:
    """Return an image as (H, W, 3) uint8 RGB, and whether it is transparent anywhere, which is not kept.

    An orientation that a camera wrote beside the pixels is not applied: texture coordinates know nothing of it.
    Raises InputError where the file cannot be read, is damaged or is no image.
    """
    import cv2

    try:
        data = read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    check_picture(path, data)
    if _is_cut_short(data):
        raise InputError(path, "cut short: the image has no end", remedy="export it again")
    try:
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error as error:
        raise InputError(path, f"cannot be decoded: {error.err or error.msg}"[:200], remedy=_REMEDY) from error
    if decoded is None or decoded.dtype not in (np.uint8, np.uint16):
        raise InputError(path, "is no image of 8 or 16 bits a channel", remedy=_REMEDY)
    whole = decoded if decoded.dtype == np.uint8 else decoded // 257 + (decoded % 257 > 128)  # 65535 = 257 x 255
    pixels = whole.astype(np.uint8, copy=False)
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    transparent = pixels.shape[2] in (2, 4) and bool((pixels[..., -1] < 255).any())
    bgr = pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1].repeat(3, axis=2)
    return np.ascontiguousarray(bgr[..., ::-1]), transparent


_REMEDY = "save it as PNG or JPEG"


def _is_cut_short(data: bytes) -> bool:
    """Tell whether a PNG or JPEG lacks its end: OpenCV fills in what is missing without a word."""
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data[-64:] and b"IEND" not in data
    # Within a scan 0xff is followed by 0, so the last start of a scan and the end of the image are told for sure.
    return data.startswith(b"\xff\xd8") and data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
