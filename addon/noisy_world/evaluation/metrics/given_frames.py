# SPDX-License-Identifier: GPL-3.0-or-later
"""Which samples of a true path stand for the frames that a system was given.

The truth of a dataset has a sample for each frame. That of a motion capture comes at 100 to 200 Hz, several samples to
a frame, so what was tracked and lost cannot be counted in them.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..association import Float64, Rows, associate_poses

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
