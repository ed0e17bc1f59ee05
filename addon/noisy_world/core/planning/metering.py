# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera's meter sees of a clean frame of a source."""

import numpy as np
from numpy.typing import NDArray

from ..perturbing.earlier_frames import small_light, small_of
from .source import SourceFrame


def light_seen(frame: SourceFrame) -> NDArray[np.float32]:
    """Return what a meter sees of a clean frame, as `small_light`; of a lit one its light."""
    if (light := frame.light) is not None:
        return small_of(light.rgb)
    assert frame.rgb is not None, "colour was not asked for"
    return small_light(frame.rgb)
