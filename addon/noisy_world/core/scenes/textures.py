# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of textures: where they lie, and reading them."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..regular_files import read_bytes
from .beside import is_file, place_inside
from .picture_size import KINDS, check_size_px, header_size_px


@dataclass(frozen=True)
class TextureFile:
    """A texture's file. name: as the mesh gives it. path: where it lies, or should. moved: not where the name leads."""

    name: str
    path: Path
    moved: bool

    @property
    def found(self) -> bool:
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
