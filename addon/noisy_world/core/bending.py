# SPDX-License-Identifier: GPL-3.0-or-later
"""A pinhole's images as a lens that distorts would have shown them: resampled along the exact rays of the lens.

What is cast as rays needs none of this. It is for renderers that know pinholes alone, which render what is beside the
image too, and for recordings, of which that is lost.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .geometry import Intrinsics
from .lens import lens_rays, projected
from .optics import Distortion

Float32: TypeAlias = NDArray[np.float32]

MARGIN_PX = 2  # beside the outermost rays: depth looks at the neighbours of a pixel's neighbours
SMOOTH = 1e-3  # of the inverse depth: neighbours that are bent less are one surface; chosen, 16 bits' steps are within


@dataclass(frozen=True)
class Bending:
    """Makes images of a lens of a pinhole's.

    pinhole: the camera of what is given. camera: that of what is made. where: the rows and columns (H, W), float64, of
    the pinhole's image at which its pixels' rays are; by default they are found.
    """

    pinhole: Intrinsics
    camera: Intrinsics
    lens: Distortion
    where: tuple[NDArray[np.float64], NDArray[np.float64]] | None = field(default=None, compare=False, repr=False)

    def part(self, rows: slice, columns: slice) -> "tuple[slice, slice, Bending]":
        """Return what of the pinhole's image a part of the lens's image needs, and what makes the one of the other.

        rows, columns: of the lens's image. Returns rows and columns of the pinhole's, and the bending from the one part
        to the other, each as an image of its own.
        """
        where = tuple(each[rows, columns] for each in self._where)
        sizes = self.pinhole.height_px, self.pinhole.width_px
        down, across = (
            slice(max(math.floor(at.min()) - MARGIN_PX, 0), min(math.floor(at.max()) + MARGIN_PX + 2, size))
            for at, size in zip(where, sizes, strict=True)
        )
        of = Bending(
            _cut(self.pinhole, down, across),
            _cut(self.camera, rows, columns),
            self.lens,
            (where[0] - down.start, where[1] - across.start),
        )
        return down, across, of

    def rgb(self, rgb: NDArray[Any]) -> NDArray[Any]:
        """Return colour (H, W, 3) of the type given: four neighbours interpolated. Black where the pinhole saw nothing.

        What the pinhole saw ends half a pixel beyond its outer pixels' centres.
        """
        row, column, beside = self._places
        part_v, part_u = (part.astype(np.float32)[..., None] for part in self._parts)
        values = rgb.astype(np.float32)
        upper = values[row, column] * (1 - part_u) + values[row, column + 1] * part_u
        lower = values[row + 1, column] * (1 - part_u) + values[row + 1, column + 1] * part_u
        made = upper * (1 - part_v) + lower * part_v
        made[beside] = 0
        return (np.rint(made) if np.issubdtype(rgb.dtype, np.integer) else made).astype(rgb.dtype)

    def depth_m(self, depth_m: Float32) -> Float32:
        """Return planar depth (H, W), metres, 0 = void and where the pinhole saw nothing.

        On a plane the inverse of planar depth is linear over the image, so it is interpolated where four neighbours are
        of one smooth surface, exactly so on a plane. Elsewhere a pixel has the depth of the nearest one.
        """
        row, column, _ = self._places
        part_v, part_u = self._parts
        seen = depth_m > 0
        inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=seen)
        smooth = seen & _straight(inverse, 0) & _straight(inverse, 1)
        corners = [(row + down, column + right) for down in (0, 1) for right in (0, 1)]
        values = [inverse[corner] for corner in corners]
        same = np.logical_and.reduce([smooth[corner] for corner in corners])
        same &= np.abs(values[0] - values[1] - values[2] + values[3]) <= SMOOTH * values[0]
        upper = values[0] * (1 - part_u) + values[1] * part_u
        lower = values[2] * (1 - part_u) + values[3] * part_u
        between = upper * (1 - part_v) + lower * part_v
        made = self.nearest(depth_m)
        np.divide(1.0, between, out=made, where=same & ~self._places[2], casting="same_kind")
        return made

    def nearest(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return an image (H, W) or (H, W, C) of each pixel's nearest one; 0 where the pinhole saw nothing."""
        row, column, beside = self._places
        part_v, part_u = self._parts
        made = image[row + (part_v >= 0.5), column + (part_u >= 0.5)]
        made[beside] = 0
        return made

    def motion(self, motion_px: Float32) -> Float32:
        """Return motion on the image (H, W, 2), pixels right and down, of the nearest pixel's on the pinhole's image.

        NaN where the pinhole saw nothing, and where it leads beside the image of the lens.
        """
        pinhole = self.pinhole
        v, u = np.indices((pinhole.height_px, pinhole.width_px), dtype=np.float64)
        ways: list[NDArray[np.float64]] = []
        for at_u, at_v in ((u, v), (u + motion_px[..., 0], v + motion_px[..., 1])):
            x, y = (at_u - pinhole.cx_px) / pinhole.fx_px, (at_v - pinhole.cy_px) / pinhole.fy_px
            rays = np.stack([x, y, np.ones_like(x)], axis=-1)
            ways.append(np.stack(projected(rays, self.camera, self.lens), axis=-1))
        made = self.nearest((ways[1] - ways[0]).astype(np.float32))
        made[self._places[2]] = np.nan
        return made

    @cached_property
    def _where(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.where is not None:
            return self.where
        rays, pinhole = lens_rays(self.camera, self.lens), self.pinhole
        return rays.down * pinhole.fy_px + pinhole.cy_px, rays.right * pinhole.fx_px + pinhole.cx_px

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """The upper left of the four pixels around each ray, and whether it is beside the pinhole's image."""
        sizes = self.pinhole.height_px, self.pinhole.width_px
        beside = np.logical_or.reduce(
            [~((at >= -0.5) & (at < size - 0.5)) for at, size in zip(self._where, sizes, strict=True)]
        )
        row, column = (
            np.clip(np.floor(at), 0, size - 2).astype(np.intp) for at, size in zip(self._where, sizes, strict=True)
        )
        return row, column, beside

    @cached_property
    def _parts(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How far between the four pixels a ray is, down and right, from 0 to 1."""
        row, column, _ = self._places
        v, u = self._where
        return np.clip(v - row, 0.0, 1.0), np.clip(u - column, 0.0, 1.0)


def _cut(camera: Intrinsics, rows: slice, columns: slice) -> Intrinsics:
    """Return the camera of a part of an image."""
    return replace(
        camera,
        width_px=columns.stop - columns.start,
        height_px=rows.stop - rows.start,
        cx_px=camera.cx_px - columns.start,
        cy_px=camera.cy_px - rows.start,
    )


def _straight(inverse: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Tell of each pixel whether it and its neighbours along an axis are of one smooth surface."""
    if inverse.shape[axis] < 3:
        return np.full(inverse.shape, False)
    bend = np.abs(np.diff(inverse, n=2, axis=axis))
    ends = [(1, 1) if along == axis else (0, 0) for along in range(2)]
    return np.pad(bend, ends, mode="edge") <= SMOOTH * inverse


def overscanned(camera: Intrinsics, lens: Distortion) -> Intrinsics:
    """Return the pinhole of equal focal lengths that sees all that a lens brings into the image of a camera."""
    rays = lens_rays(camera, lens)
    u, v = rays.right * camera.fx_px, rays.down * camera.fy_px
    left, top = math.floor(u.min()) - MARGIN_PX, math.floor(v.min()) - MARGIN_PX
    width, height = math.ceil(u.max()) + MARGIN_PX - left + 1, math.ceil(v.max()) + MARGIN_PX - top + 1
    return Intrinsics(width, height, camera.fx_px, camera.fy_px, float(-left), float(-top))
