# SPDX-License-Identifier: GPL-3.0-or-later
"""What stamps and equal images say of time: rate, jitter, gaps, dropped and doubled frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .figure import Figure
from .footage import Float64
from .motion import Steps

# Chosen, as all below.
UNEVEN = 1.5  # times what neighbours differ by: what stamps are off by beyond that is no jitter
GAP = 1.5  # times the median from stamp to stamp: more is a gap, in which frames are missing
LONGEST = 3  # equal images in a row that are doubled frames; more are a camera that stands still
LIKE = 0.15  # times the change before and after: so little is an image that was shown and coded again
SEEN_LEVELS = 1.0  # of that change, in grey levels
LEAST_ALIKE = 3  # images that are only alike and not equal, before they count


def stamp_figures(stamps_s: Float64) -> tuple[Figure, ...]:
    """Return rate, jitter, the longest gap, and how many frames are missing by the stamps (N,).

    Jitter is the deviation of stamps from an even clock, in seconds: exact where there is one.
    """
    names = ("rate_hz", "jitter_s", "longest_gap_s", "missing_frames")
    gaps_s = np.diff(stamps_s)
    if len(gaps_s) < 2:
        return tuple(Figure.none(name, "there are too few frames") for name in names)
    usual_s = float(np.median(gaps_s))
    counted = np.maximum(np.rint(gaps_s / usual_s), 1.0)
    whole = gaps_s < GAP * usual_s
    jitter_s = _jitter_s(stamps_s, counted)
    missing = int((counted[~whole] - 1).clip(1).sum())
    values = (1 / usual_s, jitter_s, float(gaps_s.max()), float(missing))
    return tuple(Figure.exact(name, value, len(gaps_s), "gaps") for name, value in zip(names, values, strict=True))


def _jitter_s(stamps_s: Float64, counted: Float64) -> float:
    """Return the deviation of stamps (N,) from the nearest even clock. counted: (N - 1,) frames from each to the next.

    Of a clock that drifts, or whose frames are not counted rightly, that of stamps from their neighbours instead.
    """
    frames = np.concatenate([[0.0], np.cumsum(counted)])
    terms = np.stack([np.ones_like(frames), frames - frames.mean()], axis=1)
    passed_s = stamps_s - stamps_s[0]
    off_s = passed_s - terms @ np.linalg.lstsq(terms, passed_s, rcond=None)[0]
    even_s = float(np.sqrt(np.mean(off_s**2)))
    between_s = float(np.sqrt(np.mean(np.diff(off_s) ** 2) / 2))
    return even_s if even_s < UNEVEN * between_s else between_s


@dataclass(frozen=True)
class Doubled:
    """Frames that show what the one before showed. share: of the frames that were looked at. every: a double each so
    many frames, where they come evenly; 0 where they do not. exact: whether images are equal, pixel by pixel.
    """

    share: Figure
    every: int
    exact: bool


def doubled(steps: Steps, same: NDArray[np.bool_], name: str, changes: Float64 | None) -> Doubled:
    """Return which frames are doubled. same: (M,) of colour or of depth. changes: (M,) how much images differ, or None.

    Equal images beside others that differ are doubled; a camera that stands still gives equal ones too, but many.
    """
    if len(steps) < 8:
        return Doubled(Figure.none(name, "too few frames in a row are looked at"), 0, exact=True)
    found = _short_runs(same, steps.run)
    exact = True
    if not found.any() and changes is not None:
        found = _alike(changes, steps.run)
        exact = False
        if found.sum() < LEAST_ALIKE:
            found = np.zeros_like(found)
    count, of = int(found.sum()), len(steps)
    share = count / of
    # Wilson's interval of a share.
    middle, wide = share + 1.92 / of, 1.96 * np.sqrt(share * (1 - share) / of + 0.96 / of**2)
    low, high = (float((middle + side * wide) / (1 + 3.84 / of)) for side in (-1, 1))
    figure = Figure(name, share, max(low, 0.0), high, of)
    return Doubled(figure, _period(steps.frames[found, 1], steps.run[found]), exact)


def _short_runs(same: NDArray[np.bool_], run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return equal steps (M,) that are few in a row, beside steps of the same run that differ."""
    found = np.zeros_like(same)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        before, after = first > 0 and run[first - 1] == run[first], end < len(run) and run[end] == run[first]
        found[first:end] = end - first < LONGEST and before and after
    return found


def _alike(changes: Float64, run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the steps (M,) that change far less than those before and after."""
    found = np.zeros(len(changes), np.bool_)
    beside = np.minimum(changes[:-2], changes[2:])
    inside = (run[:-2] == run[1:-1]) & (run[2:] == run[1:-1])
    found[1:-1] = inside & (beside > SEEN_LEVELS) & (changes[1:-1] < LIKE * beside)
    return found


def _period(frames: NDArray[np.int64], run: NDArray[np.int64]) -> int:
    """Return how far apart doubled frames are, if most are equally far; 0 otherwise."""
    apart = np.diff(frames)[np.diff(run) == 0] if len(frames) > 2 else np.zeros(0, np.int64)
    if len(apart) < 2:
        return 0
    usual = int(np.median(apart))
    return usual if np.mean(apart == usual) > 0.6 else 0


def void_figures(void: dict[int, float]) -> tuple[Figure, Figure]:
    """Return the mean share of pixels without depth, and the share of frames that have none at all."""
    names = ("void_share", "frames_without_depth_share")
    if not void:
        return Figure.none(names[0], "there is no depth"), Figure.none(names[1], "there is no depth")
    shares = np.array(list(void.values()))
    error = float(shares.std()) / max(len(shares), 1) ** 0.5
    return (
        Figure.within(names[0], float(shares.mean()), error, len(shares)),
        Figure.exact(names[1], float(np.mean(shares >= 1)), len(shares)),
    )


def per_frame(steps: Steps, stamps_s: Float64) -> Steps:
    """Return steps as if each led from one frame to the next. stamps_s: (N,) of the recording's frames.

    Where frames are lost all that is seen moves further at once: depth and colour alike, however late one of them is.
    """
    passed = _passed(steps, stamps_s)
    return replace(
        steps,
        move=steps.move / passed[:, None],
        normal=steps.normal * (passed**2)[:, None, None],
        right=steps.right * passed[:, None],
    )


def without_gaps(steps: Steps, stamps_s: Float64) -> Steps:
    """Return steps of which those over lost frames tell no motion. stamps_s: (N,) of the recording's frames."""
    return replace(steps, move=np.where(_passed(steps, stamps_s)[:, None] > 1, np.nan, steps.move))


def _passed(steps: Steps, stamps_s: Float64) -> Float64:
    """Return (M,) how many frames later a step ends than it begins, by the stamps."""
    if not len(steps):
        return np.ones(0)
    gaps_s = np.diff(stamps_s)
    return np.maximum(np.rint(gaps_s / float(np.median(gaps_s))), 1.0)[steps.frames[:, 0]]


def depth_stamps_later_s(rgb_s: Float64, depth_s: Float64) -> float:
    """Return by how much stamps of depth are later than those of colour, the median in seconds."""
    return float(np.median(depth_s - rgb_s))


def runs_of(count: int, looked_at: int, parts: int = 3, busy: Sequence[float] = ()) -> list[range]:
    """Return which frames of `count` are looked at, in so many runs if not all are.

    busy: how much happens in each frame; runs are laid where that is most.
    """
    if count <= looked_at:
        return [range(count)]
    long = max(2, looked_at // parts)
    if len(busy) == count:
        sums = np.convolve(np.asarray(busy, np.float64), np.ones(long), "valid")
        chosen: list[int] = []
        for at in np.argsort(-sums, kind="stable").tolist():
            if all(abs(at - other) >= long for other in chosen):
                chosen.append(at)
            if len(chosen) == parts:
                break
        return [range(at, at + long) for at in sorted(chosen)]
    starts = np.linspace(0, count - long, parts).round().astype(int)
    return [range(int(start), int(start) + long) for start in starts]
