# SPDX-License-Identifier: GPL-3.0-or-later
"""How late depth is against colour, and an IMU's clock against the images', by the motion that both see.

No ground truth is used. Depth: the motion by colour is put into the equations by which depth images change, so many
frames later; where it explains most, there it belongs. IMU: its turns between the stamps of the images, at so many
seconds later, are turned onto those that the images show.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import rotvec_from_rotation
from ..core.trajectory import NS_PER_S, Trajectory
from ..trajectories.rig import RecordedImu
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float64, RecordingView
from .motion import TUKEY, Steps, beside

# Chosen, as all below.
MOST_FRAMES = 12  # of lateness that is looked for
MOST_S = 0.3  # likewise of an IMU's clock
LEAST_STEPS = 24
CLIPPED = 5.0  # standard deviations: motion beyond is none of the camera's
GAIN = 0.4, 2.5  # what depth's motion may be times colour's where both are of one scene
COARSE_S, FINE_S = 0.005, 0.002  # steps in which an IMU's clock is tried
LEAST_SURE_S = 0.02  # standard error of a clock that tells nothing
FITS = 0.5  # share of the turns' variance that an IMU has to explain

LATE = "depth_late_frames"
LATE_DRIFT = "depth_drift_ms_per_min"
CLOCK = "imu_clock_s"
CLOCK_BY_POSES = "imu_clock_by_poses_s"
CLOCK_DRIFT = {CLOCK: "imu_clock_drift_ppm", CLOCK_BY_POSES: "imu_clock_by_poses_drift_ppm"}
LEAST_SPAN_S = 20.0  # from the first to the last part of a recording, before a drift is told


def depth_lateness(steps: Steps, stamps_s: Float64) -> tuple[Figure, Figure]:
    """Return by how many frames depth is late: how much earlier colour shows what a frame's depth shows; and its drift.

    stamps_s: (N,) of colour. The drift is in milliseconds a minute.
    """
    moves, good = _colour_moves(steps)
    told = good & (np.abs(steps.normal).sum(axis=(1, 2)) > 0) & ~beside(steps.same_depth, steps.run)
    if told.sum() < LEAST_STEPS:
        why = "too few frames in a row show depth and features that move"
        return _untold(LATE, LATE_DRIFT, why)
    normal, right = steps.normal * told[:, None, None], steps.right * told[:, None]
    scale = np.trace(normal, axis1=1, axis2=2)
    even = 1 / np.maximum(scale, np.median(scale[told]))
    normal, right = normal * even[:, None, None], right * even[:, None]
    most = min(MOST_FRAMES, len(steps) // 4)
    blocks = np.arange(BLOCKS)

    def explained(lags: NDArray[np.int64], kept: NDArray[np.int64]) -> tuple[Float64, Float64]:
        """Return what motion of so much earlier explains, and its gain; of the same steps for all lags.

        NaN where these steps show no depth.
        """
        rows = _rows_within(steps.run, lags)
        rows = rows[np.isin(blocks_of(len(rows)), kept)]
        scores, gains = np.full((2, len(lags)), np.nan)
        if not normal[rows].any():
            return scores, gains
        here = np.einsum("nij->ij", normal[rows]), right[rows].sum(axis=0)
        for place, lag in enumerate(lags):
            move = moves[rows - lag]
            pushed = np.einsum("nij,nj->ni", normal[rows], move)
            system = np.zeros((7, 7))
            system[0, 0] = np.einsum("ni,ni->", pushed, move)
            system[0, 1:] = system[1:, 0] = pushed.sum(axis=0)
            system[1:, 1:] = here[0]
            side = np.concatenate([[np.einsum("ni,ni->", right[rows], move)], here[1]])
            system += 1e-9 * np.trace(system) / 7 * np.eye(7)
            found = np.linalg.solve(system, side)
            constant = np.linalg.solve(system[1:, 1:], side[1:])
            gains[place] = found[0]
            scores[place] = found @ side - constant @ side[1:] if found[0] > 0 else 0.0
        return scores, gains

    lags = np.arange(-most, most + 1)
    if len(_rows_within(steps.run, lags)) < LEAST_STEPS // 2:
        return _untold(LATE, LATE_DRIFT, "runs of frames are too short")
    scores, _ = explained(lags, blocks)
    best = int(lags[int(scores.argmax())])
    near, at, gains = lags, 0, np.zeros(1)
    for _ in range(3):  # with more steps, around the best
        near = np.arange(best - 2, best + 3)
        scores, gains = explained(near, blocks)
        at = int(scores.argmax())
        if at not in (0, 4):
            break
        best = int(near[at])
    if scores.max() <= 0 or at in (0, 4) or not GAIN[0] < gains[at] < GAIN[1]:
        return _untold(LATE, LATE_DRIFT, "motion of depth fits that of colour nowhere")
    value = _top(near, scores)
    left_out = np.array([_top(near, explained(near, blocks[blocks != block])[0]) for block in blocks])
    error = jackknifed(left_out)
    if not error < 1.0:
        return _untold(LATE, LATE_DRIFT, "the motion is too even")
    rows = _rows_within(steps.run, near)
    rate_hz = 1 / float(np.median(np.diff(stamps_s)))
    each = np.array([_top(near, explained(near, blocks[blocks == block])[0]) for block in blocks])
    drift = _drift(LATE_DRIFT, each, stamps_s[steps.frames[rows, 0]], 6e4 / rate_hz)
    return Figure.within(LATE, value, error, int(told.sum()), "steps"), drift


def _untold(name: str, drift: str, why: str) -> tuple[Figure, Figure]:
    return Figure.none(name, why), Figure.none(drift, why)


def _drift(name: str, each: Float64, at_s: Float64, scale: float) -> Figure:
    """Return how fast a value changes, times `scale` a second. each: (BLOCKS,) of the blocks. at_s: (N,) of samples."""
    blocks = blocks_of(len(at_s))
    middle_s = np.array(
        [at_s[blocks == block].mean() if (blocks == block).any() else np.nan for block in range(BLOCKS)]
    )
    if not np.isfinite(middle_s).all() or np.ptp(middle_s) < LEAST_SPAN_S:
        return Figure.none(name, f"parts of the recording are less than {LEAST_SPAN_S:g} s apart")
    if not np.isfinite(each).all():
        return Figure.none(name, "some parts of the recording do not tell it")
    off_s = middle_s - middle_s.mean()
    slope = float(off_s @ each / (off_s @ off_s))
    rest = each - each.mean() - slope * off_s
    error = float(np.sqrt(rest @ rest / (BLOCKS - 2) / (off_s @ off_s)))
    return Figure.within(name, scale * slope, scale * error, len(at_s), "steps")


def _colour_moves(steps: Steps) -> tuple[Float64, NDArray[np.bool_]]:
    """Return motion by colour (M, 6) from its middle, clipped, with gaps bridged, and where it is told, (M,)."""
    good = np.isfinite(steps.move).all(axis=1) & ~beside(steps.same, steps.run)
    if good.sum() < 2:
        return np.zeros_like(steps.move), good
    middle = np.median(steps.move[good], axis=0)
    spread = 1.4826 * np.median(np.abs(steps.move[good] - middle), axis=0) + 1e-9
    moves = np.clip(np.nan_to_num(steps.move), middle - CLIPPED * spread, middle + CLIPPED * spread) - middle
    rows = np.arange(len(moves))
    return np.stack([np.interp(rows, rows[good], column[good]) for column in moves.T], axis=1), good


def _rows_within(run: NDArray[np.int64], lags: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps for which all lags are in the same run."""
    rows = np.arange(len(run))
    for end in (int(lags.min()), int(lags.max())):
        other = rows - end
        inside = (other >= 0) & (other < len(run))
        rows = rows[inside]
        rows = rows[run[rows] == run[other[inside]]]
    return rows


def _top(places: NDArray[np.int64], scores: Float64) -> float:
    """Return where a parabola through the highest score and its neighbours has its top; NaN where scores are."""
    if not np.isfinite(scores).all():
        return np.nan
    at = int(np.clip(scores.argmax(), 1, len(scores) - 2))
    before, here, after = scores[at - 1 : at + 2]
    bend = before - 2 * here + after
    return float(places[at] + (np.clip((before - after) / (2 * bend), -1, 1) if bend < 0 else 0.0) * np.ptp(places[:2]))


# --- the clock of an IMU ---


def imu_clock(footage: RecordingView, steps: Steps) -> tuple[Figure, Figure]:
    """Return the IMU's clock minus the images', in seconds, and how much faster it goes, in millionths."""
    if footage.imu is None:
        return _untold(CLOCK, CLOCK_DRIFT[CLOCK], "there is no IMU")
    stamps_s = footage.stamps.rgb.seconds
    turns = -steps.move[:, :3]  # of the camera, not of the world before it
    good = np.isfinite(turns).all(axis=1) & ~beside(steps.same, steps.run)
    one_s, other_s = (stamps_s[steps.frames[good, side]] for side in (0, 1))
    return _clock(CLOCK, footage.imu, turns[good], one_s, other_s)


def imu_clock_by_poses(imu: RecordedImu | None, path: Trajectory, stamps_s: Float64) -> tuple[Figure, Figure]:
    """Return the IMU's clock minus that of the poses, in seconds, and how much faster it goes, in millionths.

    stamps_s: (N,) of the poses. No image is read.
    """
    if imu is None:
        return _untold(CLOCK_BY_POSES, CLOCK_DRIFT[CLOCK_BY_POSES], "there is no IMU")
    known = np.flatnonzero(path.known)
    known = known[np.concatenate([[True], np.diff(stamps_s[known]) > 0])] if len(known) else known
    if len(known) < LEAST_STEPS:
        return _untold(CLOCK_BY_POSES, CLOCK_DRIFT[CLOCK_BY_POSES], "few poses are known")
    turned = path.c2w[known, :3, :3]
    turns = rotvec_from_rotation(np.swapaxes(turned[:-1], 1, 2) @ turned[1:])
    return _clock(CLOCK_BY_POSES, imu, turns, stamps_s[known][:-1], stamps_s[known][1:])


def _clock(name: str, imu: RecordedImu, turns: Float64, one_s: Float64, other_s: Float64) -> tuple[Figure, Figure]:
    """Return figures of the IMU's clock and of its drift.

    turns: (N, 3) of the camera in its axes, radians, between two times each.
    """
    turned = _Gyro(imu)
    measured = (one_s - MOST_S > turned.first_s) & (other_s + MOST_S < turned.last_s)
    if measured.sum() < LEAST_STEPS:
        return _untold(
            name, CLOCK_DRIFT[name], "too few frames in a row show how the camera turns while the IMU measures"
        )
    turns, one_s, other_s = turns[measured], one_s[measured], other_s[measured]
    said = (imu.rig.rgb.robot_from_sensor[:3, :3].T @ imu.samples.imu.robot_from_sensor[:3, :3]).T
    found = _clock_with(name, turns, turned, (one_s, other_s), said)
    # Where the files' axes do not fit, those that fit best.
    return found if found[0].value is not None else _clock_with(name, turns, turned, (one_s, other_s), None)


def _clock_with(
    name: str, turns: Float64, turned: "_Gyro", times_s: tuple[Float64, Float64], axes: Float64 | None
) -> tuple[Figure, Figure]:
    weights = np.ones(len(turns))
    share, best_s = 0.0, 0.0

    def left(later_s: float, rows: NDArray[np.int64] | slice = slice(None)) -> tuple[float, float, Float64]:
        by_imu = turned.between(times_s[0][rows] + later_s, times_s[1][rows] + later_s)
        return _misfit(turns[rows], by_imu, weights[rows], axes)

    for _ in range(2):  # again without the turns that are wrong
        coarse_s = np.arange(-MOST_S, MOST_S + 1e-9, COARSE_S)
        best_s = float(coarse_s[int(np.argmin([left(later_s)[0] for later_s in coarse_s]))])
        _, share, off = left(best_s)
        spread = 1.4826 * float(np.median(off)) + 1e-9
        weights = np.clip(1 - (off / (TUKEY * spread)) ** 2, 0, None) ** 2
    if share < FITS:
        return _untold(name, CLOCK_DRIFT[name], "its turns fit those of the images nowhere")
    if abs(best_s) > MOST_S - 2 * COARSE_S:
        return _untold(name, CLOCK_DRIFT[name], f"it is more than {MOST_S:g} s away, if it is of these images")
    fine_s = np.asarray(best_s + np.arange(-6, 7) * FINE_S, np.float64)
    blocks = blocks_of(len(turns))
    value = _bottom(fine_s, [left(later_s)[0] for later_s in fine_s])
    kept = [np.flatnonzero(blocks != block) for block in range(BLOCKS)]
    left_out = np.array([_bottom(fine_s, [left(later_s, rows)[0] for later_s in fine_s]) for rows in kept])
    error = jackknifed(left_out)
    if not error < LEAST_SURE_S:
        return _untold(name, CLOCK_DRIFT[name], "the camera turns too evenly")
    each: list[float] = []
    for block in range(BLOCKS):
        rows, at_s = np.flatnonzero(blocks == block), value
        for _ in range(2):  # again around where the part itself has it
            if not np.isfinite(at_s):
                break
            near_s = np.asarray(at_s + np.arange(-6, 7) * FINE_S, np.float64)
            at_s = _bottom(near_s, [left(later_s, rows)[0] for later_s in near_s])
        each.append(at_s)
    drift = _drift(CLOCK_DRIFT[name], np.array(each), times_s[0], 1e6)
    return Figure.within(name, value, error, len(turns), "steps"), drift


class _Gyro:
    """How an IMU turned since its first sample, in its own axes. first_s, last_s: of its samples, by its clock."""

    def __init__(self, imu: RecordedImu) -> None:
        samples = imu.samples
        at_s = samples.stamps_ns / NS_PER_S
        rates = samples.rate_rad_s
        self._at_s = at_s
        steps_s = np.diff(at_s)[:, None]
        self._turned = np.concatenate([np.zeros((1, 3)), np.cumsum((rates[1:] + rates[:-1]) / 2 * steps_s, axis=0)])
        self.first_s, self.last_s = float(at_s[0]), float(at_s[-1])

    def between(self, one_s: Float64, other_s: Float64) -> Float64:
        """Return the turns (N, 3) between times (N,) each, radians; small ones, so that their axes add."""
        ends = [
            np.stack([np.interp(times_s, self._at_s, column) for column in self._turned.T], axis=1)
            for times_s in (one_s, other_s)
        ]
        return ends[1] - ends[0]


def _misfit(turns: Float64, by_imu: Float64, weights: Float64, axes: Float64 | None) -> tuple[float, float, Float64]:
    """Turn (N, 3) vectors of the IMU onto the camera's, and take a constant for its bias.

    axes: (3, 3), by which rows of the one are multiplied for the other; None for those that fit best (Kabsch, 1976).
    Return the weighted mean of what is left, the share of the variance that is explained, and what is left of each.
    """
    whole = weights.sum()
    one, other = (vectors - (weights[:, None] * vectors).sum(axis=0) / whole for vectors in (turns, by_imu))
    if axes is None:
        left, _, right = np.linalg.svd((other * weights[:, None]).T @ one)
        axes = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    off = one - other @ axes
    squares = (off**2).sum(axis=1)
    mean = float((weights * squares).sum() / whole)
    variance = float((weights * (one**2).sum(axis=1)).sum() / whole)
    return mean, 1 - mean / max(variance, 1e-18), np.sqrt(squares)


def _bottom(places: Float64, misfits: Sequence[float]) -> float:
    """Return the lowest place of a parabola that is fitted to misfits; NaN where there is none."""
    if not (np.isfinite(places).all() and np.isfinite(misfits).all()):
        return np.nan
    middle = places[len(places) // 2]
    bend, slope, _ = np.polyfit(places - middle, misfits, 2)
    return float(middle + np.clip(-slope / (2 * bend), places[0] - middle, places[-1] - middle)) if bend > 0 else np.nan
