# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels that tell of the surface which a pixel's centre sees: whatever renders it says the same of it."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..datasets.images import encode_steps
from ..scenes.mesh import Mesh
from ..trajectories.stamps import FrameStamps
from .channel import Channel, ImageFormat, ImageNames, PixelBytes

Fact: TypeAlias = Literal["normals", "faces"]
"""What a renderer can tell of a surface: its direction, or which face of the mesh it is."""


@dataclass(frozen=True)
class Surface:
    """What the centres of a frame's pixels see of a mesh, through the colour camera.

    normals: (H, W, 3) float32, of unit length, of the face itself, on the
    side that is seen, in OpenCV camera axes; zero where nothing is seen. faces: (H, W) int32, which face of the mesh;
    -1 where nothing is seen. Each is None where no channel asked for it.
    """

    normals: NDArray[np.float32] | None = None
    faces: NDArray[np.int32] | None = None


class SurfaceChannel(Channel):
    """A channel that is computed from what a frame sees of a mesh, by any engine that can tell it.

    needs: what it is computed from. has_content: whether its values have meanings of each scene's own. It is written as
    PNG of 16 bits, never perturbed, and lies in a folder of its name.
    """

    needs: ClassVar[frozenset[Fact]]
    has_content: ClassVar[bool] = False
    bytes_per_pixel: ClassVar[float]

    def problem(self, mesh: str) -> str:
        """Return why a mesh cannot give it, or ""; nothing but its file's head is read. mesh: as a scene names it."""
        del mesh
        return ""

    def files(self, mesh: str) -> tuple[Path, ...]:
        """Return the files beside a mesh's that decide what `content` says."""
        del mesh
        return ()

    def content(self, mesh: Mesh, path: str) -> dict[str, Any]:
        """Return what its values mean in this scene, for a file NAME.json of each sequence, if it has such.

        path: of the mesh, as a scene names it. Raises InputError where a file beside it is damaged.
        """
        del mesh, path
        return {}

    @abstractmethod
    def of_mesh(self, mesh: Mesh) -> Callable[[Surface], NDArray[Any]]:
        """Return what makes its image, of `dtype` and `components`, of what a frame sees of a mesh.

        What it keeps of the mesh stays in memory while that is rendered. Raises ValueError, saying why, where the mesh
        cannot give it.
        """

    @abstractmethod
    def steps_of(self, pixels: NDArray[Any]) -> NDArray[np.uint16]:
        """Return an image as 16-bit values, as its file holds them."""

    def suffix(self, written: ImageFormat) -> str:
        """Return PNG's."""
        del written
        return "png"

    def suffix_told(self, output: dict[str, Any]) -> str:
        """Return PNG's."""
        del output
        return "png"

    def name_in(self, layout: ImageNames, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return a name in a folder of the channel's name."""
        return layout.channel_name(self.name, frame, stamps, suffix)

    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Encode as PNG of 16 bits."""
        del written
        return encode_steps(self.steps_of(pixels))

    def pixel_bytes(self, written: ImageFormat) -> PixelBytes:
        """Return how large its files are; nothing perturbs them."""
        del written
        usual, bounds = self.bytes_per_pixel, (0.1 * self.bytes_per_pixel, 3 * self.bytes_per_pixel)
        return PixelBytes(usual, usual, bounds, bounds, bounds)

    def told(self, depth_scale_per_m: float) -> str:
        """Return what its files hold."""
        del depth_scale_per_m
        return f"{self.spoken} in 16 bits; {self.convention}"
