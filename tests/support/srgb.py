# SPDX-License-Identifier: GPL-3.0-or-later
"""The curve of sRGB (IEC 61966-2-1), in float64; beyond [0, 1] by the same formulas."""

import numpy as np


def linear(encoded):
    """Return linear light of display-encoded values."""
    encoded = np.asarray(encoded, np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def encoded(light):
    """Return display-encoded values of linear light."""
    light = np.asarray(light, np.float64)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055)
