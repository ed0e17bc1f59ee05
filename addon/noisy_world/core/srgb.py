# SPDX-License-Identifier: GPL-3.0-or-later
"""sRGB's encoding and its inverse (IEC 61966-2-1)."""

from functools import cache
from typing import Any

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


# --- exact, of any values, by component ---

_CODES = 65535  # of the table of light: half a step is a five hundredth of one of 8 bits


def exact_light(colours: Any) -> Any:
    """Return the linear light of display-encoded colours."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def exact_colours(light: Any) -> Any:
    """Return linear light, at least 0, as display-encoded colours."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def quick_light(colours: NDArray[Any]) -> NDArray[np.float32]:
    """Return the linear light of display-encoded colours: float32 in [0, 1] or uint8, from a table of 16 bits.

    Colours beyond [0, 1] are taken to its ends.
    """
    if colours.dtype == np.uint8:
        return _light_of_codes()[colours.astype(np.uint16) * np.uint16(_CODES // 255)]
    codes = np.clip(colours, np.float32(0), np.float32(1))
    codes *= np.float32(_CODES)
    codes += np.float32(0.5)
    return _light_of_codes()[codes.astype(np.uint16)]  # a quarter of the time of np.take


@cache
def _light_of_codes() -> NDArray[np.float32]:
    return np.asarray(exact_light(np.arange(_CODES + 1) / _CODES), dtype=np.float32)
