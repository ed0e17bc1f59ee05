# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour and depth as the bytes of image files."""

import io
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.depth_range import UINT16_MAX, OutOfRange
from ..core.errors import NoisyWorldError
from .image_header import PNG_SIGNATURE

Number = TypeVar("Number", bound=np.generic)

# Chosen: storing must add no visible perturbation. With 4:4:4 a clean frame of 1200 x 680 has 0.36 MiB, a noisy one
# 2.1; OpenCV's default chroma subsampling takes a noisy frame from 43 to 18 dB.
JPEG_QUALITY = 98
PNG_LEVEL = (
    1  # of libdeflate: a tenth smaller than zlib's first level in half its time; the same bytes on every processor
)
ROWS = 32  # of a band; chosen: a band of 1200 pixels is half a megabyte
# Chosen: between images with noise of each pixel's own (23 and more of 255) and snow before a camera (20). A JPEG of
# the former is 12 to 23 % smaller with Huffman tables of its own, one of others 2 to 7 %, in 3 times the time.
NOISY = 22
NOISY_ROWS = 16  # one row of so many tells
_NONE, _UP = 0, 2  # filters of PNG (ISO/IEC 15948, 9.2)
_GREY, _COLOUR = 0, 2  # its colour types (11.2.2)
_HEADER_END = 33
LARGEST_BYTES = 2**30  # of pixels that are decoded here; the largest images that are taken have half of it
GREY_WEIGHTS_PER_MILLE = (299, 587, 114)  # of R, G and B: ITU-R BT.601


def rgb_bytes(rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Round display-encoded colours (H, W, 3) float to the nearest byte; values outside [0, 1] are clipped.

    In bands of rows, whose clipped values stay in the processor's cache: a third of the time.
    """
    import cv2

    flat = rgb.reshape(rgb.shape[0], -1)  # without channels, as OpenCV applies a scalar to the first channel only
    rounded = np.empty(flat.shape, np.uint8)
    clipped = np.empty((min(ROWS, len(flat)), flat.shape[1]), np.float32)
    for top in range(0, len(flat), ROWS):
        band = flat[top : top + ROWS]
        inside = np.clip(band, 0.0, 1.0, out=clipped[: len(band)])
        cv2.convertScaleAbs(inside, rounded[top : top + ROWS], alpha=255)
    return rounded.reshape(rgb.shape)


def as_float(rgb: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float32]:
    """Return display-encoded colours, bytes or float in [0, 1], as float; what is float already is not copied."""
    if rgb.dtype == np.uint8:
        return np.divide(rgb, np.float32(255), dtype=np.float32)
    return rgb.astype(np.float32, copy=False)


def read_only(image: NDArray[Number]) -> NDArray[Number]:
    """Return an array that shares its values, and cannot be written into."""
    view = image.view()
    view.setflags(write=False)
    return view


def as_bytes(rgb: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return display-encoded colours, bytes or float in [0, 1], as bytes; what is bytes already is not copied."""
    return rgb.astype(np.uint8, copy=False) if rgb.dtype == np.uint8 else rgb_bytes(as_float(rgb))


def grey_bytes(rgb: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    """Turn display-encoded colours (H, W, 3), uint8 or float in [0, 1], into grey (H, W) by the weights of BT.601.

    OpenCV's own conversion has the same weights. Values outside [0, 1] are clipped, and the result is rounded once,
    half a byte up.
    """
    red, green, blue = GREY_WEIGHTS_PER_MILLE
    if rgb.dtype == np.uint8:  # in whole numbers, so that ties are exact
        whole = rgb.astype(np.uint32)
        weighted = whole[..., 0] * red + whole[..., 1] * green + whole[..., 2] * blue
        return np.asarray((weighted + 500) // 1000, dtype=np.uint8)
    clipped = np.clip(rgb, 0.0, 1.0, dtype=np.float32)
    red, green, blue = (np.float32(weight / 1000 * 255) for weight in GREY_WEIGHTS_PER_MILLE)
    weighted = clipped[..., 0] * red + clipped[..., 1] * green + clipped[..., 2] * blue
    return np.asarray(weighted + np.float32(0.5), dtype=np.uint8)


def encode_colour(pixels: NDArray[np.uint8], image: Literal["jpg", "png"], *, fit_tables: bool = True) -> bytes:
    """Encode (H, W, 3) uint8 RGB, or (H, W) grey as one channel.

    JPEG has quality 98 and 4:4:4, so that storing adds nothing visible, and Huffman tables of its own where an image is
    noisy. PNG is lossless. fit_tables: False for bytes that are decoded at once: pixels do not depend on these tables.
    """
    if image == "png":
        return encode_png(pixels)
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    options += [cv2.IMWRITE_JPEG_OPTIMIZE, int(fit_tables and _is_noisy(pixels))]
    swapped = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.ndim == 3 else np.ascontiguousarray(pixels)
    done, data = cv2.imencode(".jpg", swapped, options)
    if not done:
        raise MemoryError(f"OpenCV could not encode {pixels.shape} {pixels.dtype} as .jpg")
    return data.tobytes()


def _is_noisy(pixels: NDArray[np.uint8]) -> bool:
    """Tell whether neighbours in a row differ as noise does, by the mean of their second differences."""
    rows = pixels[::NOISY_ROWS].astype(np.int16)
    bends = np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2])
    return int(bends.sum(dtype=np.int64)) > NOISY * bends.size


def quantise_depth(
    depth_m: NDArray[np.float32], scale_per_m: float, beyond: Literal["void", "farthest"] = "void"
) -> NDArray[np.uint16]:
    """Turn planar depth (H, W) in metres into uint16 steps of 1 / scale_per_m; 0 = void.

    beyond: what depth becomes that 16 bits cannot hold, infinity included: void, or the farthest step. Negative values
    and NaN become void; nothing wraps around. In bands of rows, which stay in the processor's cache.
    """
    quantised = np.empty(depth_m.shape, np.uint16)
    for top in range(0, len(depth_m), ROWS):
        steps = depth_steps(depth_m[top : top + ROWS], scale_per_m)
        fits = (steps >= 0) & (steps <= UINT16_MAX)  # False for NaN
        if not fits.all():
            lost = np.where(steps > UINT16_MAX, UINT16_MAX if beyond == "farthest" else 0, 0)
            steps = np.where(fits, steps, lost)
        quantised[top : top + ROWS] = steps
    return quantised


def depth_steps(depth_m: NDArray[np.float32], scale_per_m: float) -> NDArray[np.float64]:
    """Return depth in metres in whole steps of 1 / scale_per_m, however many they are."""
    # In float64: float32 is up to 0.004 of a step off near the far end, and then rounds wrongly now and then.
    return np.rint(depth_m.astype(np.float64) * scale_per_m)


def out_of_range(depth_m: NDArray[np.float32], scale_per_m: float) -> OutOfRange | None:
    """Count the pixels of planar depth (H, W) in metres that the encoder cannot hold; None where it holds all.

    scale_per_m: steps per metre. These are exactly the pixels that `quantise_depth` does not keep for being too
    far; void, negative values and NaN are no depth.
    """
    limit_m = UINT16_MAX / scale_per_m
    # Most images hold nothing that far: their maximum is known in a twentieth of the time. NaN goes on.
    if depth_m.size == 0 or float(depth_m.max()) <= limit_m:
        return None
    far_m = depth_m[depth_m > limit_m]
    lost_m = far_m[depth_steps(far_m, scale_per_m) > UINT16_MAX]
    if not lost_m.size:
        return None
    finite_m = lost_m[np.isfinite(lost_m)]
    farthest_m = float(finite_m.max()) if finite_m.size else None
    return OutOfRange(lost_m.size, int(np.count_nonzero(depth_m > 0)), farthest_m, lost_m.size - finite_m.size)


def encode_png(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Encode (H, W), or (H, W, 3) as R, G, B, uint8 or uint16, as PNG (ISO/IEC 15948).

    Each row is filtered by the row above it (Up), which takes no time; Paeth's filter saves 4 % of the bytes of clean
    depth and takes longer than all the rest.
    """
    import deflate

    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    header = struct.pack(">2I5B", width, height, 8 * pixels.itemsize, _COLOUR if pixels.ndim == 3 else _GREY, 0, 0, 0)
    return b"".join(
        (
            PNG_SIGNATURE,
            _part(b"IHDR", header),
            _part(b"IDAT", deflate.zlib_compress(filtered, PNG_LEVEL)),
            _part(b"IEND"),
        )
    )


def _part(name: bytes, content: bytes | bytearray = b"") -> bytes:
    """Return a part of a PNG: its length, name, content and checksum."""
    import deflate

    checksum = deflate.crc32(content, deflate.crc32(name))
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", checksum)


def decode_png(data: bytes) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
    """Return the pixels of a whole PNG as `encode_png` takes them, in less than half of OpenCV's time.

    None for what it does not write, which OpenCV decodes: interlaced, with a palette, alpha or fewer bits, or with rows
    that are filtered otherwise than by the row above. data: without parts that do not decide its pixels.
    """
    import deflate

    if len(data) < _HEADER_END:
        return None
    width, height, bits, kind, *_, interlaced = struct.unpack_from(">2I5B", data, len(PNG_SIGNATURE) + 8)
    channels = 3 if kind == _COLOUR else 1
    line = 1 + width * channels * bits // 8
    if bits not in (8, 16) or kind not in (_GREY, _COLOUR) or interlaced or height * line > LARGEST_BYTES:
        return None
    parts = []
    at = len(PNG_SIGNATURE)
    while (name := data[at + 4 : at + 8]) != b"IEND":
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if name == b"IDAT":
            parts.append(data[at + 8 : end])
        elif name != b"IHDR":  # another part, or none, as the data are cut short
            return None
        at = end + 4
    try:
        inflated = deflate.zlib_decompress(b"".join(parts), height * line)
        filtered = np.frombuffer(inflated, np.uint8).reshape(height, line)
    except (deflate.DeflateError, ValueError):
        return None  # OpenCV says what is wrong
    filters = filtered[:, 0]
    if not np.isin(filters, (_NONE, _UP)).all():
        return None
    rows = filtered[:, 1:].copy()
    for row in np.flatnonzero(filters[1:] == _UP) + 1:  # one by one, which takes a sixth of `np.add.accumulate`'s time
        rows[row] += rows[row - 1]
    pixels = rows if bits == 8 else rows.view(">u2").astype(np.uint16)
    return pixels.reshape((height, width, channels) if channels > 1 else (height, width))


def decode_steps(data: bytes) -> NDArray[np.uint16]:
    """Return the 16-bit values that `encode_png` encoded. Raises ValueError where it is something else."""
    import cv2

    steps = decode_png(data) if data.startswith(PNG_SIGNATURE) else None
    if steps is None and data:
        steps = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        steps = steps[..., ::-1] if steps is not None and steps.ndim == 3 else steps
    if steps is None or steps.dtype != np.uint16:
        raise ValueError("is no PNG of 16 bits")
    return np.asarray(steps, np.uint16)


# Images whose values are kept as they are in memory, without loss: EXR and NPY; and light as half floats.


def encode_exr(pixels: NDArray[np.float32], parts: Sequence[str], dtype: type[np.floating[Any]] = np.float32) -> bytes:
    """Encode (H, W), or (H, W, components), as an EXR of a channel for each component, zipped. parts: their names."""
    import OpenEXR

    planes = np.moveaxis(np.atleast_3d(pixels).astype(dtype, copy=False), -1, 0)
    channels = {name: np.ascontiguousarray(plane) for name, plane in zip(parts, planes, strict=True)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    data = io.BytesIO()
    OpenEXR.File(header, channels, num_threads=0).write(data)
    return data.getvalue()


def encode_layers(channels: Mapping[str, NDArray[np.float32]], attributes: Mapping[str, str]) -> bytes:
    """Encode channels (H, W) by their names as one EXR of floats, zipped. attributes: texts of its header."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    data = io.BytesIO()
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    OpenEXR.File(header, planes, num_threads=0).write(data)
    return data.getvalue()


def decode_exr(data: bytes, parts: Sequence[str]) -> NDArray[np.float32]:
    """Return what `encode_exr` encoded. Raises ValueError where it is something else, or damaged."""
    import OpenEXR

    stream = io.BytesIO(data)
    try:
        with OpenEXR.File(stream, separate_channels=True, num_threads=0) as file:
            planes = [file.channels()[name].pixels for name in parts]
    except (RuntimeError, KeyError) as error:  # so OpenEXR says what is damaged; ValueError too
        raise ValueError("is no whole EXR of its channel") from error
    return np.asarray(planes[0] if len(parts) == 1 else np.stack(planes, axis=-1), np.float32)


EXR_SIGNATURE = b"\x76\x2f\x31\x01"
BRIGHTEST_HALF = 65504.0  # the largest half float (IEEE 754 binary16)


def encode_light(light: NDArray[np.float32]) -> bytes:
    """Encode scene-linear light (H, W, 3), at least 0, as an EXR of half floats, channels R, G and B, zipped.

    What is brighter than 65504 is stored as that. Raises NoisyWorldError where a value is no finite number.
    """
    if not np.isfinite(light).all():
        wrong = int((~np.isfinite(light)).any(axis=-1).sum())
        raise NoisyWorldError(f"{wrong} pixels of light are no finite numbers, which an EXR of light does not take")
    return encode_exr(np.minimum(light, np.float32(BRIGHTEST_HALF)), "RGB", np.float16)


def decode_light(data: bytes) -> NDArray[np.float32]:
    """Return the light (H, W, 3) that `encode_light` encoded. Raises ValueError as `decode_exr`."""
    return decode_exr(data, "RGB")


def exr_channels(data: bytes) -> tuple[tuple[int, int], list[str]]:
    """Return the width and height of an EXR, and the names of its channels. Raises ValueError where it is none."""
    import OpenEXR

    stream = io.BytesIO(data)
    try:
        with OpenEXR.File(stream, header_only=True, num_threads=0) as file:
            header = file.header()  # which is empty once the file is closed
            names = sorted(channel.name for channel in header["channels"])
            (left, top), (right, bottom) = header["dataWindow"]
    except (RuntimeError, KeyError) as error:  # and ValueError, so OpenEXR says what is damaged
        raise ValueError("is no whole EXR") from error
    return (int(right - left + 1), int(bottom - top + 1)), names


def encode_npy(values: NDArray[Any]) -> bytes:
    """Encode an array of any shape as a file of numpy's."""
    data = io.BytesIO()
    np.save(data, np.ascontiguousarray(values), allow_pickle=False)
    return data.getvalue()


def decode_npy(data: bytes) -> NDArray[Any]:
    """Return the array in a file of numpy's. Raises ValueError where it is none, or damaged."""
    file = io.BytesIO(data)
    try:
        return np.load(file, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError("is no whole array of numpy's") from error
