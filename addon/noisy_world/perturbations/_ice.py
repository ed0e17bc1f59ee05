# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of ice on a pane, drawn by `headless/pictures/draw_ice.py`: loaded, and tinted like photographs of ice."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.regular_files import read_bytes
from ..core.shipped import shipped

# Chosen: a frame of 1200 x 680 and the tenth that frost's crop moves in (1320 x 748) fit without enlarging the ice.
HEIGHT_PX, WIDTH_PX = 1024, 1536

Rgb: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Ice:
    """A grey picture, and the factors per channel that tint its darkest and its brightest greys."""

    name: str
    shadow_rgb: Rgb
    light_rgb: Rgb


# The tints follow those of the five photographs that ImageNet-C picks from; two of these show white ice, so the white
# picture (number 1) is picked twice as often as each of the others.
PICTURES = (
    Ice("sheet", (0.0, 1.33, 1.50), (1.15, 0.95, 1.03)),
    Ice("needles", (0.94, 0.96, 1.0), (0.98, 0.99, 1.04)),
    Ice("rime", (0.85, 1.0, 1.12), (0.95, 1.01, 1.05)),
    Ice("ferns", (0.84, 0.97, 1.18), (0.98, 1.01, 1.05)),
)
EQUALLY_OFTEN = (0, 1, 1, 2, 3)


def picture_file(name: str) -> Path:
    """Return the path of a grey picture."""
    return shipped("perturbations/ice") / f"{name}.jpg"


def grey_picture(number: int) -> NDArray[np.uint8]:
    """Return one of PICTURES as it is drawn: (HEIGHT_PX, WIDTH_PX)."""
    import cv2

    encoded = np.frombuffer(read_bytes(picture_file(PICTURES[number].name)), dtype=np.uint8)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), np.uint8)


def tinted(levels: NDArray[np.float32], number: int) -> NDArray[np.float32]:
    """Return grey (H, W) in [0, 1] tinted as one of PICTURES is, (H, W, 3), at most 1."""
    item = PICTURES[number]
    shadow, light = np.array(item.shadow_rgb, np.float32), np.array(item.light_rgb, np.float32)
    level = levels[..., None]
    return np.minimum(level * (shadow + (light - shadow) * level), np.float32(1))


@lru_cache(maxsize=8)
def ice_picture(number: int) -> NDArray[np.uint8]:
    """Return one of PICTURES, tinted: (HEIGHT_PX, WIDTH_PX, 3) uint8 RGB, read-only."""
    import cv2

    item = PICTURES[number]
    levels = np.arange(256, dtype=np.float32)[:, None] / np.float32(255)
    shadow, light = np.array(item.shadow_rgb, np.float32), np.array(item.light_rgb, np.float32)
    table = levels * (shadow + (light - shadow) * levels)
    tints = np.rint(np.clip(table, 0, 1) * np.float32(255)).astype(np.uint8)
    picture = np.asarray(
        cv2.merge([cv2.LUT(grey_picture(number), tint) for tint in np.ascontiguousarray(tints.T)]), np.uint8
    )
    picture.flags.writeable = False
    return picture
