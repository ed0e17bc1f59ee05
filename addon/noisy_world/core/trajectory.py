# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's path through a scene: poses with time stamps, and what of them is meaningful."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_HALF_EVEN, Decimal
from functools import cached_property
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .curve import BodyMotion, Curve, NaturalSpline, SplineCurve, WarpedCurve, motion_of
from .errors import NoisyWorldError
from .geometry import (
    invert_pose,
    opencv_from_blender_c2w,
    opencv_from_ned_c2w,
    opencv_from_robot_c2w,
    pose,
    quat_wxyz_from_rotation,
)

Direction: TypeAlias = Literal["c2w", "w2c"]
Axes: TypeAlias = Literal["opencv", "opengl", "robot", "ned"]

DIRECTIONS: tuple[str, ...] = get_args(Direction)
AXES: tuple[str, ...] = get_args(Axes)

MOST_POSES = 1_000_000
"""Of a path that is made or resampled: 14 hours at 20 Hz, 128 MB of poses."""

# Stamps in files are rounded to microseconds, so resampling keeps a last frame that is late by that much.
_STAMP_TOLERANCE_S = 1e-6


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a camera, one for each frame; the arrays are copied and read-only.

    c2w: (N, 4, 4) float64, N >= 1, rigid, metres, from OpenCV's camera axes (x right, y down, z forward) to the world.
    stamps_s: (N,) float64, seconds, strictly increasing.
    notes: what a user should know about how the path was read, one sentence each.
    posed: (N,) bool, whether a frame's pose is known; None where all are. An unknown one has any pose in c2w.
    curve: the path in continuous time that the poses lie on; None is the one through them. independent: why there is
    nothing between the poses, "" where there is. shots: (N,) int, equal where one camera takes the poses; between two
    that differ the view cuts from one camera to another. None where it never does.
    Raises ValueError for other shapes, values that are not finite and stamps that do not increase.
    """

    c2w: NDArray[np.float64]
    stamps_s: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    posed: NDArray[np.bool_] | None = None
    curve: Curve | None = None
    independent: str = ""
    shots: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        c2w = np.array(self.c2w, dtype=np.float64, order="C")
        stamps_s = np.array(self.stamps_s, dtype=np.float64)
        if c2w.ndim != 3 or c2w.shape[1:] != (4, 4) or len(c2w) == 0:
            raise ValueError(f"a trajectory is (N, 4, 4) with N >= 1, not {c2w.shape}")
        if stamps_s.shape != (len(c2w),):
            raise ValueError(f"{len(c2w)} poses need as many time stamps, not {stamps_s.shape}")
        if not (np.isfinite(c2w).all() and np.isfinite(stamps_s).all()):
            raise ValueError("a trajectory holds finite numbers only")
        if np.any(np.diff(stamps_s) <= 0.0):
            raise ValueError("time stamps must increase from frame to frame")
        posed = None if self.posed is None or np.all(self.posed) else np.array(self.posed, dtype=np.bool_)
        if posed is not None and posed.shape != (len(c2w),):
            raise ValueError(f"{len(c2w)} poses need as many words on whether they are known, not {posed.shape}")
        if self.shots is not None and self.shots.shape != (len(c2w),):
            raise ValueError(f"{len(c2w)} poses need as many shots, not {self.shots.shape}")
        c2w.setflags(write=False)
        stamps_s.setflags(write=False)
        object.__setattr__(self, "posed", posed)
        object.__setattr__(self, "c2w", c2w)
        object.__setattr__(self, "stamps_s", stamps_s)

    def __len__(self) -> int:
        return len(self.c2w)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) bool: whether a frame's pose is known."""
        return np.ones(len(self), dtype=np.bool_) if self.posed is None else self.posed

    def cuts_between(self, one: int, other: int) -> bool:
        """Tell whether two frames are seen by two cameras."""
        return self.shots is not None and bool(self.shots[one] != self.shots[other])

    def at(self, rows: Sequence[int] | slice | NDArray[np.integer], stamps_s: NDArray[np.float64]) -> "Trajectory":
        """Return the poses of some rows under other time stamps (M,); without the notes."""
        posed = None if self.posed is None else self.posed[rows]
        shots = None if self.shots is None else self.shots[rows]
        return Trajectory(self.c2w[rows], stamps_s, posed=posed, independent=self.independent, shots=shots)

    def followed(self, rows: NDArray[np.integer]) -> "Trajectory":
        """Return the poses of some rows (M,), M <= N, under the first M stamps; without the notes.

        Between them the path is followed as fast as that takes: where every other pose is left out, twice as fast.
        """
        stamps_s = self.stamps_s[: len(rows)]
        clock = NaturalSpline(stamps_s, self.stamps_s[rows, None])
        return replace(self.at(rows, stamps_s), curve=WarpedCurve(self.continuous, clock))

    @cached_property
    def continuous(self) -> Curve:
        """The path in continuous time; where no pose is known, it stands still."""
        if self.curve is not None:
            return self.curve
        known = self.known if self.known.any() else np.arange(len(self)) == 0
        return SplineCurve(self.c2w[known], self.stamps_s[known])

    def pose_at(self, time_s: float) -> NDArray[np.float64]:
        """Return the pose (4, 4) at a time; at a frame's stamp it is the frame's own, to the bit.

        Raises NoisyWorldError between poses that are independent of one another, and beside one that is unknown.
        """
        row = int(np.searchsorted(self.stamps_s, time_s))
        if row < len(self) and self.stamps_s[row] == time_s:
            return self.c2w[row]
        if self.independent:
            raise NoisyWorldError(f"there is no pose at {time_s:g} s, between the frames: {self.independent}")
        if not self.known_at(time_s):
            raise NoisyWorldError(f"there is no pose at {time_s:g} s, beside a frame whose pose is unknown")
        return self.continuous.pose_at(time_s)

    def poses_at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses (N, 4, 4) at times (N,), on the path in continuous time.

        Raises NoisyWorldError as `pose_at` does.
        """
        if len(times_s) and (self.independent or not self.known_at(times_s).all()):
            return np.stack([self.pose_at(float(time_s)) for time_s in times_s])  # which says where there is none
        return self.continuous.pose_at(times_s)

    def known_at(self, times_s: ArrayLike) -> NDArray[np.bool_]:
        """(...) seconds -> (...) bool: whether the poses before and after are known; at a stamp, the pose itself."""
        times_s = np.asarray(times_s, dtype=np.float64)
        before = np.clip(np.searchsorted(self.stamps_s, times_s, side="right") - 1, 0, len(self) - 1)
        after = np.clip(np.searchsorted(self.stamps_s, times_s), 0, len(self) - 1)
        return self.known[before] & self.known[after]


def evenly_stamped(c2w: ArrayLike, rate_hz: float = 20.0) -> Trajectory:
    """(N, 4, 4) c2w -> a trajectory with stamps 0, 1 / rate_hz, 2 / rate_hz, ... seconds."""
    c2w = np.asarray(c2w, dtype=np.float64)
    return Trajectory(c2w, np.arange(len(c2w)) / checked_rate(rate_hz))


def subsample(trajectory: Trajectory, start: int = 0, stop: int | None = None, every: int = 1) -> Trajectory:
    """Frames start, start + every, ... before stop (None: to the end), with their own stamps.

    Raises ValueError for a negative start or stop, for every < 1 and where no frame is left.
    """
    if start < 0 or every < 1 or (stop is not None and stop < 0):
        raise ValueError(f"start and stop must be >= 0 and every >= 1, not {start}, {stop} and {every}")
    chosen = slice(start, stop, every)
    if len(trajectory.stamps_s[chosen]) == 0:
        raise ValueError(f"no frame is left of {len(trajectory)} with start {start} and stop {stop}")
    path = trajectory.at(chosen, trajectory.stamps_s[chosen])
    curve = None if trajectory.independent else trajectory.continuous
    return replace(path, notes=trajectory.notes, curve=curve)


def resample(trajectory: Trajectory, rate_hz: float) -> Trajectory:
    """Poses at t0 + k / rate_hz up to the last stamp (within a microsecond), t0 the first stamp.

    They lie on the path in continuous time; at a pose's own stamp it is kept, and beside an unknown one none is known.
    Raises ValueError for a rate that is not positive, and for one that asks for more than a million poses.
    """
    rate_hz = checked_rate(rate_hz)
    with np.errstate(over="ignore"):
        old_s = trajectory.stamps_s - trajectory.stamps_s[0]
    intervals = (float(old_s[-1]) + min(_STAMP_TOLERANCE_S, 0.1 / rate_hz)) * rate_hz
    if not intervals < MOST_POSES:
        raise ValueError(
            f"{rate_hz:g} Hz over the path's {old_s[-1]:.6g} s makes {intervals:.3g} poses, more than {MOST_POSES:,}"
        )
    count = int(np.floor(intervals)) + 1
    new_s = np.arange(count) / rate_hz
    there = np.minimum(np.searchsorted(old_s, new_s), len(trajectory) - 1)
    stamps_s = trajectory.stamps_s[0] + new_s
    # From the first stamp on: around 1e9 s the sum's rounding would move a pose past its neighbour.
    own = trajectory.at(slice(None), old_s)
    within_s = np.minimum(new_s, old_s[-1])
    c2w = _smooth(trajectory, own, within_s)
    kept = old_s[there] == new_s
    c2w[kept] = trajectory.c2w[there[kept]]
    return Trajectory(c2w, stamps_s, trajectory.notes, own.known_at(new_s), trajectory.continuous)


def _smooth(trajectory: Trajectory, own: Trajectory, passed_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses (M, 4, 4) at times since the first stamp. own: the trajectory from its first stamp on."""
    if trajectory.curve is None:
        return own.continuous.pose_at(passed_s)
    return trajectory.curve.pose_at(trajectory.stamps_s[0] + passed_s)


def convert_convention(poses: ArrayLike, *, direction: Direction, axes: Axes) -> NDArray[np.float64]:
    """(..., 4, 4) rigid poses in a declared convention -> c2w with OpenCV's camera axes.

    direction: "c2w" (camera to world) or "w2c". axes, of the camera: "opencv" (x right, y down, z forward), "opengl"
    (x right, y up, z backward; Blender, NeRF), "robot" (x forward, y left, z up; ROS) or "ned" (x forward, y right, z
    down; aircraft). The world stays as it is.
    Raises ValueError for another name.
    """
    if direction not in DIRECTIONS:
        raise ValueError(f"direction is one of {', '.join(DIRECTIONS)}, not {direction!r}")
    if axes not in AXES:
        raise ValueError(f"axes is one of {', '.join(AXES)}, not {axes!r}")
    c2w = invert_pose(poses) if direction == "w2c" else np.array(poses, dtype=np.float64)
    if axes == "opengl":
        return opencv_from_blender_c2w(c2w)
    if axes == "robot":
        return opencv_from_robot_c2w(c2w)
    if axes == "ned":
        return opencv_from_ned_c2w(c2w)
    return c2w


def checked_rate(rate_hz: float) -> float:
    """Return a rate. Raises ValueError unless it is finite and positive."""
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise ValueError(f"a frame rate is a positive number of hertz, not {rate_hz}")
    return float(rate_hz)


# Poses to what is meaningful of them, so that the same preset draws the same images everywhere.
#
# Two versions of numpy, or two processors, give sines, products of matrices and decompositions whose last bits
# differ, and an image shows a pixel at an edge otherwise for that. What is rounded here is far coarser than those,
# and far finer than anything that is measured or seen.


Float64 = NDArray[np.float64]

DECIMALS = 9  # of metres and ratios of a quaternion's components: a nanometre, and 2e-9 rad
FAR_M = 1e6  # from here on floats hold no nanometres that mean anything
FAR_DECIMALS = 6


def rounded_numbers(values: ArrayLike) -> Float64:
    """Return numbers of any shape to 9 decimals, without negative zeros; to 6 from a million on."""
    values = np.asarray(values, dtype=np.float64)
    near = np.abs(values) < FAR_M
    return np.where(near, np.round(values, DECIMALS), np.round(values, FAR_DECIMALS)) + 0.0


def rounded_poses(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) rigid -> (..., 4, 4): metres to 9 decimals, rotations to the nearest of a grid of quaternions.

    The grid's quaternions have one component of 1, the largest, and three others of 9 decimals; the rotation is theirs
    in the arithmetic that is equal everywhere. What is rounded already stays as it is, as do quarter turns.
    """
    c2w = np.asarray(c2w, dtype=np.float64)
    quat = quat_wxyz_from_rotation(c2w[..., :3, :3])
    largest = np.take_along_axis(quat, np.argmax(np.abs(quat), axis=-1)[..., None], axis=-1)
    w, x, y, z = np.moveaxis(np.round(quat / largest, DECIMALS) + 0.0, -1, 0)
    squared = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w + y * y - (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w + z * z - (x * x + y * y)],
    ]
    rotation = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) / squared[..., None, None]
    return pose(rotation + 0.0, rounded_numbers(c2w[..., :3, 3]))


@dataclass(frozen=True, eq=False)
class RoundedCurve:
    """A curve whose poses are rounded. Its motion is not, as derivatives are of the curve."""

    curve: Curve

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return rounded_poses(self.curve.pose_at(times_s))

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the motion then."""
        return motion_of(self.curve, times_s)


def rounded_path(path: Trajectory) -> Trajectory:
    """Return a path whose poses are rounded, and all that lie between them."""
    if isinstance(path.curve, RoundedCurve):
        return path
    curve = None if path.independent else RoundedCurve(path.continuous)
    return replace(path, c2w=rounded_poses(path.c2w), curve=curve)


# Time stamps: of one series, and of the colour, the depth and the pose of a path's frames.


NS_PER_S = 10**9


def nanoseconds(stamp_s: float) -> int:
    """Return a stamp in nanoseconds: those of the shortest decimal number that reads back to this float64.

    Around 1.3e9 s, float64 numbers are 2.4e-7 s apart: further digits would look exact and mean nothing.
    """
    return int((Decimal(repr(float(stamp_s))) * NS_PER_S).to_integral_value(ROUND_HALF_EVEN))


@dataclass(frozen=True, eq=False)
class Stamps:
    """The time stamps of a series; the array is copied and read-only.

    seconds: (N,) float64. exact_ns: the same in whole nanoseconds where a file says them, which float64 seconds cannot
    hold on a real clock; None where seconds are all that is known.
    """

    seconds: NDArray[np.float64]
    exact_ns: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        seconds = np.array(self.seconds, dtype=np.float64)
        seconds.setflags(write=False)
        object.__setattr__(self, "seconds", seconds)

    @classmethod
    def of_ns(cls, stamps_ns: Iterable[int]) -> "Stamps":
        """Return stamps that are known in whole nanoseconds."""
        exact = tuple(stamps_ns)
        return cls(np.array([stamp_ns / NS_PER_S for stamp_ns in exact]), exact)

    def __len__(self) -> int:
        return len(self.seconds)

    @cached_property
    def ns(self) -> tuple[int, ...]:
        """Whole nanoseconds: the exact ones, or those of the shortest decimal numbers of the seconds."""
        return tuple(map(nanoseconds, self.seconds.tolist())) if self.exact_ns is None else self.exact_ns

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> "Stamps":
        """Return the stamps of some rows, in this order."""
        exact = None if self.exact_ns is None else tuple(self.exact_ns[row] for row in rows)
        return Stamps(self.seconds[np.asarray(rows, dtype=np.int64)], exact)


@dataclass(frozen=True, eq=False)
class FrameStamps:
    """When the parts of each frame of a path were taken: its colour, its depth and its pose, N stamps each.

    A frame's own stamp is its colour's, and these increase. A recording's depth and ground truth come from other clocks
    or at other moments, so their stamps may differ, and need not increase from frame to frame.
    """

    rgb: Stamps
    depth: Stamps
    pose: Stamps

    @classmethod
    def of(cls, stamps: "FrameStamps | ArrayLike") -> "FrameStamps":
        """Return stamps as they are, or those of frames whose parts all have the same (N,) seconds."""
        if isinstance(stamps, FrameStamps):
            return stamps
        same = Stamps(np.asarray(stamps, dtype=np.float64))
        return cls(same, same, same)

    def __len__(self) -> int:
        return len(self.rgb)

    def frame_times(self, frame: int) -> tuple[float, float | None]:
        """Return what the record of a frame says: its time, and its depth's where that is another, in seconds."""
        time_s, depth_time_s = float(self.rgb.seconds[frame]), float(self.depth.seconds[frame])
        return time_s, None if depth_time_s == time_s else depth_time_s

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> "FrameStamps":
        """Return the stamps of some frames, in this order."""
        return FrameStamps(self.rgb.take(rows), self.depth.take(rows), self.pose.take(rows))


# The point around which a scene is rendered, so that float32 is precise near the camera.


# Up to this distance from the origin float32 resolves 1e-6 m, and a scene keeps its own coordinates for the artist.
RECENTRE_BEYOND_M = 16.0


def recentring_m(trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, to render around: whole metres in the middle of the path, if far away.

    The path decides, not the mesh, since precision matters near the camera.
    """
    positions_m = trajectory.c2w[:, :3, 3]
    middle_m = np.rint((positions_m.min(axis=0) + positions_m.max(axis=0)) / 2)
    return middle_m if np.abs(positions_m).max() > RECENTRE_BEYOND_M else np.zeros(3)
