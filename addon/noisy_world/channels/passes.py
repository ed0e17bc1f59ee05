# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes of a scene of one's own, Cryptomatte among them: a multilayer EXR beside each frame, for compositors."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..images.pixels import encode_layers, exr_channels
from .channel import Channel, ImageFormat

NAME = "passes"


class Passes(Channel):
    """All passes that the scene's view layer renders, and Cryptomatte of objects and materials.

    In memory its image is the file itself, (1, N) uint8, as each scene has passes of its own.
    """

    name = NAME
    order = 80
    label = "Passes"
    meaning = "the passes that the scene's view layer has, with Cryptomatte"
    spoken = "passes"
    dtype = "uint8"
    components = 1
    unit = "file"
    convention = (
        "multilayer EXR, float32, zipped: LAYER.PASS.CHANNEL as Blender names them, and Cryptomatte's manifests of "
        "objects and materials in the header; of the clean scene, before the view transform"
    )
    kinds = ("exr",)
    bytes_per_pixel = 40.0

    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Return the file."""
        del written
        return pixels.tobytes()

    def decode(self, data: bytes, kind: str) -> NDArray[np.uint8]:
        """Return the file (1, N), whose layers OpenEXR reads. Raises ValueError where it is none."""
        del kind
        exr_channels(data)
        return np.frombuffer(data, np.uint8)[None]


def passes_image(channels: Mapping[str, NDArray[np.float32]], attributes: Mapping[str, str]) -> NDArray[np.uint8]:
    """Return the image of passes: channels (H, W) by their whole names, and what the header says beside them."""
    return np.frombuffer(encode_layers(channels, attributes), np.uint8)[None]


CHANNEL = Passes()
