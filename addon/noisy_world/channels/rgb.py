# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.trajectory import FrameStamps
from ..images.pixels import decode_light
from .channel import Channel, ImageFormat, ImageNames, PixelBytes

# Measured in two rooms with every perturbation of the benchmark, and the bounds widened to what the shipped presets'
# files and recordings have.
_BYTES = {
    "jpg": PixelBytes(0.85, 1.1, (0.5, 1.3), (0.2, 1.6), (1.6, 2.9)),
    "png": PixelBytes(1.5, 1.6, (0.9, 2.2), (0.4, 2.4), (1.8, 3.1)),
    "exr": PixelBytes(3.6, 3.6, (0.2, 4.5), (0.2, 4.8), (0.2, 4.8)),  # grain of few samples is what costs
}


LIGHT = "RGB, half floats, scene-linear light (Rec. 709) before the view transform; void is black; at most 65504"


class Rgb(Channel):
    """Colour, as a camera gives it; a preset may ask for grey, and for JPEG, PNG or EXR."""

    name = "rgb"
    order = 10
    label = "Colour"
    meaning = "colour, display-encoded (sRGB), or grey made of it"
    spoken = "colour"
    dtype = "float32"
    components = 3
    unit = "display-encoded, 0 to 1"
    convention = "RGB, 8 bits, sRGB-encoded; void is black"
    steps = "rgb"
    kinds = ("jpg", "png", "exr")  # `output.image` chooses

    def suffix(self, written: ImageFormat) -> str:
        """Return the kind of image that the preset chose."""
        return written.image

    def recorded_suffix(self, output: dict[str, Any]) -> str:
        """Return the kind of image that the identity tells."""
        return output["image"]

    def name_in(self, layout: ImageNames, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the layout's name of a colour image."""
        return layout.rgb_name(frame, stamps.rgb.ns[frame], suffix if suffix in ("jpg", "exr") else "png")

    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Encode (H, W, 3), uint8 or float32 in [0, 1]; for an EXR light, float32."""
        return written.encode_rgb(pixels)

    def encode_clean(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Encode (H, W, 3) without Huffman tables of its own: links spare more."""
        return written.encode_rgb(pixels, fit_tables=False)

    def decode(self, data: bytes, kind: str) -> NDArray[Any]:
        """Return the light (H, W, 3) float32 of an EXR; readers of images decode other kinds. Raises ValueError."""
        if kind != "exr":
            raise ValueError(f"is {kind}, which readers of images decode")
        return decode_light(data)

    def convention_in(self, kind: str) -> str:
        """Return what its files hold, of some kind."""
        return LIGHT if kind == "exr" else self.convention

    def stored(self, pixels: NDArray[Any], kind: str) -> NDArray[Any]:
        """Return light as an EXR holds it; other kinds as they are given."""
        return pixels.astype(np.float16).astype(np.float32) if kind == "exr" else pixels

    def pixel_bytes(self, written: ImageFormat) -> PixelBytes:
        """Return how large JPEG, PNG or EXR is."""
        return _BYTES[written.image]

    def describe_files(self, depth_scale_per_m: float, kind: str) -> str:
        """Return no more than its word."""
        del depth_scale_per_m
        return f"{self.spoken} as EXR; {LIGHT}" if kind == "exr" else self.spoken


CHANNEL = Rgb()
