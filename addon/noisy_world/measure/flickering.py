# SPDX-License-Identifier: GPL-3.0-or-later
"""How lamps on mains flicker, by the light of what neighbouring frames both show.

A line sees the lamps at its own time: a rolling shutter makes bands of flicker, and these tell how long it takes to be
read. So light is compared line by line, at each time that a readout would give it. Stamps that jitter by a part of the
lamps' period tell nothing of their phase; where frames come by an even clock, that one does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .figure import BLOCKS, WITHIN, Figure, blocks_of
from .footage import Float64

# Chosen, as all below.
LAMPS_HZ = (100.0, 120.0)  # twice the mains'
FOLDED = 0.3  # of its swing that a flicker has to show between frames, before it can be told
LEAST_STEPS = 24
READOUTS_S = np.arange(-68, 69) * 0.0005  # that are tried, from the top down; below 0 from below
CLOCKS_S = np.arange(
    -0.003, 0.0031, 0.001
)  # by which an even clock that is fitted to jittering stamps is off at its end
SURE = 20.0  # times a step's variance by which what is not simplest has to explain more; found on light without flicker
SWING_ERROR = 0.0005, 0.02  # of flicker, absolute and relative, found on known ones
JITTERS = 0.1  # of the lamps' period: stamps that jitter by more hide a flicker
READOUT_ERROR = 0.02  # relative, of a readout by bands
MOST_SWING, GAUSS_NEWTON, TUKEY = 0.95, 8, 4.7

READOUT = "flicker_readout_ms"
"""What a frame takes to be read from the top to the bottom, by the bands that flicker makes; below 0 from below."""


@dataclass(frozen=True)
class BandedLight:
    """The light of M steps between frames in bands of lines, B of each.

    frames: (M, 2) numbers. change: (M, B) of the natural logarithm of light on the same surfaces; NaN where a band
    shows too few. lines: (M, B, 2) where the band is in both frames, of their height, from -1/2 to 1/2. weight: (M, B).
    smeared: over which shares of the height light is averaged, one after another.
    """

    frames: NDArray[np.int64]
    change: Float64
    lines: Float64
    weight: Float64
    smeared: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Fit:
    """cosine and sine of the swing, readout in seconds, the clock (frames,); the sum of squares that it explains.

    spread: what is left of a step's variance. jitter_s: of the stamps about an even clock.
    """

    swing: Float64
    readout_s: float
    clock_s: Float64
    explained: float
    spread: float
    jitter_s: float


def flicker(light: BandedLight, stamps_s: Float64) -> tuple[tuple[Figure, ...], Float64]:
    """Return figures of flicker, and its part (M,) in how the light of each step changes."""
    figures: list[Figure] = []
    best = np.zeros(len(light.frames))
    best_swing, readout = 0.0, Figure.none(READOUT, "there are no bands of flicker")
    for hertz in LAMPS_HZ:
        name = f"flicker_swing_{hertz:.0f}_hz"
        if len(light.frames) < LEAST_STEPS:
            figures.append(Figure.none(name, "too few frames in a row show the same"))
            continue
        gaps_s = np.diff(stamps_s[light.frames], axis=1)
        if np.sqrt(np.mean(np.abs(np.exp(2j * np.pi * hertz * gaps_s) - 1) ** 2)) < FOLDED:
            figures.append(Figure.none(name, "at this rate of frames each frame sees the same of it"))
            continue
        fit = _fitted(light, stamps_s, hertz)
        swing, by_bands, sure = _figures(light, fit, hertz, name)
        figures.append(swing)
        if sure and swing.value is not None and swing.value > best_swing:
            best_swing, best, readout = swing.value, _mean_change(light, fit, hertz), by_bands
    return (*figures, readout), best


def _angles(light: BandedLight, clock_s: Float64, readout_s: float, hertz: float) -> Float64:
    """Return the lamps' angle (M, B, 2) when each band was exposed, in both frames."""
    return 2 * np.pi * hertz * (clock_s[light.frames][:, None, :] + readout_s * light.lines)


def _clocks(stamps_s: Float64) -> Iterator[Float64]:
    """Yield the times (N,) at which frames may have been exposed: the stamps, and even clocks near to them."""
    yield stamps_s
    frames, even_s = _even(stamps_s)
    if _jitter_s(stamps_s) > 1e-5:
        for off_s in CLOCKS_S.tolist():
            yield even_s + off_s * frames / frames[-1]


def _even(stamps_s: Float64) -> tuple[Float64, Float64]:
    """Return frames' numbers, those that are missing counted, and the even clock (N,) that is nearest to stamps."""
    gaps_s = np.diff(stamps_s)
    frames = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(gaps_s / np.median(gaps_s)), 1.0))])
    return frames, np.asarray(np.polyval(np.polyfit(frames, stamps_s, 1), frames), np.float64)


def _jitter_s(stamps_s: Float64) -> float:
    return float(np.std(stamps_s - _even(stamps_s)[1]))


def _fitted(light: BandedLight, stamps_s: Float64, hertz: float) -> _Fit:
    """Return the readout and the clock that explain most, which are the simplest unless another surely does."""
    good = np.isfinite(light.change) & (light.weight > 0)
    change, weight = light.change[good], light.weight[good]
    weight = weight / weight.sum() * len(light.frames)  # bands of a step are not independent: each counts its share
    weight = weight * _tukey(change, max(float(np.sqrt(np.average(change**2, weights=weight))), 1e-4))
    tried: list[tuple[float, float, Float64, Float64]] = []
    for clock_s in _clocks(stamps_s):
        first, second = np.moveaxis(_angles(light, clock_s, 0.0, hertz)[good], -1, 0)
        lines = light.lines[good] * 2 * np.pi * hertz
        for readout_s in READOUTS_S.tolist():
            turn = np.exp(1j * (second + readout_s * lines[:, 1])) - np.exp(1j * (first + readout_s * lines[:, 0]))
            x, y = turn.real, turn.imag
            xx, xy, yy = weight @ (x * x), weight @ (x * y), weight @ (y * y)
            xc, yc = weight @ (x * change), weight @ (y * change)
            area = max(xx * yy - xy * xy, 1e-12)
            explained = (xc * xc * yy - 2 * xc * yc * xy + yc * yc * xx) / area
            swing = np.array([xc * yy - yc * xy, yc * xx - xc * xy]) / area
            tried.append((float(explained), readout_s, clock_s, swing))
    whole = float(weight @ change**2)
    still = min(range(len(READOUTS_S)), key=lambda place: abs(READOUTS_S[place]))
    simplest = tried[still]
    best = max(tried, key=lambda each: each[0])
    variance = max((whole - best[0]) / max(len(light.frames) - 5, 1), 1e-12)
    chosen = simplest
    for group in (tried[: len(READOUTS_S)], tried[still :: len(READOUTS_S)], tried):  # readout; clock; both
        most = max(group, key=lambda each: each[0])
        if most[0] > chosen[0] + SURE * variance:
            chosen = most
    return _Fit(chosen[3], chosen[1], chosen[2], chosen[0], variance, _jitter_s(stamps_s))


def _figures(light: BandedLight, fit: _Fit, hertz: float, name: str) -> tuple[Figure, Figure, bool]:
    """Return the swing and the readout by bands, and whether there is a flicker. The fit is made exact in place."""
    good = np.isfinite(light.change) & (light.weight > 0)
    change, weight, lines = light.change[good], light.weight[good], light.lines[good]
    groups = np.broadcast_to(blocks_of(len(light.frames))[:, None], good.shape)[good]
    angles = _angles(light, fit.clock_s, 0.0, hertz)[good]
    banded, lamps = fit.readout_s != 0, 2 * np.pi * hertz
    found = np.array([*fit.swing / max(1.0, float(np.hypot(*fit.swing)) / MOST_SWING), fit.readout_s])
    parts: list[tuple[Float64, Float64]] = []
    for _ in range(GAUSS_NEWTON):
        angle = angles + lamps * found[2] * lines
        wave = np.cos(angle), np.sin(angle)
        shown = np.maximum(1 + found[0] * wave[0] + found[1] * wave[1], 0.02)
        turned = lamps * lines * (found[1] * wave[0] - found[0] * wave[1])
        slopes = np.stack([np.diff(part / shown, axis=1)[:, 0] for part in (*wave, turned)], axis=1)
        off = change - np.diff(np.log(shown), axis=1)[:, 0]
        if not banded:
            slopes = slopes[:, :2]
        each = weight * _tukey(off, max(_spread(off), 1e-4))
        parts = [
            ((slopes[here] * each[here, None]).T @ slopes[here], (slopes[here] * each[here, None]).T @ off[here])
            for here in (groups == block for block in range(BLOCKS))
        ]
        step = _solved(parts)
        found[: len(step)] += step
        found[:2] /= max(1.0, float(np.hypot(*found[:2])) / MOST_SWING)
    left_out = np.array(
        [_solved([part for other, part in enumerate(parts) if other != block]) for block in range(BLOCKS)]
    )
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0))
    fit.swing[:] = found[:2]
    swing = float(np.hypot(*found[:2]))
    along = found[:2] / max(swing, 1e-12)
    error = float(np.hypot(*(along * errors[:2])))
    sure = swing > 4 * error and fit.explained > SURE * fit.spread
    # Bands and patches average over lines that the lamps were seen by at different times.
    left = float(np.prod([np.sinc(hertz * found[2] * share) for share in light.smeared]))
    swing, error = swing / left, float(np.hypot(error / left, SWING_ERROR[0] + SWING_ERROR[1] * swing / left))
    count = len(light.frames)
    if not sure and fit.jitter_s * hertz > JITTERS:
        why = f"stamps jitter by {1e3 * fit.jitter_s:.2g} ms, and no clock near to them shows it"
        return Figure.none(name, why), Figure.none(READOUT, why), sure
    shown = Figure(name, swing, max(swing - WITHIN * error, 0.0), swing + WITHIN * error, count, "steps")
    if not sure or not banded:
        why = "bands of flicker are not seen" if sure else "there is no flicker that makes bands"
        return shown, Figure.none(READOUT, why), sure
    readout_s = float(found[2])
    readout_error = float(np.hypot(errors[2], READOUT_ERROR * abs(readout_s)))
    return shown, Figure.within(READOUT, 1e3 * readout_s, 1e3 * readout_error, count, "steps"), sure


def _solved(parts: Sequence[tuple[Float64, Float64]]) -> Float64:
    normal, right = (np.sum([part[place] for part in parts], axis=0) for place in (0, 1))
    return np.linalg.lstsq(normal + 1e-12 * np.eye(len(right)), right, rcond=None)[0]


def _mean_change(light: BandedLight, fit: _Fit, hertz: float) -> Float64:
    """Return what flicker changes the light of each step by (M,), all bands together."""
    angle = _angles(light, fit.clock_s, fit.readout_s, hertz)
    shown = np.log(np.maximum(1 + fit.swing[0] * np.cos(angle) + fit.swing[1] * np.sin(angle), 0.02))
    weight = np.where(np.isfinite(light.change), light.weight, 0.0)
    return (np.diff(shown, axis=2)[..., 0] * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)


def _spread(off: Float64) -> float:
    return 1.4826 * float(np.median(np.abs(off - np.median(off))))


def _tukey(off: Float64, spread: float) -> Float64:
    return np.clip(1 - (off / (TUKEY * spread)) ** 2, 0, None) ** 2
