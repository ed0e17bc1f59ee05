# SPDX-License-Identifier: GPL-3.0-or-later
"""How late depth is against colour, exactly: planes of depth some frames later, where colour's motion puts them.

Over one frame both move alike, and how late one is shows by how motion changes; over several it has changed more, and
depth's noise is the same. What depth says that the motion is off by is put beside what each lateness would do, each
direction by how well depth and colour know it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import rotvec_from_rotation
from .depth_blocks import LEAST_BLOCKS, SIDE, DepthBlocks, PixelRays, as_matrix, blocks_in, seen_in
from .figure import BLOCKS, WITHIN, Figure, blocks_of, jackknifed
from .footage import Float64, RecordingView
from .motion import Followed, Steps, tukey

# Chosen, as all below.
LAG = 8  # frames from one to the other
MOST_PAIRS = 48
MOST_BLOCKS, PIXEL_STEP = 400, 4  # of a frame, and every how many of their pixels
MOST_FRAMES = 12  # of lateness that is looked for
LEAST_PAIRS = 12
NEAR, FINE = 1.5, 0.25  # frames around the best that are looked at closely, and in which steps
ROUNDS, SETTLED = 4, 0.1
UNKNOWN = (0.05,) * 3 + (0.1,) * 3  # radians and metres that a motion deviates by that colour does not tell
LOOSE = (0.1,) * 6  # likewise of depth, in directions that it does not tell
NEAREST = 0.05  # times its depth: a point does not come nearer
LEAST_OFF = 1e-5  # on the plane at 1


def lateness_of_planes(footage: RecordingView, steps: Steps, first: Figure) -> Figure:
    """Return by how many frames depth is late, by its index and not by its stamps; `first` where that is not told.

    first: a figure of it, from which on it is looked for.
    """
    gaps_s = np.diff(footage.stamps.rgb.seconds)
    passed = np.maximum(np.rint(gaps_s / float(np.median(gaps_s))), 1.0) if gaps_s.size else gaps_s
    runs = [_Run.of(steps, np.flatnonzero(steps.run == run), passed) for run in np.unique(steps.run)]
    count = sum(len(run.frames) for run in runs)
    pairs = _chosen(footage, runs)
    rays = PixelRays(footage)
    late, span = first.value or 0.0, float(min(MOST_FRAMES, count // 6))
    tried = np.arange(-span, span + 1) + late
    found: _Fit | None = None
    for _ in range(ROUNDS):
        settled = found is not None and found.close and abs(late - found.at) < SETTLED
        again = None if settled else _fit(footage, rays, pairs, tried, late)
        if again is None:
            break
        found, late = again, again.top(np.arange(len(again)))
        tried = late + np.arange(-NEAR, NEAR + FINE / 2, FINE)
    if found is None or not found.close:
        return first
    groups = blocks_of(len(found))
    left_out = np.array([found.top(np.flatnonzero(groups != group)) for group in range(BLOCKS)])
    # Pairs of neighbouring blocks share the motion of LAG frames, so that leaving one out changes too little.
    apart = (1 + LAG * BLOCKS / count) ** 0.5 * jackknifed(left_out)
    error = float(np.hypot(apart, 2 / WITHIN * found.error))
    if not error < 1.0:
        return first
    return Figure.within(first.name, late, error, len(found), "pairs of frames")


@dataclass(frozen=True)
class _Run:
    """Frames in a row. frames: (n + 1,) their numbers. at: (n + 1,) how many frames after the first, lost ones too.

    moves: (n, 6) by colour. spread: (n, 6, 6) their covariance. poses: (n + 1, 4, 4), the motion from the first on.
    """

    frames: NDArray[np.int64]
    at: Float64
    moves: Float64
    spread: Float64
    poses: Float64

    @classmethod
    def of(cls, steps: Steps, rows: NDArray[np.intp], passed: Float64) -> "_Run":
        frames = np.append(steps.frames[rows, 0], steps.frames[rows[-1], 1])
        moves = steps.move[rows]
        known = np.isfinite(moves).all(axis=1)
        places = np.arange(len(rows))
        if known.any():
            moves = np.stack([np.interp(places, places[known], column[known]) for column in moves.T], axis=1)
        moves = np.nan_to_num(moves)
        told_by = steps.followed or (None,) * len(steps)
        spread = np.array([_spread(told_by[row], steps.move[row]) for row in rows])
        poses = [np.eye(4)]
        for move in moves:
            poses.append(as_matrix(move) @ poses[-1])
        at = np.concatenate([[0.0], np.cumsum(passed[frames[:-1]])])
        return cls(frames, at, moves, spread, np.array(poses))

    def moved(self, one: float, other: float) -> Float64:
        """Return the motion (4, 4) between two places of `at`."""
        return self._pose(other) @ np.linalg.inv(self._pose(one))

    def covariance(self, one: float, other: float) -> Float64:
        """Return (6, 6) of that motion: steps deviate apart."""
        return self.spread[self._row(one) : self._row(other) + 1].sum(axis=0)

    def _row(self, place: float) -> int:
        return int(np.clip(np.searchsorted(self.at, place, side="right") - 1, 0, len(self.moves) - 1))

    def _pose(self, place: float) -> Float64:
        row = self._row(place)
        part = (place - self.at[row]) / (self.at[row + 1] - self.at[row])
        return as_matrix(part * self.moves[row]) @ self.poses[row]


def _spread(found: Followed | None, move: Float64) -> Float64:
    """Return the covariance (6, 6) of a motion by the features that tell it."""
    widest = np.diag(np.square(UNKNOWN))
    if found is None or found.inverse is None or not np.isfinite(move).all():
        return widest
    rays = np.concatenate([found.here, np.ones((len(found.here), 1))], axis=1)
    inverse, whole = found.inverse[:, None], as_matrix(move)
    seen = rays @ whole[:3, :3].T + inverse * move[3:]
    z = np.maximum(seen[:, 2:], NEAREST)
    off = found.there - seen[:, :2] / z
    weight = tukey(np.linalg.norm(off, axis=1), LEAST_OFF)
    ways = np.stack([*(np.cross(axis, seen) for axis in np.eye(3)), *(inverse * axis for axis in np.eye(3))], axis=-1)
    slopes = (ways[:, :2] - (seen[:, :2] / z)[..., None] * ways[:, 2:]) / z[..., None]
    square = float((weight[:, None] * off**2).sum() / (2 * weight.sum())) + LEAST_OFF**2
    normal = np.einsum("nki,n,nkj->ij", slopes, weight, slopes) / square
    return np.linalg.inv(normal + np.linalg.inv(widest))


@dataclass(frozen=True)
class _Pair:
    """Two frames LAG apart in a run. place: of the first in it. blocks: of that one's depth."""

    run: _Run
    place: int
    blocks: DepthBlocks


def _chosen(footage: RecordingView, runs: Sequence[_Run]) -> list[_Pair]:
    """Return pairs of frames, evenly."""
    every = [(run, place) for run in runs for place in range(len(run.frames) - LAG)]
    chosen = np.unique(np.linspace(0, len(every) - 1, MOST_PAIRS).astype(int)) if every else []
    pairs: list[_Pair] = []
    for run, place in (every[at] for at in chosen):
        blocks = blocks_in(footage.depth(int(run.frames[place])), SIDE)
        if len(blocks) >= LEAST_BLOCKS:
            pairs.append(_Pair(run, place, blocks.evenly(MOST_BLOCKS)))
    return pairs


@dataclass(frozen=True)
class _Fit:
    """How well each lateness fits. tried: (C,) frames. misfit: (C, N), of each pair, squares in the noise's units.

    at: the lateness by which planes were looked for.
    """

    at: float
    tried: Float64
    misfit: Float64

    def __len__(self) -> int:
        return self.misfit.shape[1]

    @property
    def close(self) -> bool:
        """Whether it is of steps of FINE frames."""
        return bool(np.ptp(self.tried[:2]) < 2 * FINE)

    def top(self, rows: NDArray[np.intp]) -> float:
        """Return where a parabola through the best and its neighbours has its top."""
        at, bend, tilt = self._parabola(rows)
        return float(self.tried[at] + (np.clip(tilt / bend, -1, 1) * np.ptp(self.tried[:2]) if bend > 0 else 0.0))

    @property
    def error(self) -> float:
        """Standard error of the best by the noise alone: a frame is in pairs with those LAG before and after it."""
        _, bend, _ = self._parabola(np.arange(len(self)))
        return float(FINE * (2 * LAG / bend) ** 0.5) if bend > 0 else np.inf

    def _parabola(self, rows: NDArray[np.intp]) -> tuple[int, float, float]:
        sums = self.misfit[:, rows].sum(axis=1)
        at = int(np.clip(sums.argmin(), 1, len(sums) - 2))
        before, here, after = sums[at - 1 : at + 2]
        return at, float(before - 2 * here + after), float(before - after) / 2


def _fit(footage: RecordingView, rays: PixelRays, pairs: Sequence[_Pair], tried: Float64, late: float) -> _Fit | None:
    """Return how well each lateness fits, by planes that were looked for where one of them has them."""
    columns: list[Float64] = []
    for run, place, blocks in ((pair.run, pair.place, pair.blocks) for pair in pairs):
        one, other = run.at[place], run.at[place + LAG]
        if one - tried.max() < 0 or other - tried.min() > run.at[-1]:
            continue
        moved = run.moved(one - late, other - late)
        seen = seen_in(blocks, moved, footage.depth(int(run.frames[place + LAG])), rays, PIXEL_STEP)
        if len(seen.rows) < LEAST_BLOCKS:
            continue
        normal, right = seen.equations()
        covariance = np.linalg.inv(normal + np.diag(np.power(LOOSE, -2.0)))
        off = covariance @ right  # by depth
        back = np.linalg.inv(moved)
        changes = [run.moved(one - each, other - each) @ back for each in tried]
        by_colour = np.concatenate(
            [rotvec_from_rotation([each[:3, :3] for each in changes]), [each[:3, 3] for each in changes]], axis=1
        )
        weight = np.linalg.inv(covariance + run.covariance(one - late, other - late))
        columns.append(np.einsum("ci,ij,cj->c", by_colour - off, weight, by_colour - off))
    return _Fit(late, tried, np.stack(columns, axis=1)) if len(columns) >= LEAST_PAIRS else None
