# SPDX-License-Identifier: GPL-3.0-or-later
"""Planar depth."""

from typing import Any

from numpy.typing import NDArray

from ..core.depth_range import OutOfRange
from ..core.trajectory import FrameStamps
from .channel import Channel, ImageFormat, ImageNames, PixelBytes

_BYTES = PixelBytes(0.5, 0.5, (0.2, 0.9), (0.2, 0.9), (1.0, 2.1))  # measured as colour's


class Depth(Channel):
    """Planar depth, in 16-bit steps."""

    name = "depth"
    order = 20
    label = "Depth"
    meaning = "planar depth of the pixel's centre, in 16-bit steps"
    spoken = "depth"
    dtype = "float32"
    components = 1
    unit = "m"
    convention = "planar depth z of the pixel's centre; uint16 = round(metres * depth_scale_per_m); 0 is void"
    steps = "depth"
    paired = True

    def name_in(self, layout: ImageNames, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the layout's name of a depth image."""
        del suffix
        return layout.depth_name(frame, stamps.depth.ns[frame])

    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Encode (H, W) float32, metres, 0 = void."""
        return written.encode_depth(pixels)

    def pixel_bytes(self, written: ImageFormat) -> PixelBytes:
        """Return how large 16-bit PNG is."""
        del written
        return _BYTES

    def lost(self, pixels: NDArray[Any], written: ImageFormat) -> OutOfRange | None:
        """Return the depth that 16 bits do not hold."""
        return written.out_of_range(pixels)

    def describe_files(self, depth_scale_per_m: float, kind: str) -> str:
        """Return how depth is stored."""
        del kind
        return f"depth in 16 bits, {depth_scale_per_m:g} steps a metre, 0 void"


CHANNEL = Depth()
