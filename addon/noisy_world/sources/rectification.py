# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectification of a recording's frames before they are perturbed: undistorted, and depth registered to colour."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.bending import Bending
from ..core.datasets.registration import Registration
from ..core.geometry import Intrinsics
from ..core.optics import Distortion, Optics


@dataclass(frozen=True)
class Rectification:
    """Undistorts, registers and bends frames. camera: of colour. optics: of the recording, before it is done.

    bent: the lens that frames are shown through in the end; None for none.
    """

    camera: Intrinsics
    optics: Optics
    undistort: bool = False
    register: bool = False
    bent: Distortion | None = None

    @property
    def does_nothing(self) -> bool:
        """Whether frames stay as they are."""
        return self._lens is None and self._between is None and self.bent is None

    @property
    def left(self) -> Optics:
        """What the cameras of treated frames have beyond one pinhole."""
        left = replace(self.optics, distortion=None) if self.undistort else self.optics
        left = replace(left, depth=None) if self.register else left
        if left.depth is not None and self.undistort:
            left = replace(left, depth=replace(left.depth, shares_lens=False))
        return left if self.bent is None else replace(left, distortion=self.bent)

    def rgb(self, rgb: NDArray[Any]) -> NDArray[Any]:
        """Return colour (H, W, 3) of the type given. What the lens did not see is black."""
        import cv2

        if self._lens is not None:
            rgb = np.asarray(cv2.remap(rgb, *self._colour_maps, cv2.INTER_LINEAR), rgb.dtype)
        return rgb if self._bending is None else self._bending.rgb(rgb)

    def depth_m(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres, 0 = void; of the nearest pixel, but for what is bent."""
        import cv2

        if self._lens is not None and (self.optics.depth is None or self.optics.depth.shares_lens):
            # Depths are not averaged: between two surfaces there is nothing.
            depth_m = np.asarray(cv2.remap(depth_m, *self._depth_maps, cv2.INTER_NEAREST), np.float32)
        if self._between is not None:
            depth_m = self._between.depth_in_colour(depth_m)
        return depth_m if self._bending is None else self._bending.depth_m(depth_m)

    @cached_property
    def _bending(self) -> Bending | None:
        return None if self.bent is None else Bending(self.camera, self.camera, self.bent)

    @cached_property
    def _lens(self) -> Distortion | None:
        return self.optics.distortion if self.undistort else None

    @cached_property
    def _between(self) -> Registration | None:
        if not self.register or self.optics.depth is None:
            return None
        left = None if self.undistort else self.optics.distortion
        return Registration(self.camera, self.optics.depth, left)

    @cached_property
    def _colour_maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return _maps(self.camera, self._lens)

    @cached_property
    def _depth_maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        seen = self.camera if self.optics.depth is None else self.optics.depth.intrinsics
        return _maps(seen, self._lens)


def _maps(camera: Intrinsics, lens: Distortion | None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where each pixel of a pinhole of the same intrinsics is in the distorted image, x and y (H, W)."""
    assert lens is not None, "asked for by who has one"
    rays = camera.ray_directions()
    x, y = lens.bent(rays[..., 0], rays[..., 1])
    across, down = x * camera.fx_px + camera.cx_px, y * camera.fy_px + camera.cy_px
    return across.astype(np.float32), down.astype(np.float32)
