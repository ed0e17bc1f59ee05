# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices that measure depth: what several of them have in common."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.schema import key
from ..kinds import FrameContext
from ._arrays import ROWS, bands, by_bands, quotient, without_void
from ._noise import SharedNoise, drawn, scaled

P = TypeVar("P")
F = TypeVar("F", np.float32, np.float64)

Devices = Mapping[str, Mapping[str, float]]
"""By a device's name the values of the parameters that are its own."""

DEVICE_TOOLTIPS = {
    "device": "Whose values are taken where a field is below 0",
    "noise": "Higher: everything random is stronger; 0 leaves rounding and holes",
    "focal_px": "Higher: the sensor's own image has more pixels to a degree, so depth gets better",
    "baseline_m": "Higher: depth gets better, and the shadows beside things wider",
    "step_px": "Higher: far depth is in larger steps",
    "shift_px": "Higher: edges get more ragged",
    "min_m": "Higher: more of what is near has no depth",
    "max_m": "Lower: more of what is far has no depth",
    "correlation_px": "Higher: errors come in larger patches, so that averaging neighbours helps less",
    "correlation_share": "Higher: less of the noise is each pixel's own",
    "correlation_frames": "Higher: errors stay for more frames, so that averaging frames helps less",
    "clump_px": "Higher: holes are fewer and larger",
    "clump_frames": "Higher: holes stay for more frames",
    "least_light": "Higher: more of what is far, or seen at a glancing angle, has no depth",
    "reflectance_spread": "Higher: holes are everywhere; lower: where it is far or glancing",
    "blind_px": "Higher: a wider strip at the right has no depth",
    "blind_left_px": "Higher: a wider strip at the left has no depth",
    "blind_top_px": "Higher: a wider strip at the top has no depth",
    "blind_bottom_px": "Higher: a wider strip at the bottom has no depth",
}
LIGHT_STEP_PX = 4  # of the grid on which light is calculated; chosen
MOST_FRAMES = 32  # whose random numbers are drawn for one; chosen
NOISE_SEVERITIES = (0.25, 0.5, 1.0, 2.0, 4.0)  # times the device's: halved and doubled around it


def of_device(meaning: str, maximum: float, unit: str = "", **words: Any) -> Any:
    """Return the field of a number that is the device's where it is below 0, by default. words: as for `key`."""
    return key(f"{meaning}; below 0: the device's", default=-1.0, unit=unit, minimum=-1, maximum=maximum, **words)


def noise_of_device() -> Any:
    """Return the field of the number that all noise of a device is multiplied by, which severity sets."""
    return key("random errors, times the device's", default=NOISE_SEVERITIES[2], minimum=0, maximum=100)


_SHARING: Mapping[str, Callable[[], Any]] = {
    "correlation_px": lambda: of_device(
        "distance at which errors have a correlation of 1 / e; 0: pixels have their own",
        200,
        "px",
        slider=(0, 10),
        later=True,
    ),
    "correlation_frames": lambda: _frames(
        "frames whose errors go with one another, less with each between; 1: none", label="Error Frames"
    ),
    "correlation_share": lambda: of_device(
        "share of errors' variance that goes with neighbours' and frames'; the rest is each pixel's own",
        1,
        label="Error Share",
        later=True,
    ),
    "clump_px": lambda: of_device(
        "how large holes are, as correlation_px; 0: of single pixels", 200, "px", slider=(0, 80), later=True
    ),
    "clump_frames": lambda: _frames("frames that holes stay for, as correlation_frames"),
    "least_light": lambda: of_device(
        "least light that is given, of that from a surface of middling reflectance, 1 m away and seen head on; 0: any",
        1000,
        slider=(0, 0.1),
        later=True,
    ),
    "reflectance_spread": lambda: of_device(
        "standard deviation of reflectance's natural logarithm", 10, label="Spread of Light", later=True
    ),
    "blind_px": lambda: _strip("right"),
    "blind_left_px": lambda: _strip("left"),
    "blind_top_px": lambda: _strip("top"),
    "blind_bottom_px": lambda: _strip("bottom"),
}


def sharing(name: str) -> Any:
    """Return the field of a name that several devices have: of `SharedNoise`, of errors (correlation_...) or of what
    makes holes (clump_...), of the light that is needed, or of a strip at a side that is blind.
    """
    return _SHARING[name]()


def _strip(side: str) -> Any:
    return of_device(f"width of the strip at the {side} that gives nothing", 10_000, "px", later=True)


def _frames(meaning: str, label: str = "") -> Any:
    meaning = f"{meaning}; below 0: the device's"
    return key(meaning, default=-1, minimum=-1, maximum=MOST_FRAMES, label=label, later=True)


def shared_errors(own: Any, scale: float = 1.0) -> SharedNoise:
    """Return how far a device's errors are shared; one that says no share shares all.

    scale: how many pixels of this image are one of its own.
    """
    share = own.correlation_share if own.correlation_share >= 0 else 1.0
    return SharedNoise(max(own.correlation_px, 0) * scale, own.correlation_frames, share)


def filled(parameters: P, devices: Devices) -> P:
    """Return parameters with the values of their `device` where theirs are below 0."""
    given: Any = parameters
    own = devices[given.device]
    return replace(given, **{name: value for name, value in own.items() if getattr(given, name) < 0})


def range_contradiction(devices: Devices) -> Callable[[Any], str]:
    """Return what tells of parameters that nothing is between min_m and max_m; a max_m of 0 is left alone."""

    def contradiction(parameters: Any) -> str:
        own = filled(parameters, devices)
        return f"min_m is {own.min_m:g}, more than max_m, {own.max_m:g}" if own.min_m > own.max_m > 0 else ""

    return contradiction


def camera_of(context: FrameContext, name: str) -> Intrinsics:
    """Return the camera of a depth image. Raises TypeError, naming the model, where it is not known."""
    if context.intrinsics is None:
        raise TypeError(f"{name} needs the camera's intrinsics: rays and disparities follow from them")
    return context.intrinsics


def disparity_of(depth_m: NDArray[np.float32], product_px_m: float) -> NDArray[np.float32]:
    """Return focal length x baseline / depth (H, W), 0 where void."""
    return by_bands(depth_m, np.dtype(np.float32), lambda band: quotient(product_px_m, *without_void(band)))


# What a second eye to the right does not see of a depth image: of a stereo camera, or a projector's light.


def shadowed(disparity_px: NDArray[np.float32], scale: float = 1.0) -> NDArray[np.bool_]:
    """Return the mask (H, W) of pixels that something nearer hides from an eye at one baseline to the right.

    disparity_px: (H, W), focal length x baseline / depth, 0 where depth is void: that hides nothing. scale: how many
    pixels of this image are one of it. A pixel at column x is at column x - disparity of the second view. Behind an
    edge the shadow is f b (1 / z_near - 1 / z_far) wide, rounded to whole pixels; behind what is narrower than that it
    ends where the thing ends, to within two pixels. Surfaces that the second eye sees shortened to less than a half
    count as hidden.
    """
    hidden = np.empty(disparity_px.shape, np.bool_)
    reach = 0
    for band, of_band in zip(bands(hidden), bands(disparity_px), strict=True):
        reach = max(reach, _overtaken(of_band * np.float32(scale), band))
    flat = hidden.reshape(-1)
    places = np.flatnonzero(hidden)
    flat[places] = disparity_px.reshape(-1).take(places) > 0
    places = np.flatnonzero(hidden)
    if places.size:
        flat[places] = _covered(disparity_px, np.float32(scale), places, reach)
    return hidden


def _overtaken(disparity_px: NDArray[np.float32], hidden: NDArray[np.bool_]) -> int:
    """Mark in `hidden`, for rows (H, W), which pixels something to their right lies left of in the second view.

    Returns how far to the right that can be: it has more disparity by as much as it lies farther right, but for the
    half pixel from a centre to an edge. Void lies at its own column there and so is in front of nothing.
    """
    seen = np.arange(disparity_px.shape[1], dtype=np.float32) - disparity_px
    reach = int(min(disparity_px.max(), disparity_px.shape[1])) + 2
    edge = _least_right(seen, reach)
    edge -= np.float32(0.5)
    np.greater(seen, edge, out=hidden)
    return reach


def _least_right(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Return the least of at least `reach` values to the right of each (H, W), as far as there are so many.

    That is the least of as many neighbours as the root of them, and then of such groups.
    """
    import cv2

    group = math.isqrt(reach) + 1
    groups = np.zeros((1, 1 + group * group), np.uint8)
    groups[:, 1::group] = 1
    least = cv2.erode(values, np.ones((1, group), np.uint8), anchor=(0, 0))
    return np.asarray(cv2.erode(least, groups, anchor=(0, 0)), np.float32).reshape(values.shape)


def _covered(
    disparity_px: NDArray[np.float32], scale: np.float32, places: NDArray[np.intp], reach: int
) -> NDArray[np.bool_]:
    """Return (N,), for the pixels at `places` of the image, whether another is in front of them in the second view.

    Of pixels that meet there the one farther right is the nearer one, so in a row drawn from left to right the last one
    stays (McMillan, An image-based approach to three-dimensional computer graphics, 1997). Only those that are at most
    `reach` and some pixels to the right can be.
    """
    import cv2

    height, width = disparity_px.shape
    asked = np.zeros((height, width), np.uint8)
    asked.reshape(-1)[places] = 1
    near = cv2.dilate(asked, np.ones((1, reach + 6), np.uint8), anchor=(reach + 5, 0))
    column, cells = _drawn(disparity_px, scale, np.flatnonzero(np.asarray(near).view(np.bool_)))
    # A column at the left for what is left of the second view, and one at the right as everything has neighbours.
    front = np.full(height * (width + 2), -1, np.int32)
    front[cells] = column
    column, cells = _drawn(disparity_px, scale, places)
    # Outside its own neighbours: the next pixel of the same surface is in the next cell.
    behind = np.maximum(front.take(cells), front.take(cells + 1)) >= column + 2
    inner = cells % (width + 2) > 1
    behind |= (front.take(cells - 1) >= column + 2) & inner
    return behind | (cells % (width + 2) == 0)


def _drawn(
    disparity_px: NDArray[np.float32], scale: np.float32, places: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the columns (N,) of pixels, and their places in the second view, which has a column more at each side."""
    width = disparity_px.shape[1]
    rows = places // width
    column = places - rows * width
    seen = column.astype(np.float32)
    seen -= disparity_px.reshape(-1).take(places) * scale
    cells = np.rint(seen, out=seen).astype(np.intp)
    np.maximum(cells, -1, out=cells)
    cells += 1
    cells += rows * (width + 2)
    return column, cells


# How obliquely the rays of a depth image meet its surfaces.


TINY = 1e-30


def cosine_of_incidence(depth_m: NDArray[np.float32], camera: Intrinsics) -> NDArray[np.float32]:
    """Return (H, W): the cosine of the angle between each ray and the surface's normal, in (0, 1]; 1 where void.

    depth_m: (H, W) planar depth, 0 = void. On a plane 1 / depth is linear in the pixels, so its differences give the
    normal exactly. Of the differences to both neighbours the smaller one is taken: the other may cross an edge.
    """
    height, width = depth_m.shape
    padded = np.zeros((height + 2, width + 2), np.float32)  # outside is void: a large difference, taken if it is alone
    padded[1:-1, 1:-1] = quotient(1.0, depth_m, depth_m > 0)
    x = (np.arange(width) - camera.cx_px).astype(np.float32)
    y = (np.arange(height) - camera.cy_px).astype(np.float32)[:, None]
    fx, fy = np.float32(camera.fx_px), np.float32(camera.fy_px)
    ray = np.square(x / fx) + np.float32(1)
    found = np.empty_like(depth_m)
    for top in range(0, height, ROWS):
        rows = slice(top, min(top + ROWS, height))
        band = padded[top : rows.stop + 2]
        here = band[1:-1, 1:-1]
        right = smaller(band[1:-1, 2:] - here, here - band[1:-1, :-2], width)
        down = smaller(band[2:, 1:-1] - here, here - band[:-2, 1:-1], height)
        towards = here - x * right - y[rows] * down
        right *= fx
        down *= fy
        length = towards * towards
        length += right * right
        length += down * down
        length *= ray + np.square(y[rows] / fy)
        np.sqrt(length, out=length)
        length += np.float32(TINY)  # void has none
        np.divide(here, length, out=length)
        length[here == 0] = 1
        found[rows] = np.minimum(length, np.float32(1))
    return found


# Holes that are of no shape: too little light, and strips at the sides.


def dim(
    depth_m: NDArray[np.float32], own: Any, context: FrameContext, camera: Intrinsics, scale: float = 1.0
) -> NDArray[np.bool_]:
    """Return the mask (H, W) of what gives less than the least light.

    own: the device's least_light, reflectance_spread, clump_px and clump_frames. scale: how many pixels of this image
    are one of the device's. Where clumps are large it is interpolated from every 4th pixel: between them its logarithm
    deviates by 3 % less.
    """
    import cv2

    clump = max(own.clump_px, 0) * scale
    step = LIGHT_STEP_PX if clump >= 4 * LIGHT_STEP_PX else 1
    height, width = depth_m.shape
    places = [np.minimum(np.arange(0, side, step) + step // 2, side - 1) for side in (height, width)]
    depth, known = without_void(depth_m[np.ix_(*places)])
    axis = (camera.cx_px - step // 2) / step, (camera.cy_px - step // 2) / step
    coarse = Intrinsics(depth.shape[1], depth.shape[0], camera.fx_px / step, camera.fy_px / step, *axis)
    light = np.log(quotient(cosine_of_incidence(depth, coarse), depth * depth, known) + ~known)
    (reflectance,) = drawn(context, "reflectance", depth.shape, SharedNoise(clump / step, own.clump_frames))
    light += scaled(reflectance, max(own.reflectance_spread, 0))
    whole = cv2.resize(light, (depth.shape[1] * step, depth.shape[0] * step), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole).reshape(depth.shape[0] * step, -1)[:height, :width] < np.float32(math.log(own.least_light))


def drop_blind(image: NDArray[np.float32], own: Any, scale: float = 1.0) -> None:
    """Clear, in place, the strips at the sides of an image (H, W) that give nothing."""
    right, left, top, bottom = (
        round(max(width, 0) * scale)
        for width in (own.blind_px, own.blind_left_px, own.blind_top_px, own.blind_bottom_px)
    )
    image[:, max(image.shape[1] - right, 0) :] = 0
    image[:, :left] = 0
    image[:top] = 0
    image[max(image.shape[0] - bottom, 0) :] = 0


def smaller(one: NDArray[F], other: NDArray[F], count: int = 2) -> NDArray[F]:
    """Return the one nearer to 0, element by element; 0 along a side of a single pixel, which has no neighbours."""
    return np.zeros_like(one) if count == 1 else np.where(np.abs(one) < np.abs(other), one, other)
