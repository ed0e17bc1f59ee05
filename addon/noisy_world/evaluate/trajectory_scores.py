# SPDX-License-Identifier: GPL-3.0-or-later
"""A trajectory scored: an estimate against the true path, from files, with times for poses that have none."""

import re
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.schema import quoted
from ..core.trajectory import Axes, Direction, Trajectory
from ..layouts import find_sequence, recognising
from ..layouts.stored_recording import RATE_HZ, StoredSequence
from ..trajectories.formats import Auto
from ..trajectories.pose_files import LARGEST_STAMP_S, LEAST_NS, FilePoses, is_header, read_text
from .cases import ESTIMATE, KEYFRAMES
from .estimates import (
    MAX_DIFFERENCE_S,
    Asked,
    Estimate,
    Float64,
    Frames,
    Rows,
    associate_poses,
    estimate_of,
    read_poses,
)
from .metrics import RunResult, metrics_of, result_of, value_of
from .pose_errors import (
    IDENTITY,
    PROTOCOLS,
    Alignment,
    Compared,
    Conditioning,
    FrameErrors,
    Protocol,
    Similarity,
    aligned_poses,
    conditioning_of,
    first_pose_alignment,
    full_pose_alignment,
    least_squares_alignment,
    rotation_notes,
    stands_still,
)

# Which samples of a true path stand for the frames that a system was given.
#
# The truth of a dataset has a sample for each frame. That of a motion capture comes at 100 to 200 Hz, several samples
# to a frame, so what was tracked and lost cannot be counted in them.


FramesFrom: TypeAlias = Literal["given", "estimate_rate", "truth"]

FEWEST = 10  # chosen: poses from which on an estimate has a rate of its own
REGULAR_SHARE, REGULAR = 2 / 3, 0.25  # chosen: so many of the gaps are within a quarter of their median
MOST = 100  # chosen: frames for each sample of a truth, beyond which its gaps are no frames
DENSER = 0.75  # chosen: the truth's gaps are shorter than this share of the estimate's, so it has more than a frame


@dataclass(frozen=True, eq=False)
class FrameSamples:
    """The samples of a truth that stand for frames.

    rows: (F,) of the truth, increasing. source: where the frames come from: they were given, or they are the estimate's
    own stamps and as many more at its rate as are missing, or every sample of the truth is one. rate_hz: of the
    estimate, where the frames follow from it. poses, frames: (P,) which pose of the scored estimate belongs to which of
    the F frames.
    """

    rows: Rows
    source: FramesFrom
    rate_hz: float | None
    poses: Rows
    frames: Rows


def own_period_s(stamps_s: Float64) -> float | None:
    """(M,) seconds -> the seconds from frame to frame; None where poses are few, or come at irregular times."""
    gaps_s = np.diff(stamps_s)
    if len(stamps_s) < FEWEST:
        return None
    period_s = float(np.median(gaps_s))
    regular = np.abs(gaps_s - period_s) <= REGULAR * period_s
    return period_s if float(regular.mean()) >= REGULAR_SHARE else None


def frame_samples(
    scored_s: Float64,
    estimate_s: Float64,
    truth_s: Float64,
    frames_s: Float64 | None,
    within_s: float,
) -> FrameSamples:
    """Return the frames of a truth (N,), and which poses belong to them.

    scored_s (M,): the poses that are scored; pairs of them and true samples are `associate_poses`'. estimate_s: all
    poses of the run, whose rate is asked. frames_s: (F,) stamps of the frames; None: they follow from that rate where
    the truth is denser, else they are the truth's samples. A frame is lost where no pose belongs to it, by the same
    rule within half a frame. Frames for which there is no true sample within `within_s` count for nothing, and against
    nothing.
    """
    poses, samples = associate_poses(scored_s, truth_s, within_s)
    source: FramesFrom = "given"
    rate_hz = None
    if frames_s is None:
        period_s = own_period_s(estimate_s)
        if period_s is None or len(truth_s) < 2 or float(np.median(np.diff(truth_s))) >= DENSER * period_s:
            every = np.arange(len(truth_s))
            return FrameSamples(every, "truth", None, poses, samples)
        if float(truth_s[-1] - truth_s[0]) / period_s > MOST * len(truth_s):  # a truth of few samples far apart
            return FrameSamples(np.arange(len(truth_s)), "truth", None, poses, samples)
        frames_s = _filled(estimate_s, period_s, float(truth_s[0]), float(truth_s[-1]))
        source, rate_hz = "estimate_rate", 1.0 / period_s
    half_s = max(within_s, float(np.median(np.diff(frames_s))) / 2.0 if len(frames_s) > 1 else 0.0)
    of_frames, tracked = associate_poses(scored_s, frames_s, half_s)
    kept = np.isin(poses, of_frames)
    poses, samples = poses[kept], samples[kept]
    lost = np.ones(len(frames_s), dtype=bool)
    lost[tracked] = False
    candidates, of_truth = associate_poses(frames_s, truth_s, within_s)
    rows = np.union1d(samples, of_truth[lost[candidates]])
    if not len(rows):  # frames of another time
        rows = np.arange(len(truth_s))
    return FrameSamples(rows, source, rate_hz, poses, np.searchsorted(rows, samples))


def _filled(stamps_s: Float64, period_s: float, first_s: float, last_s: float) -> NDArray[np.float64]:
    """Return the stamps of an estimate, and more a period apart where it has gaps, from the first time to the last."""
    inside = stamps_s[(stamps_s >= first_s - period_s / 2.0) & (stamps_s <= last_s + period_s / 2.0)]
    if not len(inside):
        return np.arange(first_s, last_s, period_s)
    before = inside[0] - period_s * np.arange(int((inside[0] - first_s) / period_s), 0, -1)
    after = inside[-1] + period_s * np.arange(1, int((last_s - inside[-1]) / period_s) + 1)
    gaps = np.rint(np.diff(inside) / period_s).astype(np.int64)
    between = [
        np.linspace(inside[row], inside[row + 1], gaps[row] + 1)[1:-1] for row in np.flatnonzero(gaps > 1).tolist()
    ]
    return np.sort(np.concatenate([before, inside, after, *between]))


Values: TypeAlias = dict[str, float | None]

FEWEST_POSES = 3
"""Two poses and one can always be laid over the truth."""
LARGEST_M = 1e100
"""Positions beyond it leave float64's range when they are squared."""

FAILURES = {
    "no_poses": "the estimate holds no pose",
    "no_common_stamps": "no pose of the estimate belongs to a true frame, by their stamps",
    "too_few_poses": f"fewer than {FEWEST_POSES} poses belong to true frames, so any estimate would fit",
    "stands_still": "all estimated positions are one, while the camera moved",
    "truth_stands_still": "the camera stood still, so an estimate's scale cannot be found",
    "diverged": f"a position lies beyond {LARGEST_M:g}",
}
"""What Score.failure may say, but for ""."""


@dataclass(frozen=True, eq=False)
class Score:
    """What is said of one estimate.

    protocol: its name. alignment: how the estimate was laid over the truth, by: with what, and by_poses with what its
    rotations and its map are; None where the run failed. conditioning: how well the path says how it is turned; None
    likewise. failure: "" or one of FAILURES. poses: of the estimate that were scored; frames: that the system was
    given; matched: how many of both belong together, their stamps max_difference_s apart at most. frames_from: where
    the frames come from, rate_hz: at which rate, where that is the estimate's own. values: by the names of METRICS (or
    PAPER_METRICS), each finite; None where a metric has none. truth, frame_errors: the true poses and the errors of
    every frame. notes: what a user should know, one sentence each.
    """

    protocol: str
    alignment: Alignment
    by: Similarity | None
    by_poses: Similarity | None
    conditioning: Conditioning | None
    failure: str
    poses: int
    frames: int
    matched: int
    max_difference_s: float
    frames_from: FramesFrom
    rate_hz: float | None
    values: Values
    truth: Trajectory = field(repr=False)
    frame_errors: FrameErrors = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def result(self) -> RunResult:
        """What came of the run: complete, incomplete or failed."""
        return result_of(bool(self.failure), self.matched / self.frames)


def score_trajectory(
    estimate: Estimate,
    truth: Trajectory,
    protocol: str | Protocol = "strict",
    *,
    monocular: bool = False,
    keyframes: Estimate | None = None,
    max_difference_s: float | None = None,
    alignment: Alignment | None = None,
    frames_s: NDArray[np.float64] | None = None,
) -> Score:
    """Score an estimate against the true path.

    protocol: its name, or one of your own. monocular: whether the system had no depth, so its scale is free. keyframes:
    those of the run, which protocol paper scores instead. max_difference_s, alignment: instead of the protocol's.
    frames_s: (F,) stamps of all frames that the system was given, in which coverage is counted; None: the estimate's
    own rate says them where the truth has more samples than that, as a motion capture's has, else each sample of the
    truth is a frame. A run that failed is a result with a word, never an exception. Raises ValueError for a protocol
    that does not exist.
    """
    if isinstance(protocol, str):
        if protocol not in PROTOCOLS:
            raise ValueError(f"protocol is one of {', '.join(PROTOCOLS)}, not {protocol!r}")
        protocol = PROTOCOLS[protocol]
    how = protocol.alignment(monocular=monocular) if alignment is None else alignment
    scored = keyframes if protocol.keyframes and keyframes is not None else estimate
    within_s = protocol.max_difference_s if max_difference_s is None else max_difference_s
    samples = frame_samples(scored.stamps_s, estimate.stamps_s, truth.stamps_s, frames_s, within_s)
    matched = _compared(scored, truth, protocol, how, samples)
    return Score(
        protocol=protocol.name,
        alignment=how,
        by=matched.by,
        by_poses=matched.by_poses,
        conditioning=matched.conditioning,
        failure=matched.failure,
        poses=len(scored),
        frames=len(matched.truth),
        matched=len(matched.frames),
        max_difference_s=within_s,
        frames_from=samples.source,
        rate_hz=samples.rate_hz,
        values={name: value_of(metric, matched) for name, metric in metrics_of(protocol).items()},
        truth=matched.truth,
        frame_errors=_frame_errors(matched),
        notes=rotation_notes(matched),
    )


def compare_poses(
    scored: Estimate,
    truth: Trajectory,
    protocol: Protocol = PROTOCOLS["strict"],
    how: Alignment = Alignment.SE3,
    within_s: float = MAX_DIFFERENCE_S,
) -> Compared:
    """Return an estimate laid over the truth, or why it cannot be: what metrics are computed from.

    Each sample of the truth is a frame.
    """
    stamps_s = scored.stamps_s
    samples = frame_samples(stamps_s, stamps_s, truth.stamps_s, truth.stamps_s, within_s)
    return _compared(scored, truth, protocol, how, samples)


def _compared(
    scored: Estimate, truth: Trajectory, protocol: Protocol, how: Alignment, samples: FrameSamples
) -> Compared:
    """Return the poses that belong to frames of the truth, laid over it."""
    of_frames = truth if len(samples.rows) == len(truth) else truth.at(samples.rows, truth.stamps_s[samples.rows])
    matched = Compared(scored.c2w[samples.poses], of_frames, samples.frames, protocol)
    if failure := _failure(scored, matched, how):
        return replace(matched, failure=failure)
    by = _alignment(matched, how)
    laid = replace(matched, estimate=aligned_poses(matched.estimate, by), by=by)
    known = conditioning_of(matched.true[:, :3, 3], laid.position.rmse)
    fitted = how in (Alignment.SE3, Alignment.SIM3)
    by_poses = full_pose_alignment(matched.estimate, matched.true, by, known) if fitted else by
    return replace(laid, by_poses=by_poses, conditioning=known)


def _failure(scored: Estimate, matched: Compared, how: Alignment) -> str:
    if len(scored) == 0:
        return "no_poses"
    if len(matched.frames) == 0:
        return "no_common_stamps"
    if len(matched.frames) < FEWEST_POSES:
        return "too_few_poses"
    if np.abs(matched.estimate[:, :3, 3]).max() > LARGEST_M:
        return "diverged"
    true_still = stands_still(matched.true[:, :3, 3])
    if true_still:
        return "truth_stands_still" if how is Alignment.SIM3 else ""
    return "stands_still" if stands_still(matched.estimate[:, :3, 3]) else ""


def _alignment(matched: Compared, how: Alignment) -> Similarity:
    if how is Alignment.NONE:
        return IDENTITY
    if how is Alignment.FIRST_POSE:
        return first_pose_alignment(matched.estimate[0], matched.true[0])
    with_scale = how is Alignment.SIM3
    return least_squares_alignment(matched.estimate[:, :3, 3], matched.true[:, :3, 3], with_scale=with_scale)


def _frame_errors(matched: Compared) -> FrameErrors:
    count = len(matched.truth)
    error_m, rotation_deg, position_m = np.full(count, np.nan), np.full(count, np.nan), np.full((count, 3), np.nan)
    if not matched.failure:
        error_m[matched.frames] = matched.position_errors_m
        position_m[matched.frames] = matched.estimate[:, :3, 3]
        rotation_deg[matched.frames] = matched.rotation_errors_deg
    return FrameErrors(matched.truth.stamps_s, matched.tracked, error_m, rotation_deg, position_m)


# An estimate, the truth and the frames read from files, with the times of poses that have none of their own.


# A list of the frames that a system was given: a stamp a line, as TUM's rgb.txt, EuRoC's data.csv and times.txt.


_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_MOST_DIGITS = 40
_REMEDY = "a line is a time stamp, and perhaps a file, as in TUM's rgb.txt and EuRoC's data.csv"


def read_frame_list(path: Path) -> Frames:
    """Read a list of frames: each line's first word is a stamp in seconds, or in nanoseconds from 1e17 on.

    What follows, at its end the name of the frame's image, is separated by blanks or commas. Raises InputError.
    """
    stamps: list[Decimal] = []
    names: list[str] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        data = line.partition("#")[0].strip()
        words = re.split(r"[\s,]+", data)
        if not data or (not stamps and is_header(words[0])):
            continue
        if len(words[0]) > _MOST_DIGITS or not _NUMBER.fullmatch(words[0]):
            raise InputError(path, f"{quoted(words[0])} is no time stamp", where=f"line {number}", remedy=_REMEDY)
        stamps.append(Decimal(words[0]))
        names.append(words[1] if len(words) > 1 else "")
    if not stamps:
        raise InputError(path, "lists no frame", remedy=_REMEDY)
    per_s = 10**9 if all(stamp >= LEAST_NS for stamp in stamps) else 1
    seconds = np.array([float(stamp / per_s) for stamp in stamps])
    if np.abs(seconds).max() > LARGEST_STAMP_S:
        raise InputError(path, "has time stamps of more than 1e11 s", remedy="write them in seconds, or in nanoseconds")
    seconds, first = np.unique(seconds, return_index=True)
    return Frames.of(seconds, [names[row] for row in first.tolist()] if all(names) else ())


COLOUR_LIST = "rgb.txt"  # of TUM's layout
_DEPTH = 3  # folders from a true path up to its sequence: EuRoC's lies in mav0/state_groundtruth_estimate0


@dataclass(frozen=True)
class PosesToCompare:
    """An estimate, the keyframes where there are some, and the truth.

    frames: those that the system was given, where a folder or a file says them; None: they follow from the stamps.
    frames_from: where they come from, in words; "" where they are not known. notes: what a user should know.
    """

    estimate: Estimate
    truth: Trajectory
    keyframes: Estimate | None = None
    frames: Frames | None = None
    frames_from: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _KnownFrames:
    """The frames, where they come from, in words, and what is to be said of them.

    of_truth: whether they are the true poses, which have no time stamps of their own.
    """

    frames: Frames | None = None
    said: str = ""
    notes: tuple[str, ...] = ()
    of_truth: bool = False


def read_poses_to_compare(
    estimate: Path,
    truth: Path,
    *,
    keyframes: Path | None = None,
    frames: Path | None = None,
    format: str = "auto",  # noqa: A002
    direction: Direction = "c2w",
    axes: Axes | None = None,
    rate_hz: float | None = None,
) -> PosesToCompare:
    """Read an estimate and the truth, files of poses in any format.

    estimate: a file or folder of poses, or a run's folder with estimate.txt; a file without a pose is an estimate
    without poses. truth: a file or folder of poses, or a sequence's folder. keyframes: a file of poses; a run's folder
    has its own. frames: a list of the frames' stamps, or a sequence's folder; None: those of the folder of the
    sequence that the truth is, or lies in, where there is one. format, direction, axes: of the estimate's poses.
    Poses without stamps count the frames: they get the stamps of those, or of the truth where that has as many, else a
    rate is needed. Raises InputError, for files that hold anything else too, and where stamps cannot be had.
    """
    folder = estimate if (estimate / ESTIMATE).is_file() else None
    if folder is not None:
        estimate = folder / ESTIMATE
        keyframes = folder / KEYFRAMES if keyframes is None and (folder / KEYFRAMES).is_file() else keyframes
    true, given = _read_truth(truth, rate_hz)
    if frames is not None:
        given = _KnownFrames(_frames_of(frames), f"those of {frames.name}")
    known = given.frames
    reference_s = known.stamps_s if known is not None else true.stamps_s
    direction_given: Direction | Auto = "auto" if direction == "c2w" else direction
    asked = Asked(direction_given, axes or "auto")
    estimated = read_poses(estimate, format, asked, reference_s)
    notes = [*estimated.notes, *true.notes, *given.notes]
    path, counted = _with_stamps(truth, true, estimated, known, rate_hz)
    of_estimate, more = _estimate(estimate, estimated, path, known, rate_hz)
    notes += [*counted, *more]
    of_keyframes = None
    if keyframes is not None:
        read = read_poses(keyframes, "auto", asked, reference_s)
        if read.stamps_s is None and len(read):
            raise InputError(keyframes, "has no time stamps", remedy="keyframes need them: write TUM's format")
        of_keyframes = _NONE if read.stamps_s is None else estimate_of(keyframes, read, None)
    known = Frames.of(path.stamps_s) if given.of_truth else known
    return PosesToCompare(of_estimate, path, of_keyframes, known, given.said, tuple(notes))


_NONE = Estimate(np.zeros(0), np.zeros((0, 4, 4)))


def _read_truth(path: Path, rate_hz: float | None) -> tuple[FilePoses, _KnownFrames]:
    """Return the true poses, and the frames of the sequence that the path is the folder of, or lies in."""
    if path.is_dir() and recognising(path):
        sequence = find_sequence(path, rate_hz)
        frames = None if sequence.stamps_path is None and rate_hz is None else _frames(sequence)
        poses = sequence.trajectory
        if frames is None:
            count = len(poses)
            counted = FilePoses("", poses.c2w, numbers=np.arange(count, dtype=np.float64), notes=poses.notes)
            return counted, _KnownFrames(None, _source_text(path), of_truth=True)
        stamped = FilePoses("", poses.c2w, poses.stamps_s, notes=poses.notes)
        return stamped, _KnownFrames(frames, _source_text(path))
    read = read_poses(path)
    if not len(read):
        raise InputError(path, "holds no pose", remedy="the true path needs one for each frame")
    return read, _frames_near(path)


def _frames_near(path: Path) -> _KnownFrames:
    """Return the frames of the sequence in whose folder a file of true poses lies; none where there is no sequence."""
    for folder in path.resolve().parents[:_DEPTH]:
        try:
            sequence = find_sequence(folder) if recognising(folder) else None
        except InputError:
            sequence = None
        own = sequence is not None and sequence.trajectory_path is not None and sequence.trajectory_path.samefile(path)
        if sequence is not None and own and sequence.stamps_path is not None:
            return _KnownFrames(_frames(sequence), _source_text(folder))
    listed = path.parent / COLOUR_LIST
    if not listed.is_file():
        return _KnownFrames()
    return _KnownFrames(
        read_frame_list(listed), f"those of {listed.name} beside {path.name}"
    )  # of a camera without depth


def _source_text(folder: Path) -> str:
    return f"those of the folder {folder.resolve().name}"


def _frames(sequence: StoredSequence) -> Frames:
    return Frames.of(sequence.stamps.rgb.seconds, sequence.rgb_files)


def _frames_of(path: Path) -> Frames:
    if path.is_dir():
        return _frames(find_sequence(path, poses="keep"))
    return read_frame_list(path)


def _with_stamps(
    path: Path, true: FilePoses, read: FilePoses, known: Frames | None, rate_hz: float | None
) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the true path with time stamps, and a note on where they come from."""
    if true.stamps_s is not None:
        return Trajectory(true.poses, true.stamps_s), ()
    if rate_hz is not None or (read.stamps_s is None and known is None):
        return _counted(path, true, rate_hz or RATE_HZ), (f"frames are counted at {rate_hz or RATE_HZ:g} Hz",)
    if known is None:
        assert read.stamps_s is not None
        frames, whose = Frames.of(np.unique(read.stamps_s)), "the estimate"
    else:
        frames, whose = known, "the frames"
    numbers = true.numbers
    assert numbers is not None, "poses have stamps or numbers"
    if true.names or int(numbers[-1]) != len(frames) - 1:
        counted = "names images" if true.names else f"counts {int(numbers[-1]) + 1} frames"
        problem = f"has no time stamps, and {counted}, where {whose} are {len(frames)}"
        raise InputError(path, problem, remedy="say its frames a second: --rate-hz")
    estimate = estimate_of(path, true, frames)
    return Trajectory(estimate.c2w, estimate.stamps_s), (f"{path.name} has no time stamps: it gets those of {whose}",)


def _counted(path: Path, read: FilePoses, rate_hz: float) -> Trajectory:
    """Return poses under the times of their frames' numbers at a rate."""
    if read.names or read.numbers is None:
        raise InputError(path, "names images, and which frames these are is not known", remedy="name --frames")
    return Trajectory(read.poses, read.numbers / rate_hz)


def _estimate(
    path: Path, read: FilePoses, truth: Trajectory, known: Frames | None, rate_hz: float | None
) -> tuple[Estimate, tuple[str, ...]]:
    """Return the estimate with time stamps, and notes on it."""
    if read.stamps_s is not None:
        return estimate_of(path, read, None), ()
    if not len(read):
        return _NONE, ()
    if known is not None:
        return (
            estimate_of(path, read, known),
            (f"{path.name} has no time stamps: its poses get those of the frames",),
        )
    if rate_hz is not None:
        counted = _counted(path, read, rate_hz)
        return Estimate(counted.stamps_s, counted.c2w), (f"{path.name}: frames are counted at {rate_hz:g} Hz",)
    if read.numbers is not None and not read.names:
        frames = read.count or int(read.numbers.max()) + 1
        if frames != len(truth):
            problem = f"has no time stamps, and counts {frames} frames, where the truth has {len(truth)} poses"
            remedy = "say which frames there are, --frames, or how many a second: --rate-hz"
            raise InputError(path, problem, remedy=remedy)
    estimate = estimate_of(path, read, Frames.of(truth.stamps_s))
    return estimate, (f"{path.name} has no time stamps: its frames get those of the truth",)
