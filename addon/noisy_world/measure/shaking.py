# SPDX-License-Identifier: GPL-3.0-or-later
"""How the hand or the body shakes the camera, by octaves of frequency: from poses, and without them from images.

The mean of modified periodograms (Welch, 1967) of how fast the camera turns and moves, over the square of the angular
frequency: what it turns and moves by.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..core.curve import NaturalSpline
from ..core.geometry import rotvec_from_rotation
from .figure import WITHIN, Figure
from .footage import Float64, RecordingView
from .motion import Steps, beside

# Chosen, as all below.
OCTAVES_HZ = tuple(0.5 * 2.0**number for number in range(8))
LEAST_SAMPLES, SEGMENT = 48, 128
NYQUIST_SHARE = 0.95  # of half of the rate: above, what is between frames is not seen
LEAST_BINS = 2  # frequencies of a segment in an octave

TURN, SHIFT = "shake_turn_deg", "shake_shift_m"
"""Root mean square, of all axes together, of what the camera turns and shifts by in an octave: curves over its middle.

`shake_turn_deg_2_to_4_hz` in degrees, `shake_shift_m_2_to_4_hz` in metres: `rotation_deg` and `translation_m` of
`vibration` with `source: band`, `low_hz: 2`, `high_hz: 4`. Shifts need poses.
"""


def shaking(footage: RecordingView, steps: Steps | None) -> tuple[Figure, ...]:
    """Return the spectrum of the camera's motion. steps: between frames in a row, where there are any."""
    known = np.flatnonzero(footage.path.known)
    stamps_s = np.asarray(footage.stamps.pose.seconds, np.float64)[known]
    if len(known) > LEAST_SAMPLES and bool((np.diff(stamps_s) > 0).all()):
        c2w = footage.path.c2w[known]
        back = np.swapaxes(c2w[:-1, :3, :3], 1, 2)
        turns = rotvec_from_rotation(back @ c2w[1:, :3, :3])
        shifts = np.einsum("nij,nj->ni", back, np.diff(c2w[:, :3, 3], axis=0))
        return (
            *_octaves(TURN, [_even(np.degrees(turns), stamps_s)], "poses"),
            *_octaves(SHIFT, [_even(shifts, stamps_s)], "poses"),
        )
    no_shift = Figure.none(SHIFT, "there are too few poses")
    if steps is None or footage.rate_hz is None:
        return Figure.none(TURN, "there are too few poses, and no frames in a row"), no_shift
    good = np.isfinite(steps.move[:, :3]).all(axis=1) & ~beside(steps.same, steps.run)
    rows = np.flatnonzero(good)
    parts = np.split(rows, np.flatnonzero((np.diff(rows) != 1) | (np.diff(steps.run[rows]) != 0)) + 1)
    long = [part for part in parts if len(part) >= LEAST_SAMPLES]
    if not long:
        return Figure.none(TURN, "there are too few poses, and too few frames in a row show features"), no_shift
    seconds = footage.stamps.rgb.seconds
    rates = [
        _even(np.degrees(steps.move[part, :3]), seconds[[*steps.frames[part, 0], steps.frames[part[-1], 1]]])
        for part in long
    ]
    return (*_octaves(TURN, rates, "steps"), no_shift)


def _even(changes: Float64, stamps_s: Float64) -> tuple[Float64, float]:
    """Return changes (N - 1, 3) between stamps (N,) as speeds at even times (M, 3), and how far these are apart."""
    whole = np.concatenate([np.zeros((1, 3)), np.cumsum(changes, axis=0)])
    gap_s = float(np.median(np.diff(stamps_s)))
    times_s = np.arange(stamps_s[0], stamps_s[-1] + 1e-6, gap_s)
    return np.diff(NaturalSpline(stamps_s - stamps_s[0], whole).at(times_s - stamps_s[0]), axis=0) / gap_s, gap_s


def _octaves(name: str, parts: list[tuple[Float64, float]], of: str) -> Iterator[Figure]:
    """Yield the root mean square in each octave that can be seen of speeds in parts."""
    gap_s = parts[0][1]
    long = min(SEGMENT, *(len(speeds) for speeds, _ in parts)) if len(parts) > 1 else min(SEGMENT, len(parts[0][0]))
    density, count = _density([speeds for speeds, _ in parts], gap_s, long)
    hertz = np.fft.rfftfreq(long, gap_s)
    angular = 2 * np.pi * np.maximum(hertz, hertz[1])
    # Between two stamps only the mean speed is seen.
    density = density / (angular * np.sinc(hertz * gap_s)) ** 2
    told = False
    for low, high in pairwise(OCTAVES_HZ):
        inside = (hertz >= low) & (hertz < high)
        bins = int(inside.sum())
        if bins < LEAST_BINS or low < 2 * hertz[1] or high > NYQUIST_SHARE * 0.5 / gap_s:
            continue
        value = math.sqrt(float(density[inside].sum() * hertz[1]))
        # Of 3 axes and, by Hann's window, of 2 frequencies in 3, each counts as two samples of a normal variance.
        error = value / math.sqrt(4 * 3 * bins * count / 1.5)
        spread = math.exp(WITHIN * error / value) if value > 0 else 1.0
        figure = Figure(f"{name}_{low:g}_to_{high:g}_hz", value, value / spread, value * spread, bins * count, of)
        told = True
        yield figure.on(name, math.sqrt(low * high))
    if not told:
        yield Figure.none(name, "too few of them follow one another")


def _density(parts: list[Float64], gap_s: float, long: int) -> tuple[Float64, int]:
    """Return the one-sided density (long / 2 + 1,) of all axes together, and of how many segments without overlap."""
    window = np.hanning(long + 1)[:-1]
    scale = 2 * gap_s / (window**2).sum()
    sums, used, whole = np.zeros(long // 2 + 1), 0, 0
    for speeds in parts:
        whole += max(len(speeds) // long, 1)
        for start in range(0, len(speeds) - long + 1, max(long // 2, 1)):
            segment = speeds[start : start + long]
            spectrum = np.fft.rfft((segment - segment.mean(axis=0)) * window[:, None], axis=0)
            sums += scale * (np.abs(spectrum) ** 2).sum(axis=1)
            used += 1
    return sums / used, whole
