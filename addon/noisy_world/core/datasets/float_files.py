# SPDX-License-Identifier: GPL-3.0-or-later
"""Images whose values are kept as they are in memory, without loss: EXR and NPY."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def encode_exr(pixels: NDArray[np.float32], parts: Sequence[str]) -> bytes:
    """Encode (H, W), or (H, W, components), as an EXR of a channel for each component, zipped. parts: their names."""
    import OpenEXR

    planes = np.moveaxis(np.atleast_3d(pixels).astype(np.float32, copy=False), -1, 0)
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
