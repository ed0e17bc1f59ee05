# SPDX-License-Identifier: GPL-3.0-or-later
"""Images that are neither PNG nor JPEG: arrays in NPY, NPZ or EXR, and what OpenCV alone reads (TIFF, BMP, WebP)."""

import io
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .image_header import DamagedImageError, ImageHeader, UnfitImageError, check_size
from .pixels import EXR_SIGNATURE, LARGEST_BYTES, decode_exr, exr_channels

NPY, NPZ = b"\x93NUMPY", b"PK\x03\x04"
_CONVERT = "convert it to PNG"


def array_header(data: bytes) -> ImageHeader:
    """Return what a file that is no PNG, JPEG or EXR says of itself. Raises UnfitImageError where it is no image."""
    if not data.startswith((NPY, NPZ)):
        pixels = _decoded(data)
        bits, floating = pixels.itemsize * 8, pixels.dtype.kind == "f"
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        alpha = channels in (2, 4)
        size_px = pixels.shape[1], pixels.shape[0]
        return ImageHeader("other", *size_px, 1 if channels <= 2 else 3, bits, alpha, floating=floating)
    shape, dtype = _shape_in(data)
    height_px, width_px = shape
    check_size(width_px, height_px)
    return ImageHeader("array", width_px, height_px, 1, dtype.itemsize * 8, floating=dtype.kind == "f")


def array_values(data: bytes) -> NDArray[Any]:
    """Return the values (H, W) of an array's file, as they are stored; of an EXR of R, G and B those of R.

    Raises UnfitImageError where it is none, or damaged.
    """
    try:
        if data.startswith(EXR_SIGNATURE):
            _, names = exr_channels(data)
            return decode_exr(data, names[-1:])  # R of R, G and B
        if data.startswith((NPY, NPZ)):
            shape, _ = _shape_in(data)
            return np.asarray(np.load(io.BytesIO(_npy_in(data)), allow_pickle=False)).reshape(shape)
    except (ValueError, OSError, EOFError) as error:
        if isinstance(error, UnfitImageError):
            raise
        raise DamagedImageError(str(error)) from None
    return _decoded(data)


def _decoded(data: bytes) -> NDArray[Any]:
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise UnfitImageError("is no image that can be read: PNG, JPEG, or another that OpenCV decodes", _CONVERT)
    check_size(pixels.shape[1], pixels.shape[0])
    return np.asarray(pixels)


def _npy_in(data: bytes) -> bytes:
    """Return the one array of an NPZ, as an NPY; an NPY as it is. Raises UnfitImageError."""
    if data.startswith(NPY):
        return data
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            parts = [part for part in file.infolist() if part.filename.endswith(".npy")]
            if len(parts) != 1 or len(file.infolist()) != 1:
                raise UnfitImageError(f"is an NPZ of {len(file.infolist())} parts", "write it with one array")
            if parts[0].file_size > LARGEST_BYTES:
                raise UnfitImageError("is an NPZ of a gigabyte and more")
            return file.read(parts[0])
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise DamagedImageError(str(error)) from None


def _shape_in(data: bytes) -> tuple[tuple[int, int], np.dtype[Any]]:
    """Return height and width, and the type, of the array in an NPY or NPZ."""
    stream = io.BytesIO(_npy_in(data))
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    except (ValueError, SyntaxError, EOFError) as error:
        raise DamagedImageError(str(error)[:80]) from None
    if dtype.kind not in "iuf":
        raise UnfitImageError(f"is an array of {dtype}, but an image holds numbers", "write it as float32")
    plain = tuple(side for side in shape if side != 1) if len(shape) == 3 and 1 in (shape[0], shape[2]) else shape
    if len(plain) != 2:
        raise UnfitImageError(f"is an array of the shape {shape}, but an image has height and width")
    return (plain[0], plain[1]), dtype
