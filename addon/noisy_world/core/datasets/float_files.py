# SPDX-License-Identifier: GPL-3.0-or-later
"""Images whose values are kept as they are in memory, without loss: EXR and NPY; and light as half floats."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import NoisyWorldError


def encode_exr(pixels: NDArray[np.float32], parts: Sequence[str], dtype: type[np.floating[Any]] = np.float32) -> bytes:
    """Encode (H, W), or (H, W, components), as an EXR of a channel for each component, zipped. parts: their names."""
    import OpenEXR

    planes = np.moveaxis(np.atleast_3d(pixels).astype(dtype, copy=False), -1, 0)
    channels = {name: np.ascontiguousarray(plane) for name, plane in zip(parts, planes, strict=True)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    data = io.BytesIO()
    OpenEXR.File(header, channels, num_threads=0).write(data)
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


def light_size_px(data: bytes) -> tuple[int, int]:
    """Return the width and height of an EXR of colour, by its header. Raises ValueError where it is none."""
    import OpenEXR

    stream = io.BytesIO(data)
    try:
        with OpenEXR.File(stream, header_only=True, num_threads=0) as file:
            header = file.header()  # which is empty once the file is closed
            names = sorted(channel.name for channel in header["channels"])
            (left, top), (right, bottom) = header["dataWindow"]
    except (RuntimeError, KeyError) as error:  # and ValueError, so OpenEXR says what is damaged
        raise ValueError("is no whole EXR") from error
    if names != ["B", "G", "R"]:
        raise ValueError("is an EXR of other channels than R, G and B")
    return int(right - left + 1), int(bottom - top + 1)


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
