# SPDX-License-Identifier: GPL-3.0-or-later
"""sRGB's encoding and its inverse (IEC 61966-2-1), of values of any size."""

import numpy as np
from numpy.typing import NDArray

LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec. 709


def decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light of sRGB-encoded values, of any shape."""
    import cv2

    base = np.maximum(encoded, np.float32(0))
    base += np.float32(0.055)
    base *= np.float32(1 / 1.055)
    # OpenCV's power takes a fifth of numpy's time.
    power = np.asarray(cv2.pow(base, 2.4), np.float32).reshape(encoded.shape)
    return np.multiply(encoded, np.float32(1 / 12.92), out=power, where=encoded <= np.float32(0.04045))


def encoded(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return sRGB-encoded values of linear light, of any shape."""
    import cv2

    base = np.maximum(light, np.float32(0))
    power = np.asarray(cv2.pow(base, 1 / 2.4), np.float32).reshape(light.shape)
    power *= np.float32(1.055)
    power -= np.float32(0.055)
    return np.multiply(light, np.float32(12.92), out=power, where=light <= np.float32(0.0031308))
