# SPDX-License-Identifier: GPL-3.0-or-later
"""Display-encoded colours as linear light, and back (IEC 61966-2-1), by component."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CODES = 65535  # of the table of light: half a step is a five hundredth of one of 8 bits


def decoded(colours: Any) -> Any:
    """Return the linear light of display-encoded colours."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def encoded(light: Any) -> Any:
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
    return np.asarray(decoded(np.arange(_CODES + 1) / _CODES), dtype=np.float32)
