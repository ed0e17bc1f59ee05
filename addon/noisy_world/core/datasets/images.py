# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour and depth as the bytes of image files."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

JPEG_QUALITY = 98
PNG_LEVEL = 1  # 16 ms a depth frame; level 9 saves a tenth of the bytes for forty times that
UINT16_MAX = 65535


def rgb_bytes(rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Round display-encoded colours (H, W, 3) float in [0, 1] to the nearest byte; what lies outside is clipped."""
    import cv2

    flat = rgb.reshape(rgb.shape[0], -1)  # to OpenCV a number stands for the first channel alone
    return cv2.convertScaleAbs(cv2.min(cv2.max(flat, 0.0), 1.0), alpha=255).reshape(rgb.shape)


def encode_rgb(rgb: NDArray[np.uint8], image: Literal["jpg", "png"]) -> bytes:
    """Encode (H, W, 3) uint8 RGB as JPEG (quality 98, 4:4:4: storing adds nothing visible) or PNG."""
    import cv2

    options = _png_options()
    if image == "jpg":
        options = [
            cv2.IMWRITE_JPEG_QUALITY,
            JPEG_QUALITY,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ]
    return _encode(f".{image}", rgb[..., ::-1], options)


def quantise_depth(depth_m: NDArray[np.float32], scale_per_m: float) -> NDArray[np.uint16]:
    """Turn planar depth (H, W) in metres into steps of 1 / scale_per_m; 0 = void.

    What does not fit into 16 bits, is negative or is no number becomes void; nothing wraps.
    """
    # Float64: in float32 a depth near the far end lies up to 0.004 of a step off, and rounds wrongly now and then.
    steps = np.rint(depth_m.astype(np.float64) * scale_per_m)
    fits = (steps >= 0) & (steps <= UINT16_MAX)  # False for NaN
    return np.where(fits, steps, 0).astype(np.uint16)


def encode_depth(steps: NDArray[np.uint16]) -> bytes:
    """Encode (H, W) uint16 as PNG."""
    return _encode(".png", steps, _png_options())


def _png_options() -> list[int]:
    """One filter for all lines, the difference to the line above: half the time of trying all, the same bytes."""
    import cv2

    return [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]


def _encode(suffix: str, pixels: NDArray[np.uint8] | NDArray[np.uint16], options: list[int]) -> bytes:
    import cv2

    done, data = cv2.imencode(suffix, np.ascontiguousarray(pixels), options)
    if not done:
        raise RuntimeError(f"OpenCV could not encode {pixels.shape} {pixels.dtype} as {suffix}")
    return data.tobytes()
