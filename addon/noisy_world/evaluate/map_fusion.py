# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps fused along a path: a volume of signed distances with colours, and the surface in it.

A signed distance volume with colours, fused of depth images (Curless and Levoy 1996, KinectFusion 2011).

Each voxel near a surface keeps the mean of its signed distances, positive in front of the surface, as the depth images
that see it say, each with the plane that it sees there, weighted by how directly it sees it.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..scenes.polygon_mesh import NEUTRAL_GREY, Mesh

# Sparse blocks of voxels, and where each block lies in memory.


BLOCK = 8  # voxels along a block's edge; chosen
VOXELS = BLOCK**3

_BITS = 21  # of a coordinate in a key: a million blocks in each direction from the origin
_HALF = 1 << (_BITS - 1)
_MASK = (1 << _BITS) - 1

Keys: TypeAlias = NDArray[np.int64]
"""Three whole coordinates as one number, in their order."""


def keys_of(places: NDArray[np.integer]) -> Keys:
    """(N, 3) whole coordinates -> (N,) keys. Raises ValueError beyond a million in any direction."""
    places = np.asarray(places, dtype=np.int64)
    if places.size and (places.min() < -_HALF or places.max() >= _HALF):
        raise ValueError("places are within a million of the origin")
    x, y, z = (places + _HALF).T
    return (x << (2 * _BITS)) | (y << _BITS) | z


def places_of(keys: Keys) -> NDArray[np.int64]:
    """(N,) keys -> (N, 3) whole coordinates."""
    return np.stack([keys >> (2 * _BITS), (keys >> _BITS) & _MASK, keys & _MASK], axis=1) - _HALF


def unique_keys(places: NDArray[np.integer]) -> Keys:
    """Return the keys of places (N, 3), sorted, each once."""
    return np.unique(keys_of(places))


def find(keys: Keys, wanted: Keys) -> NDArray[np.intp]:
    """Return where in sorted keys each wanted one stands; -1 where it is not there."""
    if not len(keys):
        return np.full(wanted.shape, -1, dtype=np.intp)
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)


class Blocks:
    """Blocks of voxels by their keys, with values in planes: voxels (planes, slots, VOXELS) float32, first all zero."""

    def __init__(self, planes: int) -> None:
        """Begin without a block."""
        self._keys: Keys = np.empty(0, dtype=np.int64)
        self._slots = np.empty(0, dtype=np.intp)
        self.voxels = np.zeros((planes, 0, VOXELS), dtype=np.float32)

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def keys(self) -> Keys:
        """All keys, sorted."""
        return self._keys

    def slots(self, keys: Keys) -> NDArray[np.intp]:
        """Return the slots of blocks; -1 where there is none."""
        at = find(self._keys, keys)
        return np.where(at >= 0, self._slots[at], -1) if len(self) else at

    def missing(self, keys: Keys) -> Keys:
        """Return those of sorted keys that have no block."""
        return keys[find(self._keys, keys) < 0]

    def add(self, new: Keys) -> None:
        """Add blocks, sorted and none of them there."""
        count = len(self)
        planes, slots = self.voxels.shape[:2]
        if count + len(new) > slots:  # by a half more: few copies, and little that stays empty
            room = np.zeros((planes, max(count + len(new), count * 3 // 2), VOXELS), dtype=np.float32)
            room[:, :count] = self.voxels[:, :count]
            self.voxels = room
        at = np.searchsorted(self._keys, new)
        self._slots = np.insert(self._slots, at, np.arange(count, count + len(new)))
        self._keys = np.insert(self._keys, at, new)


# The surface in a volume of signed distances, by surface nets (Gibson 1998).
#
# A cell lies between eight voxels' centres. Where their signs differ it has a vertex, in the middle of the points at
# which its edges meet the surface; each such edge gives a quad of the four cells around it.


_AT_ONCE = 1024  # blocks, whose arrays with their neighbours' first layers take 60 MB
_CORNERS = tuple(product((0, 1), repeat=3))
_EDGES = tuple((corner, axis) for axis in range(3) for corner in _CORNERS if corner[axis] == 0)

SDF, WEIGHT, COLOUR_WEIGHT, RED = range(4)
"""Planes of a voxel: distance in metres, the weights of the distance and of the colour, and three of colour."""


def surface_of(blocks: Blocks, voxel_m: float, origin_m: NDArray[np.float64]) -> Mesh | None:
    """Return the surface as quads that face where the distance is positive; None where there is none.

    Planes of the voxels: distance, its weight, the colour's weight, colours of 0 to 255. origin_m: (3,), the corner of
    block (0, 0, 0). Only cells of which all eight voxels were seen have a vertex. Colours are left out where no vertex
    has one; a vertex without one is grey.
    """
    cells, points, colours, edges = [], [], [], []
    for first in range(0, len(blocks), _AT_ONCE):
        keys = blocks.keys[first : first + _AT_ONCE]
        grid = _with_neighbours(blocks, keys)
        origins = places_of(keys) * BLOCK
        where, at, colour = _vertices(grid)
        cells.append(keys_of(origins[where[0]] + np.stack(where[1:], axis=1)))
        points.append((origins[where[0]] + np.stack(where[1:], axis=1) + at + 0.5) * voxel_m + origin_m)
        colours.append(colour)
        edges.append(_crossed(grid, origins))
    if not cells:
        return None
    all_cells = np.concatenate(cells)
    order = np.argsort(all_cells)
    quads = _quads(all_cells[order], np.concatenate(edges))
    used, corners = np.unique(quads, return_inverse=True)
    if not len(used):
        return None
    kept = order[used]
    rgb = np.concatenate(colours)[kept]
    coloured = rgb[:, 0] >= 0
    return Mesh(
        np.concatenate(points)[kept],
        np.where(coloured[:, None], rgb / np.float32(255), np.float32(NEUTRAL_GREY)) if coloured.any() else None,
        corners.reshape(-1).astype(np.int32),
        np.arange(0, 4 * len(quads), 4, dtype=np.int32),
    )


def _with_neighbours(blocks: Blocks, keys: Keys) -> NDArray[np.float32]:
    """Return blocks' voxels (planes, N, 9, 9, 9) with the first layers of the blocks after them, zeros without one."""
    planes = len(blocks.voxels)
    grid = np.zeros((planes, len(keys), *[BLOCK + 1] * 3), dtype=np.float32)
    voxels = blocks.voxels.reshape(planes, -1, BLOCK, BLOCK, BLOCK)
    places = places_of(keys)
    for side in _CORNERS:
        slots = blocks.slots(keys_of(places + side))
        there = np.flatnonzero(slots >= 0)
        target = tuple(slice(BLOCK, None) if s else slice(0, BLOCK) for s in side)
        origin = tuple(slice(0, 1) if s else slice(0, BLOCK) for s in side)
        grid[(slice(None), there, *target)] = voxels[(slice(None), slots[there], *origin)]
    return grid


def _vertices(
    grid: NDArray[np.float32],
) -> tuple[tuple[NDArray[np.intp], ...], NDArray[np.float32], NDArray[np.float32]]:
    """Return cells with a vertex (block, i, j, k), where in them it is (N, 3), and colours (N, 3), -1 without one."""
    known, inside = grid[WEIGHT] > 0, grid[SDF] < 0
    count = np.zeros((grid.shape[1], BLOCK, BLOCK, BLOCK), dtype=np.int8)
    whole = np.ones(count.shape, dtype=bool)
    for corner in _CORNERS:
        part = (slice(None), *(slice(c, c + BLOCK) for c in corner))
        count += inside[part]
        whole &= known[part]
    where = np.nonzero(whole & (count > 0) & (count < 8))
    block, *cell = where
    place = np.zeros((3, len(block)), dtype=np.float32)
    colour = np.zeros_like(place)
    crossings, coloured = np.zeros((2, len(block)), dtype=np.float32)
    for corner, axis in _EDGES:
        start = [c + offset for c, offset in zip(cell, corner, strict=True)]
        end = [c + (a == axis) for a, c in enumerate(start)]
        here, there = grid[(SDF, block, *start)], grid[(SDF, block, *end)]
        rows = np.flatnonzero((here < 0) != (there < 0))
        share = here[rows] / (here[rows] - there[rows])
        crossings[rows] += 1
        for a in range(3):
            place[a, rows] += share if a == axis else corner[a]
        for ends, part in ((start, 1 - share), (end, share)):
            at = (block[rows], *(e[rows] for e in ends))
            weight = (part + np.float32(1e-3)) * (grid[(COLOUR_WEIGHT, *at)] > 0)
            coloured[rows] += weight
            for channel in range(3):
                colour[channel, rows] += weight * grid[(RED + channel, *at)]
    colour = np.where(coloured > 0, colour / np.where(coloured > 0, coloured, 1), -1)
    return where, (place / crossings).T, colour.astype(np.float32).T


def _crossed(grid: NDArray[np.float32], origins: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the edges of voxels that meet the surface (N, 5): voxel, axis, and whether the distance falls along it."""
    inside, known = grid[SDF] < 0, grid[WEIGHT] > 0
    first = (slice(None), *[slice(0, BLOCK)] * 3)
    crossings = []
    for axis in range(3):
        last = tuple(slice(1, None) if a == axis else slice(0, BLOCK) for a in range(3))
        last = (slice(None), *last)
        block, *place = np.nonzero((inside[first] != inside[last]) & known[first] & known[last])
        falls = inside[last][(block, *place)]
        rows = origins[block] + np.stack(place, axis=1)
        crossings.append(np.column_stack([rows, np.full(len(rows), axis), falls]))
    return np.concatenate(crossings)


def _quads(cells: Keys, edges: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return quads (Q, 4) of places in sorted cells: for each edge the four cells around it, if all have a vertex."""
    quads = []
    for axis in range(3):
        rows = edges[edges[:, 3] == axis]
        second, third = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
        # Around an edge, as seen from its end, counter-clockwise.
        around = [rows[:, :3] - second - third, rows[:, :3] - third, rows[:, :3], rows[:, :3] - second]
        corners = np.stack([find(cells, keys_of(places)) for places in around], axis=1)
        turned = np.where(rows[:, 4:] == 1, corners[:, ::-1], corners)
        quads.append(turned[(corners >= 0).all(axis=1)])
    return np.concatenate(quads)


TRUNCATION = 4  # voxels: how far from a surface distances are kept; chosen
MOST_BLOCKS = 60_000  # 740 MB with colours
REACH = 1_000_000  # 20 km with voxels of 2 cm
_SIDEWAYS = 4  # depths: how far to the side a pixel can see; more than any pinhole camera that is used
_LEAST_FACING = 0.05  # the cosine of 87 degrees: what is seen along it is still better than nothing; chosen
_VOLUME_AT_ONCE = 2048  # blocks: a million voxels, whose arrays stay small

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
        for first in range(0, len(keys), _VOLUME_AT_ONCE):
            some = slice(first, first + _VOLUME_AT_ONCE)
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


# Fuses the frames of a path to a map.


VOXEL_M = 0.02
FAR_M = 10.0


class SeenFrame(Protocol):
    """A frame: colour (H, W, 3) uint8 RGB, planar depth (H, W) in metres with 0 = void."""

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Depth."""
        ...


@dataclass(frozen=True)
class Fused:
    """A map that was fused.

    mesh: None where no frame saw anything. voxel_m: the edge of its voxels, more than was asked for where those would
    have taken too much memory. frames: how many were fused. excluded: how many have a pose, but one that is kilometres
    away from the first.
    """

    mesh: Mesh | None
    voxel_m: float
    frames: int
    excluded: int = 0


def fuse(
    frames: Iterable[SeenFrame],
    poses: Iterable[NDArray[np.float64] | None],
    camera: Intrinsics,
    *,
    voxel_m: float = VOXEL_M,
    far_m: float = FAR_M,
    most_blocks: int = MOST_BLOCKS,
    stopped: Callable[[], bool] = lambda: False,
) -> Fused:
    """Fuse frames along a path; a frame whose pose is None is left out, and its images are not read.

    poses: (4, 4) camera-to-world of each frame, OpenCV axes. far_m: depth beyond is left out. most_blocks: bounds the
    memory (12 kB each). stopped: asked before each frame. Colour and depth are taken as seen from one pose.
    Raises ValueError where frames and poses differ in number, or a frame is not of the camera's size.
    """
    volume = ColourVolume(camera, voxel_m, most_blocks=most_blocks)
    count, excluded = 0, 0
    for frame, c2w in zip(frames, poses, strict=True):
        if stopped():
            break
        if c2w is not None:
            pose = np.asarray(c2w, dtype=np.float64)
            within = volume.integrate(frame.depth_m, pose, frame.rgb, far_m=far_m)
            count, excluded = count + within, excluded + (not within)
    return Fused(volume.surface(), volume.voxel_m, count, excluded)
