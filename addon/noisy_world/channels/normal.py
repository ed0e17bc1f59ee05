# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface normals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scenes.polygon_mesh import Mesh
from .channel import Surface, SurfaceChannel

FULL = 65535  # of 16 bits


class Normal(SurfaceChannel):
    """The direction of the surface: of a mesh that of the face itself, without smoothing between faces."""

    name = "normal"
    order = 30
    label = "Normals"
    meaning = "unit surface normals in camera axes; 0 0 0 is void"
    spoken = "normals"
    dtype = "float32"
    components = 3
    unit = "1"
    convention = (
        "unit normals of the surface, on the side that is seen, in the colour camera's axes (OpenCV: x right, y down, "
        "z forward); uint16 = round((n + 1) / 2 * 65535) for each of x, y, z as R, G, B; 0 0 0 is void"
    )
    needs = frozenset({"normals"})
    bytes_per_pixel = 1.0

    def of_mesh(self, mesh: Mesh | None) -> Callable[[Surface], NDArray[Any]]:
        """Return what gives the normals (H, W, 3) float32; zero where nothing is seen."""
        del mesh
        return _normals

    def steps_of(self, pixels: NDArray[Any]) -> NDArray[np.uint16]:
        """Return (H, W, 3): 0 to 65535 for -1 to 1, and 0 0 0 for void."""
        seen = pixels.any(axis=-1, keepdims=True)
        steps = np.rint((np.clip(pixels, -1, 1).astype(np.float64) + 1) / 2 * FULL)
        return np.where(seen, steps, 0).astype(np.uint16)

    def pixels_of(self, steps: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return (H, W, 3) float32, within 2e-5 of what was written; void is 0 0 0."""
        normals = steps / np.float32(FULL) * 2 - 1
        return np.where(steps.any(axis=-1, keepdims=True), normals, 0).astype(np.float32)


def _normals(surface: Surface) -> NDArray[Any]:
    assert surface.normals is not None, "they are needed"
    return surface.normals


CHANNEL = Normal()
