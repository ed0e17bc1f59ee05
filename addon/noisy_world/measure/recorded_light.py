# SPDX-License-Identifier: GPL-3.0-or-later
"""How light changes from frame to frame on the same surfaces: exposure, white balance, flicker, vignetting.

Places that are followed from one frame to the next show the same surface twice. The ratio of their light is the
camera's doing, not the scene's: a gain that all share, and what the lens passes at one place and at the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.srgb import LUMINANCE
from .figure import BLOCKS, WITHIN, Figure, blocks_of, jackknifed
from .flickering import BandedLight, flicker
from .footage import Float32, Float64, RecordingView, linear_of_bytes

# Chosen, as all below.
WIDE_PX = 320  # the width at which places are followed
EVERY_PX = 5  # places that are compared
FITS = 16  # of 255: difference of what is compared with its surroundings; more is another surface
FAR = 4  # frames, between which what is seen moves far enough to show what the lens takes
EVEN_PX = 6  # what is compared with its surroundings so far, to be followed
PATCH_PX = 7  # of what is compared
DARKEST, LIGHTEST = 16 / 255, 247 / 255  # encoded: what is beyond may be cut off
APART = 0.35  # difference of log light: more is another surface
LEAST = 200  # places that two frames share: of fewer, as in blur, many are followed wrongly
TUKEY, REWEIGHTED = 4.7, 3
ROUNDED = 0.01  # deviation of log light by whole numbers of 255, at middle grey
# Found on known ones: of a range of exposure, in stops, whatever and for each step; of vignetting.
RANGE_ERROR, VIGNETTING_ERROR = (0.008, 0.0006), 0.012
BANDS = 16  # of lines in which flicker is looked at
FOLLOWED = 0.8  # of the steps: where fewer can be followed, those may be wrong that can
LEAST_STEPS = 24
LEAST_PAIRS = 5000
LEAST_LOSS, MOST_LOSS, MOST_LOSS_ERROR, GAUSS_NEWTON = -0.2, 0.97, 0.08, 5
LAG = "auto_exposure_lag_s"
LEAST_STOPS = 0.1  # range of exposure: less tells nothing of what it follows
LAG_ERROR = 0.04  # of the share, found on known lags
SLOWEST_S = 4.0
METERED = 0.3  # share of the changes' variance that the light before has to explain, before a lag is told


@dataclass(frozen=True)
class SharedSurface:
    """What two frames share, N places.

    frames: their numbers. run: the run that they are of. where: (N, 2) the squared distance from the axis in both, of
    half a diagonal. light: (N, 3) natural logarithm of the second's light over the first's, by channel. first: (N, 3)
    that of the first's. lines: (N, 2) where they are in both, of the height, from -1/2 to 1/2.
    """

    frames: tuple[int, int]
    run: int
    where: Float64
    light: Float64
    first: Float64
    lines: Float64


@dataclass(frozen=True)
class RecordedLight:
    """Frames' numbers and mean light, of full scale, (N,); what neighbours share, and frames that are FAR apart.

    steps: how many neighbours there are, and how many frames so far apart that are looked at. patch: what is compared,
    of the height.
    """

    frames: tuple[int, ...]
    mean: Float64
    shared: list[SharedSurface]
    far: list[SharedSurface]
    stamps_s: Float64
    steps: tuple[int, int]
    patch: float


def light_of(footage: RecordingView, runs: Sequence[range]) -> RecordedLight:
    """Look at runs of frames. Raises InputError where a frame's files are damaged."""

    mean: list[float] = []
    shared: list[SharedSurface] = []
    far: list[SharedSurface] = []
    looked, high_px = [0, 0], 1
    for number, run in enumerate(runs):
        seen: dict[int, _Seen] = {}
        for frame in run:
            light, seen[frame] = _seen(footage.colour(frame))
            mean.append(light)
            high_px = len(seen[frame][0])
            since = frame - run.start
            for place, (apart, whose) in enumerate(((1, shared), *(((FAR, far),) if since % FAR == 0 else ()))):
                if (before := seen.get(frame - apart)) is not None:
                    looked[place] += 1
                    pair = _shared(footage, before, seen[frame])
                    if len(pair[0]) >= LEAST:
                        whose.append(SharedSurface((frame - apart, frame), number, *pair))
            seen.pop(frame - FAR, None)
    return RecordedLight(
        tuple(frame for run in runs for frame in run),
        np.array(mean),
        shared,
        far,
        np.asarray(footage.stamps.rgb.seconds, np.float64),
        (looked[0], looked[1]),
        PATCH_PX / high_px,
    )


_Seen: TypeAlias = tuple[NDArray[np.uint8], Float32]
"""Of a frame, what features are followed in (H, W), and its light (H, W, 3), NaN where it was cut off."""


def _seen(colour: NDArray[np.uint8]) -> tuple[float, _Seen]:
    """Return the mean light of an image (H, W, 3), of full scale, and what is compared of it."""
    import cv2

    high, wide = colour.shape[:2]
    size_px = min(WIDE_PX, wide), max(1, round(high * min(1.0, WIDE_PX / wide)))
    small = np.asarray(cv2.resize(colour, size_px, interpolation=cv2.INTER_AREA), np.uint8)
    light = linear_of_bytes()[small]
    mean = float(light.mean(axis=(0, 1)) @ np.array(LUMINANCE))
    # What was cut off says nothing, nor what lies beside it.
    cut = ((small.min(axis=2) < 255 * DARKEST) | (small.max(axis=2) > 255 * LIGHTEST)).astype(np.uint8)
    light = np.array(cv2.blur(light, (PATCH_PX, PATCH_PX)), np.float32)
    light[cv2.dilate(cut, np.ones((PATCH_PX, PATCH_PX), np.uint8)) > 0] = np.nan
    grey = _even(np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.uint8))
    return mean, (grey, light)


def _even(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image without its own brightness, (H, W): following would take a change of light for a motion."""
    import cv2

    logarithm = np.log(grey.astype(np.float32) + 4)
    over = logarithm - np.asarray(cv2.GaussianBlur(logarithm, (0, 0), EVEN_PX), np.float32)
    return np.clip(128 + 127 * over, 0, 255).astype(np.uint8)


def _shared(footage: RecordingView, one: _Seen, other: _Seen) -> tuple[Float64, Float64, Float64, Float64]:
    """Return of places seen twice, where they are (N, 2), how their light changes, its logarithm before (N, 3), lines.

    Places lie evenly over the first image: of what is chosen for standing out, the other image shows less.
    """
    import cv2

    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(one[0], other[0], np.zeros((0, 0)))
    high, wide = one[0].shape
    v, u = (axis[EVERY_PX // 2 :: EVERY_PX, EVERY_PX // 2 :: EVERY_PX].ravel() for axis in np.mgrid[:high, :wide])
    x, y = ((axis + flow[v, u, place]).astype(np.float32) for place, axis in enumerate((u, v)))

    def there(image: NDArray[Any]) -> NDArray[Any]:
        found = cv2.remap(image, x[:, None], y[:, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(found).reshape(len(x), *image.shape[2:])

    times = footage.camera.width_px / wide
    across, down = (footage.camera.cx_px + 0.5) / times - 0.5, (footage.camera.cy_px + 0.5) / times - 0.5
    half = np.hypot(wide, high) / 2
    places = np.stack([((a - across) ** 2 + (b - down) ** 2) / half**2 for a, b in ((u, v), (x, y))], axis=1)
    good = (x >= 0) & (x <= wide - 1) & (y >= 0) & (y <= high - 1)
    good &= np.abs(there(other[0]).astype(np.float64) - one[0][v, u]) < FITS
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.log(one[1][v, u]).astype(np.float64)
        light = np.log(there(other[1])).astype(np.float64) - first
    good &= np.isfinite(light).all(axis=1)
    middle = np.median(light[good], axis=0) if good.any() else np.zeros(3)
    good[good] = (np.abs(light[good] - middle) < APART).all(axis=1)
    lines = (np.stack([v, y], axis=1) + 0.5) / high - 0.5
    return places[good], light[good], first[good], lines[good]


@dataclass(frozen=True)
class _Steps:
    """Of steps between frames (M,): their frames (M, 2), run, gain (M, 3) in natural logarithm, its error (M,).

    banded: their light by bands of lines.
    """

    frames: NDArray[np.int64]
    run: NDArray[np.int64]
    gain: Float64
    error: Float64
    banded: BandedLight


def light_figures(light: RecordedLight) -> tuple[Figure, ...]:
    """Return what light says of exposure, white balance, flicker and vignetting."""
    shared, far = (
        whose if len(whose) >= FOLLOWED * steps else []
        for whose, steps in zip((light.shared, light.far), light.steps, strict=True)
    )
    vignetting, loss = _vignetting(far)
    steps = _gains(shared, loss, light.patch)
    flickers, by_lamps = flicker(steps.banded, light.stamps_s)
    left = steps.gain.mean(axis=1) - by_lamps
    exposure = _exposure(steps, left, light.stamps_s)
    return (*_brightness(light.mean), *exposure, _lag(light, steps, left, exposure[0]), *flickers, vignetting)


def _brightness(means: Float64) -> tuple[Figure, ...]:
    """Return the mean light of frames (N,), and the range that it has, whatever is seen."""
    groups = blocks_of(len(means))
    if len(means) < BLOCKS or not means.any():
        return tuple(Figure.none(name, "there are too few frames") for name in ("mean_light", "mean_light_range_stops"))
    low, high = np.quantile(np.log2(np.maximum(means, 1e-6)), (0.05, 0.95))
    error = jackknifed(np.array([means[groups != group].mean() for group in range(BLOCKS)]))
    return (
        Figure.within("mean_light", float(means.mean()), error, len(means)),
        Figure.exact("mean_light_range_stops", float(high - low), len(means)),
    )


def _vignetting(shared: Sequence[SharedSurface]) -> tuple[Figure, float]:
    """Return the share of light that is lost half a diagonal from the axis, by the law 1 - loss r^2."""
    name = "vignetting_corner_loss"
    count = sum(len(pair.where) for pair in shared)
    if len(shared) < BLOCKS or count < LEAST_PAIRS:
        return Figure.none(name, "the camera moves too little, or too little of what it sees can be followed"), 0.0
    loss, groups = 0.0, blocks_of(len(shared))
    sums = np.zeros((BLOCKS, 2))
    for _ in range(GAUSS_NEWTON):
        sums = np.zeros((BLOCKS, 2))
        for pair, group in zip(shared, groups, strict=True):
            sums[group] += _vignetting_equation(pair, loss)
        loss = float(np.clip(loss + _quotient(sums.sum(axis=0)), LEAST_LOSS, MOST_LOSS))
    error = jackknifed(np.array([loss + _quotient(sums.sum(axis=0) - part) for part in sums]))
    if error > MOST_LOSS_ERROR or not LEAST_LOSS < loss < MOST_LOSS:
        return Figure.none(name, "what is followed moves too little towards the border, or away from it"), 0.0
    error = float(np.hypot(error, VIGNETTING_ERROR))
    return Figure.within(name, loss, error, count, "places"), max(loss, 0.0)


def _vignetting_equation(pair: SharedSurface, loss: float) -> Float64:
    """Return (2,), the weight and the side of the equation of what a loss lacks, by the places that two frames share.

    What both frames' exposures differ by is taken out; Tukey's weights are of what this loss leaves.
    """
    passed = 1 - np.clip(loss * pair.where, None, 0.99)
    off = pair.light.mean(axis=1) - np.diff(np.log(passed), axis=1)[:, 0]
    slope = np.diff(-pair.where / passed, axis=1)[:, 0]
    off -= np.median(off)
    weight = _tukey(off)
    variance = max(float(np.average(off**2, weights=weight)), 1e-6)
    slope -= np.average(slope, weights=weight)
    return np.array([weight @ slope**2, weight @ (slope * off)]) / variance


def _quotient(sums: Float64) -> float:
    return float(sums[1] / max(sums[0], 1e-12))


def _tukey(off: Float64) -> Float64:
    spread = 1.4826 * float(np.median(np.abs(off))) + 1e-4
    return np.clip(1 - (off / (TUKEY * spread)) ** 2, 0, None) ** 2 + 1e-9


def _gains(shared: Sequence[SharedSurface], loss: float, patch: float) -> _Steps:
    """Return how light changes in steps. loss: of vignetting. patch: of what is compared, of the height."""
    gains: list[Float64] = []
    errors: list[float] = []
    bands: list[tuple[Float64, Float64, Float64]] = []
    for pair in shared:
        passed = np.log(1 - np.clip(loss * pair.where, None, 0.99))
        light = pair.light - (passed[:, 1] - passed[:, 0])[:, None]
        middle = np.median(light, axis=0)
        first, weight = np.exp(pair.first), np.ones_like(light)
        for _ in range(REWEIGHTED):
            weight = np.clip(1 - ((light - middle) / (TUKEY * _spread(light - middle))) ** 2, 0, None) ** 2
            # Of sums of light: of logarithms, places that are seen from nearer, and so less blurred, would be darker.
            second = (weight * first * np.exp(light)).sum(axis=0)
            middle = np.log(np.maximum(second, 1e-9) / np.maximum((weight * first).sum(axis=0), 1e-9))
        gains.append(middle)
        errors.append(float(_spread(light - middle).mean()) / len(light) ** 0.5)
        bands.append(_bands(pair.lines, light.mean(axis=1), first.mean(axis=1) * weight.min(axis=1)))
    frames = np.array([pair.frames for pair in shared], np.int64).reshape(-1, 2)
    run = np.array([pair.run for pair in shared], np.int64)
    change, lines, weight = (
        np.array([band[place] for band in bands]).reshape(-1, BANDS, *more)
        for place, more in ((0, ()), (1, (2,)), (2, ()))
    )
    banded = BandedLight(frames, change, lines, weight, (1 / BANDS, patch))
    return _Steps(frames, run, np.array(gains).reshape(-1, 3), np.array(errors), banded)


def _bands(lines: Float64, change: Float64, weight: Float64) -> tuple[Float64, Float64, Float64]:
    """Return how light changes in bands of lines (BANDS,), where these are in both frames (BANDS, 2), and weights.

    lines: (N, 2) of places. change: (N,) of their light. weight: (N,), 0 of what is another surface.
    """
    band = np.clip(((lines[:, 0] + 0.5) * BANDS).astype(int), 0, BANDS - 1)
    whole = np.bincount(band, weight, BANDS)
    enough = (np.bincount(band, weight > 0, BANDS) >= LEAST // BANDS) & (whole > 0)
    divisor = np.where(enough, whole, np.nan)
    # Of sums of light, as gains are.
    changed = np.log(np.maximum(np.bincount(band, weight * np.exp(change), BANDS), 1e-12) / divisor)
    where = np.stack([np.bincount(band, weight * line, BANDS) / divisor for line in lines.T], axis=1)
    return changed, np.nan_to_num(where), np.where(enough, whole, 0.0)


def _spread(off: Float64) -> Float64:
    """Return the deviation of changes of light (N, 3), by channel, at least that of rounding to whole numbers."""
    return np.maximum(1.4826 * np.median(np.abs(off), axis=0), ROUNDED)


def _exposure(steps: _Steps, luminance: Float64, stamps_s: Float64) -> tuple[Figure, ...]:
    """Return how far, and how fast, exposure and white balance go on the same surfaces."""
    names = ("exposure_range_stops", "exposure_rate_stops_per_s", "white_balance_range_stops")
    if len(luminance) < LEAST_STEPS:
        return tuple(Figure.none(name, "too few frames in a row show the same") for name in names)
    red_over_blue = steps.gain[:, 0] - steps.gain[:, 2]
    ranges = [_range(steps, values) for values in (luminance, red_over_blue)]
    gaps_s = np.diff(stamps_s[steps.frames], axis=1)[:, 0]
    rates = np.abs(luminance) / np.log(2) / gaps_s
    groups = blocks_of(len(rates))
    fastest = [float(np.quantile(rates[groups != group], 0.95)) for group in range(BLOCKS)]
    error = float(np.hypot(jackknifed(np.array(fastest)), np.median(steps.error / gaps_s) / np.log(2)))
    rate = Figure.within(names[1], float(np.quantile(rates, 0.95)), error, len(rates), "steps")
    far, colours = (
        Figure.within(name, value, error, len(rates), "steps")
        for name, (value, error) in zip((names[0], names[2]), ranges, strict=True)
    )
    return far, rate, colours


def _lag(light: RecordedLight, steps: _Steps, change: Float64, moved: Figure) -> Figure:
    """Return the time constant in seconds with which exposure follows the light, `lag_s` of `auto_exposure`.

    change: (M,) of log light on the same surfaces. moved: the range of exposure. A camera goes a share
    1 - exp(-gap / lag) of the way to its target between two frames: so much less, the brighter the first of them was.
    """
    if moved.value is None:
        return Figure.none(LAG, moved.untold)
    if not moved.sure_beyond(LEAST_STOPS):
        return Figure.none(LAG, "exposure stays as it is")
    mean = dict(zip(light.frames, np.log(np.maximum(light.mean, 1e-6)).tolist(), strict=True))
    before = np.array([mean[frame] for frame in steps.frames[:, 0].tolist()])
    gap_s = float(np.median(np.diff(light.stamps_s[steps.frames], axis=1)))
    groups = blocks_of(len(change))
    share, explained = _followed_share(before, change)
    if explained < METERED:
        return Figure.none(LAG, "exposure does not follow how bright images are")
    parts = [_followed_share(before[groups != group], change[groups != group])[0] for group in range(BLOCKS)]
    error = float(np.hypot(jackknifed(np.array(parts)), LAG_ERROR * share))
    low, value, high = (
        -gap_s / float(np.log1p(-np.clip(share + side * WITHIN * error, 1e-3, 0.999))) for side in (1, 0, -1)
    )
    if value > SLOWEST_S:
        return Figure.none(LAG, f"exposure follows how bright images are by more than {SLOWEST_S:g} s, if at all")
    return Figure(LAG, value, low, high, len(change), "steps")


def _followed_share(before: Float64, change: Float64) -> tuple[float, float]:
    """Return by which share of the way changes go towards a target, and how much of their variance that explains."""
    weight = np.ones(len(change))
    slope, left = 0.0, change
    for _ in range(4):
        x, y = before - np.average(before, weights=weight), change - np.average(change, weights=weight)
        slope = float((weight * x * y).sum() / max((weight * x * x).sum(), 1e-12))
        left = y - slope * x
        weight = _tukey(left)
    y = change - np.average(change, weights=weight)
    return -slope, 1 - float(np.average(left**2, weights=weight) / max(np.average(y**2, weights=weight), 1e-12))


def _range(steps: _Steps, change: Float64) -> tuple[float, float]:
    """Return the widest range in a run of what has changed so (M,), in stops, and its error."""
    widest = 0.0, RANGE_ERROR[0]
    parts = np.flatnonzero((np.diff(steps.run) != 0) | (steps.frames[1:, 0] != steps.frames[:-1, 1])) + 1
    for part in np.split(np.arange(len(change)), parts):
        track = np.concatenate([[0.0], np.cumsum(change[part])]) / np.log(2)
        first, last = sorted((int(np.argmin(track)), int(np.argmax(track))))
        by_steps = float(np.sqrt((steps.error[part][first:last] ** 2).sum())) / float(np.log(2))
        error = float(np.hypot(np.hypot(by_steps, RANGE_ERROR[0]), RANGE_ERROR[1] * (last - first)))
        if track.max() - track.min() > widest[0]:
            widest = float(track.max() - track.min()), error
    return widest
