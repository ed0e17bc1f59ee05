# SPDX-License-Identifier: GPL-3.0-or-later
"""A signed distance volume with colours, fused of depth images (Curless and Levoy 1996, KinectFusion 2011).

Each voxel near a surface keeps the mean of its signed distances, positive in front of the surface, as the depth images
that see it say, each with the plane that it sees there, weighted by how directly it sees it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.scenes.mesh import Mesh
from .blocks import BLOCK, VOXELS, Blocks, Keys, keys_of, places_of, unique_keys
from .surface import COLOUR_WEIGHT, RED, SDF, WEIGHT, surface_of

TRUNCATION = 4  # voxels: how far from a surface distances are kept; chosen
MOST_BLOCKS = 60_000  # 740 MB with colours
REACH = 1_000_000  # 20 km with voxels of 2 cm
_SIDEWAYS = 4  # depths: how far to the side a pixel can see; more than any pinhole camera that is used
_LEAST_FACING = 0.05  # the cosine of 87 degrees: what is seen along it is still better than nothing; chosen
_AT_ONCE = 2048  # blocks: a million voxels, whose arrays stay small

_LOCAL = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), axis=-1).reshape(VOXELS, 3)


class ColourVolume:
    """Voxels around all surfaces that were seen, wherever they are.

    voxel_m: their edge. It doubles, and all that is there is merged, where more than `most_blocks` would be needed, so
    memory is bounded whatever the poses are. What is seen more than REACH voxels from the first frame is not taken.
    """

    def __init__(self, camera: Intrinsics, voxel_m: float = 0.02, *, most_blocks: int = MOST_BLOCKS) -> None:
        """Begin empty. Raises ValueError for a size that is not positive."""
        if not (np.isfinite(voxel_m) and voxel_m > 0):
            raise ValueError(f"a voxel's edge is a positive number of metres, not {voxel_m}")
        self.voxel_m = float(voxel_m)
        self._camera = camera
        self._most_blocks = most_blocks
        self._blocks = Blocks(RED + 3)
        self._origin_m: NDArray[np.float64] | None = None  # a corner of blocks, of the first voxels' size

    @property
    def truncation_m(self) -> float:
        """How far from a surface distances are kept."""
        return TRUNCATION * self.voxel_m

    def integrate(
        self,
        depth_m: NDArray[np.float32],
        c2w: NDArray[np.float64],
        rgb: NDArray[np.uint8] | None = None,
        *,
        far_m: float = np.inf,
    ) -> bool:
        """Add a frame: depth (H, W), 0 or not finite where there is none, and colour (H, W, 3) seen from the same pose.

        c2w: (4, 4), OpenCV axes. far_m: what is farther is left out. Returns whether the frame is within reach.
        Raises ValueError for another size than the camera's.
        """
        size = (self._camera.height_px, self._camera.width_px)
        if depth_m.shape != size or (rgb is not None and rgb.shape != (*size, 3)):
            raise ValueError(f"a frame of {depth_m.shape} is not the camera's {size}")
        there = np.isfinite(depth_m) & (depth_m > 0) & (depth_m <= far_m)
        depth_m = np.where(there, depth_m, 0).astype(np.float32)
        if not there.any():
            return True
        if self._origin_m is None:
            edge_m = BLOCK * self.voxel_m
            self._origin_m = np.floor(c2w[:3, 3] / edge_m) * edge_m
        c2w = c2w.copy()
        c2w[:3, 3] -= self._origin_m
        if np.abs(c2w[:3, 3]).max() + _SIDEWAYS * depth_m.max() + self.truncation_m > REACH * self.voxel_m:
            return False
        image = _Image(depth_m, *self._facing(depth_m), rgb)
        keys = self._touched(depth_m, c2w)
        while len(self._blocks) + len(self._blocks.missing(keys)) > self._most_blocks:
            self._coarsen()
            keys = self._touched(depth_m, c2w)
        self._blocks.add(self._blocks.missing(keys))
        slots = self._blocks.slots(keys)
        for first in range(0, len(keys), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            self._update(keys[some], slots[some], image, c2w)
        return True

    def surface(self) -> Mesh | None:
        """Return where the distance is zero, as quads coloured at their vertices; None where nothing is."""
        if self._origin_m is None:
            return None
        return surface_of(self._blocks, self.voxel_m, self._origin_m)

    def _touched(self, depth_m: NDArray[np.float32], c2w: NDArray[np.float64]) -> Keys:
        """Return the keys of the blocks within the truncation of what a depth image sees, along its rays."""
        step = max(1, self._camera.width_px // 320)  # neighbouring pixels see the same blocks
        down, right = np.nonzero(depth_m[::step, ::step])
        z = depth_m[::step, ::step][down, right].astype(np.float64)
        camera = self._camera
        x, y = (right * step - camera.cx_px) / camera.fx_px, (down * step - camera.cy_px) / camera.fy_px
        rays = np.stack([x, y, np.ones_like(x)], axis=1) @ c2w[:3, :3].T
        edge_m = BLOCK * self.voxel_m
        keys = [
            unique_keys(np.floor((c2w[:3, 3] + rays * np.maximum(z + shift, 0)[:, None]) / edge_m).astype(np.int64))
            for shift in np.linspace(-self.truncation_m, self.truncation_m, 5)
        ]
        return np.unique(np.concatenate(keys))

    def _facing(self, depth_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return how a step along the optical axis changes the distance to each pixel's surface, and its cosine.

        (H * W,) each. The plane through the pixel's neighbours decides; a cosine is at least _LEAST_FACING.
        """
        camera = self._camera
        x = (np.arange(camera.width_px, dtype=np.float32) - np.float32(camera.cx_px)) / np.float32(camera.fx_px)
        y = (np.arange(camera.height_px, dtype=np.float32) - np.float32(camera.cy_px)) / np.float32(camera.fy_px)
        # The inverse depth of a plane n p = d is (n r) / d for rays r = (x, y, 1): linear in the pixel.
        inverse = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
        a = _slope(inverse, 1) * np.float32(camera.fx_px)
        b = _slope(inverse, 0) * np.float32(camera.fy_px)
        c = inverse - a * x - b * y[:, None]
        length = np.sqrt(a * a + b * b + c * c)
        along = np.divide(inverse, length, out=np.ones_like(depth_m), where=length > 0)
        cosine = np.maximum(along / np.sqrt(1 + x * x + (y * y)[:, None]), np.float32(_LEAST_FACING))
        return np.maximum(along, np.float32(_LEAST_FACING)).reshape(-1), cosine.reshape(-1)

    def _update(self, keys: Keys, slots: NDArray[np.intp], image: "_Image", c2w: NDArray[np.float64]) -> None:
        """Add what an image says of some blocks."""
        camera, w2c = self._camera, c2w[:3, :3].T
        corners = (places_of(keys) * (BLOCK * self.voxel_m) - c2w[:3, 3]) @ w2c.T
        offsets = (_LOCAL + 0.5) * self.voxel_m @ w2c.T
        x, y, z = (
            np.add(corners[:, axis, None], offsets[None, :, axis], dtype=np.float32, casting="same_kind").reshape(-1)
            for axis in range(3)
        )
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # behind the camera: left out below
            x /= z
            y /= z
            x *= np.float32(camera.fx_px)
            y *= np.float32(camera.fy_px)
        x += np.float32(camera.cx_px + 0.5)
        y += np.float32(camera.cy_px + 0.5)
        seen = (z > self.voxel_m) & (x >= 0) & (x < camera.width_px) & (y >= 0) & (y < camera.height_px)
        voxels = np.flatnonzero(seen)
        pixels = y[voxels].astype(np.int32) * camera.width_px + x[voxels].astype(np.int32)
        seen_m = image.depth_m.reshape(-1)[pixels]
        distance_m = seen_m - z[voxels]
        known = np.flatnonzero((seen_m > 0) & (distance_m > -self.truncation_m))
        distance_m, pixels, voxels = distance_m[known], pixels[known], voxels[known]
        planes = self._blocks.voxels.reshape(RED + 3, -1)
        voxels += slots[voxels // VOXELS] * VOXELS - voxels // VOXELS * VOXELS  # where they are in memory
        distance_m = np.minimum(distance_m * image.along[pixels], np.float32(self.truncation_m))
        weights = image.cosine[pixels]
        _add(planes[SDF], planes[WEIGHT], voxels, weights, [distance_m])
        if image.rgb is not None:
            near = np.flatnonzero(distance_m < self.truncation_m)  # what is before a surface has no colour
            colours = image.rgb.reshape(-1, 3)[pixels[near]].T
            _add(planes[RED:], planes[COLOUR_WEIGHT], voxels[near], weights[near], list(colours))

    def _coarsen(self) -> None:
        """Double the voxels: eight become one, each with its weight."""
        old, keys = self._blocks, self._blocks.keys
        places, slots = places_of(keys), self._blocks.slots(keys)
        blocks = Blocks(len(old.voxels))
        blocks.add(unique_keys(places >> 1))
        half = BLOCK // 2
        for corner in np.ndindex(2, 2, 2):
            some = np.flatnonzero(((places & 1) == corner).all(axis=1))
            target = blocks.slots(keys_of(places[some] >> 1))
            x, y, z = (slice(half * side, half * (side + 1)) for side in corner)
            grid = blocks.voxels.reshape(len(old.voxels), -1, BLOCK, BLOCK, BLOCK)
            grid[:, target, x, y, z] = _merged(old.voxels[:, slots[some]])
        self._blocks, self.voxel_m = blocks, 2 * self.voxel_m


@dataclass(frozen=True)
class _Image:
    """What a frame says: depth (H, W), 0 = void; along, cosine: of `_facing`; colour (H, W, 3) or None."""

    depth_m: NDArray[np.float32]
    along: NDArray[np.float32]
    cosine: NDArray[np.float32]
    rgb: NDArray[np.uint8] | None


def _slope(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Return by how much values (H, W) change from pixel to pixel: the smaller of both sides' steps.

    So an edge, or void beside a pixel, does not tilt it: the other side decides.
    """
    steps = np.diff(values, axis=axis)
    none = np.full_like(np.take(values, [0], axis=axis), np.inf)
    after, before = np.concatenate([steps, none], axis=axis), np.concatenate([none, steps], axis=axis)
    slope = np.where(np.abs(after) < np.abs(before), after, before)
    return np.where(np.isfinite(slope), slope, 0)


def _add(
    means: NDArray[np.float32],
    totals: NDArray[np.float32],
    at: NDArray[np.intp],
    weights: NDArray[np.float32],
    values: list[NDArray],
) -> None:
    """Take values (K, N) with weights (N,) at places (N,), none twice, into running means (K, all) of totals (all,)."""
    total = totals[at] + weights
    totals[at] = total
    share = weights / total
    for mean, value in zip(np.atleast_2d(means), values, strict=True):
        before = mean[at]
        mean[at] = before + (value - before) * share


def _merged(voxels: NDArray[np.float32]) -> NDArray[np.float32]:
    """(planes, N, VOXELS) -> (planes, N, half, half, half): means by weight, and the mean weight."""
    half = BLOCK // 2
    parts = voxels.reshape(len(voxels), -1, half, 2, half, 2, half, 2)
    out = np.zeros((*parts.shape[:2], half, half, half), dtype=np.float32)
    for weight, values in ((WEIGHT, [SDF]), (COLOUR_WEIGHT, [RED, RED + 1, RED + 2])):
        total = parts[weight].sum(axis=(2, 4, 6))
        sums = (parts[values] * parts[weight]).sum(axis=(3, 5, 7))
        out[values] = np.divide(sums, total, out=np.zeros_like(sums), where=total > 0)
        out[weight] = total / 8
    return out
