# SPDX-License-Identifier: GPL-3.0-or-later
"""A structured-light camera such as the first Kinect: disparity in eighths, a window, and the projector's shadow."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.schema import Choice, key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import bands, by_bands, quotient
from ._depth_devices import (
    DEVICE_TOOLTIPS,
    NOISE_SEVERITIES,
    Devices,
    camera_of,
    dim,
    disparity_of,
    drop_blind,
    filled,
    noise_of_device,
    of_device,
    range_contradiction,
    shadowed,
    shared_errors,
    sharing,
)
from ._noise import Draws, SharedNoise, drawn, scaled, shifted_places, taken

LEAST_JUMP_PX = 1.0  # of disparity: less is one surface; chosen


@dataclass(frozen=True)
class StructuredLight:
    """Disparity is rounded to fractions of a pixel after a little noise, so that far depth has steps.

    Lost is what the projector does not light, by a second ray from its place; pixels whose window shows mostly other
    surfaces, so that thin things and sharp corners are missing; and what is outside the range. Edges are ragged: each
    pixel takes the depth of a place near its own. Where `least_light` says so, what gives too little light is lost too:
    it goes with the cosine of incidence, the inverse square of depth, and a reflectance that is drawn in clumps, since
    nobody knows the infrared one. Not modelled: sunlight, radial distortion.
    """

    device: Literal["kinect_v1", "kinect_v1_near", "kinect_v1_measured"] = key(
        "the camera whose values are taken",
        default="kinect_v1",
        choices={
            "kinect_v1": Choice("Kinect", "Microsoft's first Kinect"),
            "kinect_v1_near": Choice("Kinect, Near", "Microsoft's first Kinect in its near mode"),
            "kinect_v1_measured": Choice("Kinect, Measured", "A first Kinect as its own frames say: noise in patches"),
        },
    )
    noise: float = noise_of_device()
    focal_px: float = of_device("focal length of the device's image", 10_000, "px")
    baseline_m: float = of_device("distance from the projector to the camera", 10, "m")
    step_px: float = of_device("what disparity is rounded to", 8, "px")
    sigma_px: float = of_device("standard deviation of disparity before that", 8, "px")
    shift_px: float = of_device("standard deviation of the place, across and down, that a pixel shows", 8, "px")
    window_px: float = of_device("side of the window that is matched; 0: none", 99, "px")
    least_share: float = of_device("share of the window that has to show the pixel's own surface", 1)
    min_m: float = of_device("nearest depth that is given", 1000, "m", slider=(0, 2))
    max_m: float = of_device("farthest depth that is given", 1000, "m", slider=(0.5, 20))
    correlation_px: float = sharing("correlation_px")
    correlation_frames: int = sharing("correlation_frames")
    correlation_share: float = sharing("correlation_share")
    least_light: float = sharing("least_light")
    reflectance_spread: float = sharing("reflectance_spread")
    clump_px: float = sharing("clump_px")
    clump_frames: int = sharing("clump_frames")
    blind_px: float = sharing("blind_px")
    blind_left_px: float = sharing("blind_left_px")
    blind_top_px: float = sharing("blind_top_px")
    blind_bottom_px: float = sharing("blind_bottom_px")
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "sigma_px": "Higher: steps of depth get more ragged",
        "window_px": "Higher: larger thin things have no depth",
        "least_share": "Higher: corners and thin things lose more",
    }


# f b / step of 351.3 m, an error of a sixth of a step, half a pixel of shift, a window of 9 x 9: ICL-NUIM (simkinect).
# baseline_m and step_px: BlenSor; so focal_px is 585.5. Ranges: Kinect for Windows SDK. least_share: a guess.
_KINECT = {"focal_px": 585.5, "baseline_m": 0.075, "step_px": 1 / 8, "sigma_px": 1 / 48, "shift_px": 0.5}
_KINECT |= {"window_px": 9.0, "least_share": 0.4}
# Fitted to 60 frames of a first Kinect along a path through the room that they were fused to (docs/sensors.md).
# clump_frames is a guess, from how long a patch of that size stayed at its place in the image.
_MEASURED = {"sigma_px": 0.045, "correlation_px": 4.0, "correlation_frames": 6, "blind_px": 8.0}
_MEASURED |= {"least_light": 0.0015, "reflectance_spread": 2.4, "clump_px": 40.0, "clump_frames": 9}
DEVICES: Devices = {
    "kinect_v1": _KINECT | {"min_m": 0.8, "max_m": 4.0},
    "kinect_v1_near": _KINECT | {"min_m": 0.4, "max_m": 3.0},
    "kinect_v1_measured": _KINECT | _MEASURED | {"min_m": 0.8, "max_m": 4.0},
}


def apply(depth_m: NDArray[np.float32], parameters: StructuredLight, context: FrameContext) -> NDArray[np.float32]:
    """Measure (H, W) metres; needs the context's intrinsics."""
    camera = camera_of(context, "structured_light")
    own = filled(parameters, DEVICES)
    scale = camera.fx_px / own.focal_px  # this image's pixels in one of the device's
    lit = disparity_of(depth_m, own.focal_px * own.baseline_m)
    lit[shadowed(lit, scale)] = 0
    _drop_unmatched(lit, own, scale)
    if own.least_light > 0:
        lit[dim(depth_m, own, context, camera, scale)] = 0
    shared = shared_errors(own, scale)
    if own.shift_px * own.noise > 0:
        down, right = drawn(context, "place", depth_m.shape, SharedNoise(shared.px), count=2)
        lit = taken(lit, *shifted_places(down, right, own.shift_px * own.noise * scale))
    drop_blind(lit, own, scale)
    draws: tuple[Draws, ...] = ()
    if own.sigma_px * own.noise > 0:
        draws = drawn(context, "disparity", depth_m.shape, shared)
    return by_bands(
        depth_m,
        np.dtype(np.float32),
        lambda depth, shown, *of_band: _triangulated(depth, shown, own, *of_band),
        *(lit, *draws),
    )


def _triangulated(
    depth_m: NDArray[np.float32],
    lit: NDArray[np.float32],
    own: StructuredLight,
    draws: Draws | None = None,
) -> NDArray[np.float32]:
    """Return the depth of rows (H, W) by the disparity that they show, which is changed in place."""
    valid = (depth_m > 0) & (depth_m < np.inf)
    valid &= lit > 0
    if draws is not None:
        lit += scaled(draws, own.sigma_px * own.noise)
    if own.step_px > 0:
        # The published code adds half a step before rounding and leaves it there; here it is taken off again.
        _round(lit, own.step_px)
    valid &= lit > 0
    measured = quotient(own.focal_px * own.baseline_m, lit, valid)
    measured[(measured < np.float32(own.min_m)) | (measured > np.float32(own.max_m))] = 0
    return measured


def _round(disparity_px: NDArray[np.float32], step_px: float) -> None:
    """Round disparity to steps and half a step, in place."""
    disparity_px *= np.float32(1 / step_px)
    disparity_px += np.float32(0.5)
    np.rint(disparity_px, out=disparity_px)
    disparity_px -= np.float32(0.5)
    disparity_px *= np.float32(step_px)


def _drop_unmatched(disparity_px: NDArray[np.float32], own: StructuredLight, scale: float) -> None:
    """Clear, in place, disparity (H, W) where too little of the window shows the pixel's own surface.

    Of two surfaces with the mean m and the variance v, the pixel's own, d, has the share v / (v + (d - m)^2), and they
    are (v + (d - m)^2) / |d - m| apart.
    """
    import cv2

    half = round(own.window_px * scale / 2 - 0.5)
    if half < 1 or own.least_share <= 0:
        return
    window = (2 * half + 1, 2 * half + 1)
    size = disparity_px.shape
    known = (disparity_px > 0).view(np.uint8)
    count = np.asarray(cv2.boxFilter(known, cv2.CV_32S, window, normalize=False), np.int32).reshape(size)
    mean = np.asarray(cv2.blur(disparity_px, window), np.float32).reshape(size)
    squares = np.asarray(cv2.sqrBoxFilter(disparity_px, cv2.CV_32F, window), np.float32).reshape(size)
    # v < s (v + o^2) and v + o^2 > o j hold for no o up to (1 - s) j; less, as the window's share is rounded.
    sure_px = np.float32((1 - own.least_share - 1e-3) * LEAST_JUMP_PX)
    # The others have enough: with all of the window known, one that is less far off has a share of at least that.
    for own_px, *others in zip(*map(bands, (disparity_px, mean, squares, count)), strict=True):
        asked = (np.abs(own_px - others[0]) > sure_px) | (others[2] < math.prod(window))
        asked = np.flatnonzero(asked & (own_px > 0))
        mean_px, squares_px, counted = (other.reshape(-1).take(asked) for other in others)
        known = (counted * (1.0 / math.prod(window))).astype(np.float32)
        kept = _enough(own_px.reshape(-1).take(asked), mean_px, squares_px, known, own.least_share)
        own_px.reshape(-1)[asked[~kept]] = 0


def _enough(
    own_px: NDArray[np.float32],
    mean: NDArray[np.float32],
    squares: NDArray[np.float32],
    known: NDArray[np.float32],
    least_share: float,
) -> NDArray[np.bool_]:
    """Return (N,) whether windows show enough of the pixels' own surfaces.

    mean, squares: over all of a window, what is unknown as 0. known: which share of it is known, above 0.
    """
    weight = np.divide(np.float32(1), known)  # means are over what is known
    mean = np.multiply(mean, weight, dtype=np.float32)
    off = np.abs(own_px - mean)
    variance = squares * weight
    variance -= mean * mean
    np.maximum(variance, 0, out=variance)
    spread = off * off
    spread += variance
    # share = known * variance / spread where the two are apart, else known
    variance *= known
    two = spread > off * np.float32(LEAST_JUMP_PX)
    least = np.float32(least_share)
    return np.where(two, variance >= least * spread, known >= least)


PERTURBATION = DepthPerturbation(
    name="structured_light",
    label="Depth sensor: structured light",
    order=2,
    parameters=StructuredLight,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the device's errors, halved and doubled; the laws: ICL-NUIM, BlenSor",
    about=About(
        "Measures depth by a projected pattern: in steps far away, with shadows beside near things",
        "the first Kinect's disparity, window and shadow",
        caption="the first Kinect; beyond 4 m it gives nothing.",
        picture="Structured light's depth at a quarter, once and four times the device's noise",
    ),
    apply=apply,
    contradiction=range_contradiction(DEVICES),
    temporals=("fresh", "fixed"),
    grain=True,
)
