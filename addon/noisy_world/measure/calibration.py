# SPDX-License-Identifier: GPL-3.0-or-later
"""How depth lies on colour: by where edges of depth find edges of colour, over many frames.

Edges of depth are moved over those of colour, block by block; what fits best in all blocks together is a small rotation
between the two cameras and a difference of their focal lengths. Then depth's edges are turned by that, and it is done
again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics, rotation_from_rotvec
from ..images.measured_depth import completed_m
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
WIDE_PX = 320
BLOCKS_DOWN, BLOCKS_ACROSS = 3, 4
REACH = 0.075  # of the width: how far edges are moved
LOCAL_PX = 31  # side of the square in which an edge's strength is compared
GREY_FLOOR, STRONGEST = 4.0, 3.0
DEPTH_EDGE = 0.02, 0.10  # relative slopes of inverse depth in a pixel, from none to a whole edge
MARGIN_PX = 3
ZOOMS = np.arange(-0.12, 0.121, 0.02)
ROLLS_DEG = np.arange(-3.0, 3.01, 0.5)
LEAST_FRAMES = 6
MOST_VOID = 0.5  # share of the pixels: more, such as between a lidar's rows, makes edges of its own
LEAST_EDGES = 150.0  # pixels a frame
LEAST_GAIN = 1.15  # times what edges fit as they lie

ANGLE = "depth_beside_colour_deg"
ZOOM = "depth_larger_than_colour"

Maps: TypeAlias = tuple[Float32, Float32]


@dataclass(frozen=True)
class Calibration:
    """What edges say. angle_deg, zoom: figures. turn_deg: (3,) rotation vector, from where depth lies to colour."""

    angle_deg: Figure
    zoom: Figure
    turn_deg: Float64 | None = None


def calibration(footage: RecordingView, frames: Sequence[int], depth_later: int = 0) -> Calibration:
    """Return how depth lies on colour. frames: that are looked at. depth_later: by how many frames depth is late."""
    if not footage.has_depth:
        return _untold("there is no depth")
    pairs = [(frame, frame + depth_later) for frame in frames if 0 <= frame + depth_later < len(footage)]
    if len(pairs) < LEAST_FRAMES:
        return _untold("there are too few frames")
    camera = footage.camera.shrunk(WIDE_PX)
    colour: list[Maps] = []
    depth: list[Maps] = []
    void: list[float] = []
    for one, other in sorted(pairs):
        grey, depth_m = footage.look(one).grey, footage.look(other).depth_m
        if depth_m is not None:
            void.append(float(np.mean(depth_m <= 0)))
        if depth_m is not None and void[-1] < 1:
            colour.append(_colour_edges(grey, camera))
            depth.append(_depth_edges(depth_m, camera))
    if void and np.median(void) > MOST_VOID:
        return _untold("most of depth is void")
    edges = np.mean([sum(float(map_.sum()) for map_ in maps) for maps in depth]) if depth else 0.0
    if len(depth) < LEAST_FRAMES or edges < LEAST_EDGES * camera.width_px / WIDE_PX:
        return _untold("depth has too few edges")
    return _fitted(colour, depth, camera)


def _untold(why: str) -> Calibration:
    return Calibration(Figure.none(ANGLE, why), Figure.none(ZOOM, why))


def _fitted(colour: list[Maps], depth: list[Maps], camera: Intrinsics) -> Calibration:
    surfaces = _surfaces(colour, depth, camera)
    found, best, as_it_lies = _best(surfaces.sum(axis=0), camera, np.zeros(4), wide=True)
    if best <= 0 or not np.isfinite(best):
        return _untold("edges of depth meet no edges of colour")
    if best < LEAST_GAIN * as_it_lies:
        found = np.zeros(4)
    turned = [_turned(maps, found, camera) for maps in depth]
    surfaces = _surfaces(colour, turned, camera)
    more, _, _ = _best(surfaces.sum(axis=0), camera, np.zeros(4), wide=False)
    groups = blocks_of(len(depth))
    left_out = np.array(
        [_best(surfaces[groups != group].sum(axis=0), camera, more, wide=False)[0] for group in range(BLOCKS)]
    )
    whole = found + more
    errors = np.array([jackknifed(column) for column in left_out.T])
    angle_deg = float(np.degrees(np.linalg.norm(whole[:3])))
    along = whole[:3] / max(float(np.linalg.norm(whole[:3])), 1e-9)
    error_deg = float(np.degrees(np.linalg.norm(errors[:3] * along))) if angle_deg > 0 else 0.0
    least_deg = float(np.degrees(0.25 / camera.fx_px))  # a quarter of a pixel
    return Calibration(
        Figure.within(ANGLE, angle_deg, max(error_deg, least_deg), len(depth)),
        Figure.within(ZOOM, 0.0 - float(whole[3]), max(float(errors[3]), 1e-3), len(depth)),
        np.degrees(whole[:3]),
    )


def _colour_edges(grey: NDArray[np.uint8], camera: Intrinsics) -> Maps:
    """Return how strong edges across and along the rows are, (H, W) each, beside what is around them."""
    import cv2

    size_px = camera.width_px, camera.height_px
    small = np.asarray(cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.0), np.float32)
    across, along = cv2.Sobel(small, cv2.CV_32F, 1, 0), cv2.Sobel(small, cv2.CV_32F, 0, 1)
    around = cv2.blur(np.hypot(across, along), (LOCAL_PX, LOCAL_PX)) + GREY_FLOOR
    made = [np.minimum(np.abs(image) / around, STRONGEST).astype(np.float32) for image in (across, along)]
    return made[0], made[1]


def _depth_edges(depth_m: Float32, camera: Intrinsics) -> Maps:
    """Return how sure edges of depth across and along the rows are, (H, W) each, 0 to 1."""
    import cv2

    size_px = camera.width_px, camera.height_px
    small_m = completed_m(np.asarray(cv2.resize(depth_m, size_px, interpolation=cv2.INTER_NEAREST), np.float32))
    per_m = np.asarray(cv2.GaussianBlur(1 / np.maximum(small_m, 0.1), (0, 0), 1.0), np.float32)
    least, whole = DEPTH_EDGE
    made: list[Float32] = []
    for axes in ((1, 0), (0, 1)):
        slope = np.abs(cv2.Sobel(per_m, cv2.CV_32F, *axes)) / 8 / per_m
        edge = np.clip((slope - least) / (whole - least), 0, 1).astype(np.float32)
        edge[:MARGIN_PX] = edge[-MARGIN_PX:] = 0
        edge[:, :MARGIN_PX] = edge[:, -MARGIN_PX:] = 0
        made.append(edge)
    return made[0], made[1]


def _places(camera: Intrinsics) -> list[tuple[slice, slice]]:
    rows = np.linspace(0, camera.height_px, BLOCKS_DOWN + 1).astype(int)
    columns = np.linspace(0, camera.width_px, BLOCKS_ACROSS + 1).astype(int)
    return [
        (slice(rows[i], rows[i + 1]), slice(columns[j], columns[j + 1]))
        for i, j in product(range(BLOCKS_DOWN), range(BLOCKS_ACROSS))
    ]


def _reach_px(camera: Intrinsics) -> int:
    return max(4, round(REACH * camera.width_px))


def _surfaces(colour: list[Maps], depth: list[Maps], camera: Intrinsics) -> Float32:
    """Return how well the depth edges of each frame's blocks fit, moved by so many pixels: (N, blocks, 2R+1, 2R+1)."""
    import cv2

    reach = _reach_px(camera)
    places = _places(camera)
    side = 2 * reach + 1
    found = np.zeros((len(colour), len(places), side, side), np.float32)
    for number, (greys, edges) in enumerate(zip(colour, depth, strict=True)):
        for grey, edge in zip(greys, edges, strict=True):
            mean = float(grey.mean())
            around = np.pad(grey, reach, constant_values=mean)
            for place, (rows, columns) in enumerate(places):
                patch = np.ascontiguousarray(edge[rows, columns])
                if (weight := float(patch.sum())) < 1:
                    continue
                window = around[rows.start : rows.stop + 2 * reach, columns.start : columns.stop + 2 * reach]
                found[number, place] += cv2.matchTemplate(window, patch, cv2.TM_CCORR) - weight * mean
    return found


def _flow(camera: Intrinsics) -> Float64:
    """Return (blocks, 2, 4): how a rotation vector in radians and a zoom move the middle of each block, in pixels."""
    made: list[list[list[float]]] = []
    for rows, columns in _places(camera):
        x = ((columns.start + columns.stop - 1) / 2 - camera.cx_px) / camera.fx_px
        y = ((rows.start + rows.stop - 1) / 2 - camera.cy_px) / camera.fy_px
        across = [-x * y, 1 + x * x, -y, x]
        along = [-(1 + y * y), x * y, x, y]
        made.append([[camera.fx_px * value for value in across], [camera.fy_px * value for value in along]])
    return np.array(made)


def _best(surfaces: Float32, camera: Intrinsics, start: Float64, *, wide: bool) -> tuple[Float64, float, float]:
    """Return the rotation vector and the zoom (4,) at which edges fit best, how well they do, and how well at 0.

    surfaces: (blocks, 2R+1, 2R+1). wide: whether all that is within reach is tried first, or only what is near start.
    """
    import cv2

    reach, flow = _reach_px(camera), _flow(camera)
    smooth = [np.asarray(cv2.GaussianBlur(surface, (0, 0), 1.0), np.float32) for surface in surfaces]

    def fit(turns: Float64) -> Float64:
        """(..., 4) -> (...,), of two dimensions."""
        total = np.zeros(turns.shape[:-1])
        for surface, (across, along) in zip(smooth, flow, strict=True):
            x, y = (np.clip(turns @ way + reach, 0, 2 * reach).astype(np.float32) for way in (across, along))
            total += np.asarray(cv2.remap(surface, x, y, cv2.INTER_LINEAR)).reshape(total.shape)
        return total

    found = start
    if wide:
        shift_rad = (np.arange(-reach, reach + 1) * 0.75)[None, :] / np.array([[camera.fy_px], [camera.fx_px]])
        grids = np.meshgrid(shift_rad[0], shift_rad[1], np.radians(ROLLS_DEG), ZOOMS, indexing="ij")
        turns = np.stack([grid.reshape(len(grid), -1) for grid in grids], axis=-1)
        found = turns.reshape(-1, 4)[int(np.argmax(fit(turns)))]
    step = np.array([1.0 / camera.fy_px, 1.0 / camera.fx_px, np.radians(0.5), 0.01])
    around = np.array(list(product((-1, 0, 1), repeat=4)), np.float64)
    for _ in range(7):
        for _ in range(6):
            tried = found + around * step
            at = int(np.argmax(fit(tried[None])))
            if not around[at].any():
                break
            found = tried[at]
        step = step / 2
    return found, float(fit(found[None, None])[0, 0]), float(fit(np.zeros((1, 1, 4)))[0, 0])


def _turned(maps: Maps, turn: Float64, camera: Intrinsics) -> Maps:
    """Return edges as they lie after a rotation and a zoom."""
    import cv2

    if not turn.any():
        return maps
    matrix = camera.matrix
    zoom = np.diag([1 + turn[3], 1 + turn[3], 1.0])
    moved = matrix @ zoom @ rotation_from_rotvec(turn[:3]) @ np.linalg.inv(matrix)
    made = [np.asarray(cv2.warpPerspective(map_, moved, map_.shape[1::-1]), np.float32) for map_ in maps]
    return made[0], made[1]
