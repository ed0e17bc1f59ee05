# SPDX-License-Identifier: GPL-3.0-or-later
"""Display-encoded colours as linear light, and back (IEC 61966-2-1), by component."""

from typing import Any

import numpy as np


def decoded(colours: Any) -> Any:
    """Return the linear light of display-encoded colours."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def encoded(light: Any) -> Any:
    """Return linear light, at least 0, as display-encoded colours."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)
