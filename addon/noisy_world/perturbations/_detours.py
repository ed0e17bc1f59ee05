# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that reaches a surface by one bounce off others: what makes a time of flight camera's corners too deep.

An approximation. Other surfaces are those of the frame alone, in patches of some pixels whose normals are their middle
pixel's; surfaces are matt, hide nothing from one another, and reflect once. Between patches light goes as between a
point and a disc (Siegel and Howell, Thermal Radiation Heat Transfer: cos cos A / (pi d^2 + A)), and between their
middles the result is interpolated.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ._incidence import TINY

COLUMNS = 40  # of patches; chosen: two patches from a corner within 2 % of an integral, in 60 ms
PAIRS_AT_ONCE = 1 << 15  # whose arrays stay in the processor's cache


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches of an image. places_m, towards: (N, 3) of their middles and of their normals, towards the camera.

    share: (N,) albedo times solid angle, steradians. range_m, area_m2: (N,).
    """

    places_m: NDArray[np.float32]
    towards: NDArray[np.float32]
    share: NDArray[np.float32]
    range_m: NDArray[np.float32]
    area_m2: NDArray[np.float32]


def by_one_bounce(
    depth_m: NDArray[np.float32], albedo: NDArray[np.float32], camera: Intrinsics, turn_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return real and imaginary part (H, W) of the phasor of light by one bounce, and its amount.

    depth_m: (H, W), 0 = void. albedo: (H, W). turn_m: the range of a whole turn. In units of the light that a white
    surface gives back at 1 m, seen head on; of a white surface, so times a pixel's own albedo.
    """
    import cv2

    height, width = depth_m.shape
    step = max(math.ceil(width / COLUMNS), 2)
    rows, columns = (np.arange(step // 2, size, step) for size in (height, width))
    if len(rows) < 1 or len(columns) < 1:
        nothing = np.zeros_like(depth_m)
        return nothing, nothing, nothing
    patches = _patches(depth_m, albedo, camera, (rows, columns), step)
    found = np.zeros((len(patches.range_m), 3), np.float32)
    size = max(PAIRS_AT_ONCE // len(found), 1)
    for first in range(0, len(found), size):
        at = slice(first, first + size)
        found[at] = _received(patches, at, turn_m)
    grid = found.reshape(len(rows), len(columns), 3)
    # Pixel x lies between the middles step / 2, 3 step / 2, ...
    u = ((np.arange(width) - step // 2) / step).astype(np.float32)
    v = ((np.arange(height) - step // 2) / step).astype(np.float32)
    maps = np.meshgrid(u, v)
    smooth = cv2.remap(grid, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    real, imaginary, amount = (np.asarray(smooth[..., part], np.float32) for part in range(3))
    x = (np.arange(width) - camera.cx_px) / camera.fx_px
    y = (np.arange(height) - camera.cy_px)[:, None] / camera.fy_px
    phase = (depth_m * np.sqrt(1 + x * x + y * y) * (math.pi / turn_m)).astype(np.float32)
    cosine, sine = np.cos(phase), np.sin(phase)
    return real * cosine - imaginary * sine, real * sine + imaginary * cosine, amount


def _received(patches: _Patches, at: slice, turn_m: float) -> NDArray[np.float32]:
    """Return (n, 3) of some patches: real, imaginary part and amount of what they get, without their own way back."""
    places_m, towards = patches.places_m, patches.towards
    across, down, ahead = (places_m[None, :, axis] - places_m[at, None, axis] for axis in range(3))
    square = across * across + down * down + ahead * ahead
    leaving = across * towards[:, 0] + down * towards[:, 1] + ahead * towards[:, 2]
    coming = across * towards[at, None, 0] + down * towards[at, None, 1] + ahead * towards[at, None, 2]
    weight = patches.share * np.maximum(-leaving, 0) * np.maximum(coming, 0)
    weight /= (np.float32(math.pi) * square + patches.area_m2) * square + np.float32(TINY)
    phase = (patches.range_m + np.sqrt(square)) * np.float32(math.pi / turn_m)
    return np.stack([part.sum(axis=1) for part in (weight * np.cos(phase), weight * np.sin(phase), weight)], axis=-1)


def _patches(
    depth_m: NDArray[np.float32],
    albedo: NDArray[np.float32],
    camera: Intrinsics,
    grid: tuple[NDArray[np.intp], NDArray[np.intp]],
    step: int,
) -> _Patches:
    inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=depth_m > 0)
    padded = np.pad(inverse, 1)
    row, column = (part.ravel() + 1 for part in np.meshgrid(*grid, indexing="ij"))
    here = padded[row, column]
    right = _smaller(padded[row, column + 1] - here, here - padded[row, column - 1])
    down = _smaller(padded[row + 1, column] - here, here - padded[row - 1, column])
    x, y = column - 1 - camera.cx_px, row - 1 - camera.cy_px
    normal = np.stack([right * camera.fx_px, down * camera.fy_px, here - x * right - y * down], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + TINY
    ray = np.stack([x / camera.fx_px, y / camera.fy_px, np.ones(len(x))], axis=-1)
    length = np.linalg.norm(ray, axis=1)
    z_m = np.divide(1.0, here, out=np.zeros_like(here), where=here > 0)
    solid = (step * step) / (camera.fx_px * camera.fy_px * length**3) * (here > 0)
    facing = np.maximum(np.einsum("nk,nk->n", normal, ray) / length, 1e-2)
    range_m = z_m * length
    share = albedo[row - 1, column - 1] * solid
    made = (ray * z_m[:, None], -normal, share, range_m, solid * range_m**2 / facing)
    return _Patches(*(values.astype(np.float32) for values in made))


def _smaller(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.abs(one) < np.abs(other), one, other)
