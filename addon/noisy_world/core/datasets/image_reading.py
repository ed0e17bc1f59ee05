# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading the pixels of image files; damage that can be detected is refused."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..regular_files import read_bytes
from .float_files import decode_light
from .image_files import LARGEST_FILE_BYTES, read_whole
from .image_header import DamagedImageError, ImageHeader, UnfitImageError
from .images import UINT16_MAX, decode_png
from .jpeg_files import decode_strictly

_ONE_SIZE = "a sequence has one size"


# --- files ---


def read_colour(
    path: Path, size_px: tuple[int, int], sha256: str | None = None
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return the colour (H, W, 3) of a file, RGB, sRGB-encoded: uint8, or float32 in [0, 1] where it has 16 bits.

    Grey is in three equal channels. sha256: of the file when it was written, if that is known. Raises InputError where
    the file is damaged, of another size, or no colour image.
    """
    header, data = read_whole(path, sha256)
    check_colour(path, header)
    check_size_px(path, header, size_px)
    try:
        return decoded_colour(header, data)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


def read_light(path: Path, size_px: tuple[int, int], sha256: str | None = None) -> NDArray[np.float32]:
    """Return the scene-linear light (H, W, 3) of an EXR of a dataset. Raises InputError where it is damaged."""
    header, data = read_whole(path, sha256)
    check_size_px(path, header, size_px)
    try:
        return decode_light(data)
    except ValueError as error:
        raise InputError(path, str(error)) from error


def read_steps(path: Path, size_px: tuple[int, int], sha256: str | None = None) -> NDArray[np.uint16]:
    """Return the steps (H, W) of a depth image. Raises InputError where it is damaged, or no 16-bit PNG of the size."""
    header, data = read_whole(path, sha256)
    check_depth(path, header)
    check_size_px(path, header, size_px)
    try:
        pixels = decode_png(data)
        return np.asarray(_decoded(data, _unchanged(), header, np.uint16) if pixels is None else pixels, np.uint16)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


def read_pixels(path: Path, mode: int) -> NDArray[Any] | None:
    """Return the pixels of a file that this program wrote, as OpenCV decodes them; None where it is no image.

    mode: one of cv2.IMREAD_*. Raises OSError where the file cannot be read.
    """
    import cv2

    data = read_bytes(path, largest_bytes=LARGEST_FILE_BYTES)
    return cv2.imdecode(np.frombuffer(data, np.uint8), mode) if data else None


# --- what headers say ---


def check_colour(path: Path, header: ImageHeader) -> None:
    """Raise InputError where an image is no colour as it is meant here."""
    if header.kind == "exr":
        problem = f"is {header.description}, but colour has to be as it is shown on a display"
        raise InputError(path, problem, remedy="make the dataset with output.image: png, or convert it to PNG")
    if header.channels == 1 and header.bits == 16:
        problem = f"is {header.description}, as depth and thermal images are, but colour has to be 8-bit grey, or RGB"
        raise InputError(path, problem, remedy="write it with 8 bits, as it is to be seen")


def check_depth(path: Path, header: ImageHeader) -> None:
    """Raise InputError where an image is no 16-bit grey PNG."""
    if (header.kind, header.bits, header.channels, header.alpha) != ("png", 16, 1, False):
        raise InputError(path, f"is {header.description}, but depth has to be a PNG of 16-bit grey")


def check_size_px(path: Path, header: ImageHeader, wanted: tuple[int, int], own: bool = False) -> None:
    """Raise InputError where an image has another size than the first colour image of its sequence.

    own: it is depth of a camera of its own, which has that size.
    """
    if header.size_px != wanted:
        whose = "its camera has" if own else "the first colour image is"
        depth = (header.bits, header.channels) == (16, 1)
        remedy = "take the images that belong to it" if own else _ONE_SIZE + "; register depth to colour" * depth
        raise InputError(path, f"is {spoken(header.size_px)} pixels, but {whose} {spoken(wanted)}", remedy=remedy)


def spoken(size_px: tuple[int, int]) -> str:
    """Return a size in words."""
    return f"{size_px[0]} x {size_px[1]}"


# --- pixels ---


def decoded_colour(header: ImageHeader, data: bytes) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return the colour (H, W, 3) of a whole image, as `read_colour`. data: what of the file decides its pixels.

    Raises DamagedImageError, and UnfitImageError for pixels that are transparent.
    """
    import cv2

    if header.kind == "jpg" and (pixels := decode_strictly(header, data)) is not None:
        return pixels
    if header.kind == "png" and (header.bits, header.channels) == (8, 3) and (made := decode_png(data)) is not None:
        return np.asarray(made, np.uint8)
    if header.bits <= 8 and not header.alpha:
        plain = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        return np.asarray(_decoded(data, plain, header, np.uint8), np.uint8)
    dtype = np.uint16 if header.bits == 16 else np.uint8
    pixels = _decoded(data, _unchanged(), header, dtype)
    # OpenCV leaves a grey that is transparent out, where that is one value and no channel.
    if header.alpha and (pixels.ndim == 2 or pixels.shape[2] < 4 or pixels[..., 3].min() < np.iinfo(dtype).max):
        raise UnfitImageError("has transparent pixels, of which nothing says the colour", "lay it over a background")
    rgb = np.ascontiguousarray(pixels[..., 2::-1])
    return rgb if dtype == np.uint8 else np.divide(rgb, np.float32(UINT16_MAX), dtype=np.float32)


def _unchanged() -> int:
    import cv2

    return cv2.IMREAD_UNCHANGED


def _decoded(data: bytes, mode: int, header: ImageHeader, dtype: type) -> NDArray[Any]:
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise DamagedImageError("it cannot be decoded")
    expected = (header.height_px, header.width_px)
    if pixels.dtype != dtype or pixels.shape[:2] != expected:
        raise DamagedImageError(f"it says {header.description} of {spoken(header.size_px)}, and holds {pixels.shape}")
    return pixels
