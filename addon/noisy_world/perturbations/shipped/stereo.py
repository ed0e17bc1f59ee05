# SPDX-License-Identifier: GPL-3.0-or-later
"""A stereo depth camera with a projector: errors of disparity, its baseline's shadow, and walls without texture."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.schema import Choice, key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import by_bands, quotient, without_void
from ._depth_devices import (
    DEVICE_TOOLTIPS,
    NOISE_SEVERITIES,
    Devices,
    camera_of,
    disparity_of,
    filled,
    noise_of_device,
    of_device,
    shadowed,
    shared_errors,
    sharing,
)
from ._noise import Draws, SharedNoise, drawn, look_up, normal_quantiles, scaled

WINDOW_PX = 7  # of the device's image: the census window of simsense, which is what texture is asked for


@dataclass(frozen=True)
class Stereo:
    """Disparity f b / z of the device's own image is uncertain and rounded; depth is lost where nothing can be matched.

    Lost is what the right eye does not see, what has more disparity than the device searches, what is too far, and what
    has too little contrast: that of the colour around a pixel, and of the projector's pattern, which fades with the
    square of the distance; each pixel's contrast is multiplied by speckle. The left eye is where the image was taken.
    Not modelled: wrong matches, depth of an edge that spreads, repetitive texture, sunlight.
    """

    device: Literal["realsense_d435", "realsense_d455", "realsense_d415", "realsense_d435_correlated"] = key(
        "the camera whose values are taken",
        default="realsense_d435",
        choices={
            "realsense_d435": Choice("RealSense D435", "Intel's stereo camera with a wide view"),
            "realsense_d455": Choice("RealSense D455", "Intel's stereo camera with a longer baseline"),
            "realsense_d415": Choice("RealSense D415", "Intel's stereo camera with a narrow view"),
            "realsense_d435_correlated": Choice(
                "RealSense D435, Correlated", "Intel's stereo camera with a wide view: noise and holes in patches"
            ),
        },
    )
    noise: float = noise_of_device()
    focal_px: float = of_device("focal length of the images that are matched", 10_000, "px")
    baseline_m: float = of_device("distance between the two eyes", 10, "m")
    sigma_px: float = of_device("standard deviation of disparity", 100, "px")
    step_px: float = of_device("what disparity is rounded to; 0: not", 8, "px")
    search_px: float = of_device("largest disparity that is searched for", 10_000, "px")
    max_m: float = of_device("farthest depth that is given", 1000, "m", slider=(0.5, 20))
    least_contrast: float = of_device("least standard deviation of brightness (0 to 1) that is matched", 1)
    pattern: float = of_device("contrast that the projector adds to white at 1 m", 100)
    speckle: float = of_device("standard deviation of the speckle that contrast is multiplied by", 1)
    correlation_px: float = sharing("correlation_px")
    correlation_frames: int = sharing("correlation_frames")
    correlation_share: float = sharing("correlation_share")
    clump_px: float = sharing("clump_px")
    clump_frames: int = sharing("clump_frames")
    TOOLTIPS: ClassVar[Mapping[str, str]] = DEVICE_TOOLTIPS | {
        "sigma_px": "Higher: far surfaces get rougher",
        "search_px": "Lower: more of what is near has no depth",
        "least_contrast": "Higher: more plain walls have no depth; 0: none is lost",
        "pattern": "Higher: plain walls have depth further away",
        "speckle": "Higher: the borders of holes get more ragged",
    }


# focal_px: 424 at 848 x 480 and 90 degrees, sigma_px: Intel's figure for D4xx, librealsense thread 3904; the best of it
# is 0.032. Degrees: Intel, Subpixel linearity improvement (D415: 65, at 1280). step_px: the same. speckle: simsense.
# The baselines, the D455's 87 degrees, search_px, least_contrast, pattern and max_m were not looked up: guesses.
_D4XX = {"sigma_px": 0.08, "step_px": 1 / 32, "search_px": 126.0, "max_m": 10.0}
_D4XX |= {"least_contrast": 0.01, "pattern": 0.16, "speckle": 0.25}
# Errors of windows of 7 px that share all but l columns have the correlation 1 - l / 7, which is 1 / e at 4.4 px.
# clump_px and the frames are guesses.
_PATCHES = {"correlation_px": 4.4, "correlation_frames": 1, "clump_px": 12.0, "clump_frames": 1}
DEVICES: Devices = {
    "realsense_d435": _D4XX | {"focal_px": 424.0, "baseline_m": 0.050},
    "realsense_d435_correlated": _D4XX | _PATCHES | {"focal_px": 424.0, "baseline_m": 0.050},
    "realsense_d455": _D4XX | {"focal_px": 446.8, "baseline_m": 0.095},
    "realsense_d415": _D4XX | {"focal_px": 1004.6, "baseline_m": 0.055},
}


def apply(depth_m: NDArray[np.float32], parameters: Stereo, context: FrameContext) -> NDArray[np.float32]:
    """Measure (H, W) metres; needs the context's colour and intrinsics."""
    camera = camera_of(context, "stereo")
    own = filled(parameters, DEVICES)
    scale = camera.fx_px / own.focal_px  # this image's pixels in one of the device's
    disparity = disparity_of(depth_m, own.focal_px * own.baseline_m)
    lost = shadowed(disparity, scale)
    if own.least_contrast > 0:
        lost |= _untextured(depth_m, own, context, camera.fx_px)
    draws: tuple[Draws, ...] = ()
    if own.sigma_px * own.noise > 0:
        draws = drawn(context, "disparity", depth_m.shape, shared_errors(own, scale))
    return by_bands(
        disparity,
        disparity.dtype,
        lambda seen, without, *of_band: _triangulated(seen, without, own, scale, *of_band),
        *(lost, *draws),
    )


def _triangulated(
    disparity_px: NDArray[np.float32],
    lost: NDArray[np.bool_],
    own: Stereo,
    scale: float,
    draws: Draws | None = None,
) -> NDArray[np.float32]:
    """Return the depth of rows (H, W) by disparity, which is changed in place; 0 where it was 0 or is lost."""
    product = own.focal_px * own.baseline_m
    # The left of the image is outside the right eye's.
    valid = disparity_px * np.float32(scale) <= np.arange(0.5, disparity_px.shape[1], dtype=np.float32)
    valid &= disparity_px > 0
    valid &= ~lost
    if draws is not None:
        disparity_px += scaled(draws, own.sigma_px * own.noise)
    if own.step_px > 0:
        disparity_px *= np.float32(1 / own.step_px)
        np.rint(disparity_px, out=disparity_px)
        disparity_px *= np.float32(own.step_px)
    valid &= disparity_px <= np.float32(own.search_px)
    valid &= disparity_px >= np.float32(max(product / own.max_m, 1e-6) if own.max_m > 0 else np.inf)
    return quotient(product, disparity_px, valid)


def _untextured(depth_m: NDArray[np.float32], own: Stereo, context: FrameContext, focal_px: float) -> NDArray[np.bool_]:
    """Return the mask (H, W) of what has too little contrast: the colour's and the projector's variances add up."""
    import cv2

    grey = np.asarray(cv2.cvtColor(context.rgb, cv2.COLOR_RGB2GRAY), np.float32).reshape(depth_m.shape)
    half = max(round(WINDOW_PX * focal_px / own.focal_px / 2 - 0.5), 1)
    window = (2 * half + 1, 2 * half + 1)
    mean = np.asarray(cv2.blur(grey, window), np.float32).reshape(grey.shape)
    squares = np.asarray(cv2.sqrBoxFilter(grey, cv2.CV_32F, window), np.float32).reshape(grey.shape)
    draws: tuple[Draws, ...] = ()
    if own.speckle * own.noise > 0:
        shared = SharedNoise(own.clump_px * focal_px / own.focal_px, own.clump_frames)
        draws = drawn(context, "speckle", depth_m.shape, shared)

    def untextured(
        depth_m: NDArray[np.float32],
        mean: NDArray[np.float32],
        variance: NDArray[np.float32],
        draws: Draws | None = None,
    ) -> NDArray[np.bool_]:
        variance -= mean * mean
        np.maximum(variance, 0, out=variance)
        if own.pattern > 0:
            depth, known = without_void(depth_m)
            lit = quotient(mean * np.float32(own.pattern), depth * depth, known)
            variance += np.square(lit, out=lit)
        if draws is not None:
            variance *= _speckle_squared(draws, own.speckle * own.noise)
        return variance < np.float32(own.least_contrast**2)

    return by_bands(depth_m, np.dtype(np.bool_), untextured, mean, squares, *draws)


def _speckle_squared(draws: Draws, sigma: float) -> NDArray[np.float32]:
    """Return squares (H, W) of gamma variables of mean 1 (Wilson and Hilferty, 1931)."""
    if draws.dtype == np.uint16:
        return look_up(draws.view(np.uint16), _quantiles_of_speckle(sigma))
    third = sigma / 3
    root = scaled(draws, third)
    root += np.float32(1 - third**2)
    np.maximum(root, 0, out=root)
    root *= root * root
    return np.square(root, out=root)


@lru_cache(maxsize=8)
def _quantiles_of_speckle(sigma: float) -> NDArray[np.float32]:
    third = sigma / 3
    return (np.maximum(1 - third**2 + third * normal_quantiles(), 0) ** 6).astype(np.float32)


PERTURBATION = DepthPerturbation(
    name="stereo",
    label="Depth sensor: stereo",
    order=2,
    parameters=Stereo,
    severities={"noise": NOISE_SEVERITIES},
    source="our own: the device's errors, halved and doubled; the law: Intel, librealsense thread 3904",
    about=About(
        "Measures depth by two cameras: coarse far away, lost on plain walls and beside near things",
        "a stereo camera with a projector; needs colour",
        caption="a RealSense D435; shadows lie to the left of what is near.",
        picture="A stereo camera's depth at a quarter, once and four times the device's noise",
    ),
    apply=apply,
    needs_rgb=True,
    temporals=("fresh", "fixed"),
    grain=True,
)
