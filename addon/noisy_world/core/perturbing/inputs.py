# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks and conversion of the arrays and numbers that callers of the library give.

Each function names the argument in its errors: TypeError for what is of another kind, ValueError for values that it may
not have.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from ..schema import describe

LARGEST_SEED = 2**63 - 1  # as in presets
LARGEST_FRAME = 2**64 - 1  # what a random stream can count

_ROUNDING = 1e-6  # chosen: by how much float32 arithmetic may miss [0, 1]; it is clipped


def checked_colour(argument: str, image: Any) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return colour (H, W, 3), contiguous, as uint8 or float32 in [0, 1]. Other floating types become float32."""
    _check_array(argument, image, "uint8, or float in [0, 1]")
    if image.ndim != 3 or image.shape[2] != 3:
        alpha = "; leave the alpha channel out" if image.ndim == 3 and image.shape[2] == 4 else ""
        raise TypeError(f"{argument} has the shape {image.shape}, but colour has to be (H, W, 3){alpha}")
    _check_pixels(argument, image)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if image.dtype.kind != "f":
        remedy = "convert it to uint8, or divide by its largest value"
        raise TypeError(f"{argument} is {image.dtype}, but colour has to be uint8, or float32 in [0, 1]; {remedy}")
    pixels = _as_float32(argument, image)
    low, high = float(pixels.min()), float(pixels.max())
    if low < -_ROUNDING or high > 1.0 + _ROUNDING:
        remedy = "divide it by 255" if high <= 255 and low >= 0 and high > 2 else "clip it"
        raise ValueError(f"{argument} holds {low if low < 0 else high:.9g}, but float colour is in [0, 1]; {remedy}")
    return np.clip(pixels, 0.0, 1.0) if low < 0 or high > 1 else pixels


def checked_depth(argument: str, image: Any) -> NDArray[np.float32]:
    """Return planar depth (H, W), metres, 0 = void, contiguous, as float32; other floating types become float32."""
    _check_array(argument, image, "float32")
    if image.ndim != 2:
        raise TypeError(f"{argument} has the shape {image.shape}, but depth has to be (H, W)")
    _check_pixels(argument, image)
    if image.dtype.kind != "f":
        remedy = "divide the steps of a depth image by its steps a metre"
        raise TypeError(f"{argument} is {image.dtype}, but depth has to be float32 in metres; {remedy}")
    depth_m = _as_float32(argument, image, "; write 0 where there is no depth")
    if (lowest_m := float(depth_m.min())) < 0:
        raise ValueError(f"{argument} holds {lowest_m:g} m, but depth is 0 (void) or positive")
    return depth_m


def check_size(argument: str, image: NDArray[Any], beside: NDArray[Any]) -> None:
    """Check that an array has the height and width of the image beside it."""
    if image.shape[:2] != beside.shape[:2]:
        (high, wide), (high_beside, wide_beside) = image.shape[:2], beside.shape[:2]
        raise ValueError(f"{argument} is {wide} x {high} pixels, but the image is {wide_beside} x {high_beside}")


def check_intrinsics(intrinsics: Any, size_px: tuple[int, int] | None = None) -> None:
    """Check that these are None, or the intrinsics of images of this width and height, where one is given."""
    if intrinsics is None:
        return
    if not isinstance(intrinsics, Intrinsics):
        raise TypeError(f"intrinsics is a {type(intrinsics).__name__}, but has to be Intrinsics")
    if size_px is not None and (intrinsics.width_px, intrinsics.height_px) != size_px:
        message = f"{intrinsics.width_px} x {intrinsics.height_px}"
        raise ValueError(f"intrinsics is of {message} pixels, but the image is {size_px[0]} x {size_px[1]}")


def checked_whole_number(argument: str, value: Any, largest: int) -> int:
    """Return a number from 0 to `largest`, of Python's type."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a whole number")
    if not 0 <= value <= largest:
        raise ValueError(f"{argument} is {describe(int(value))}, but has to be from 0 to {largest}")
    return int(value)


def checked_rate(argument: str, value: Any) -> float | None:
    """Return a number above 0, such as a rate in hertz, or None."""
    rate = checked_number(argument, value)
    if rate is not None and rate <= 0:
        raise ValueError(f"{argument} is {describe(value)}, but has to be above 0")
    return rate


def checked_number(argument: str, value: Any) -> float | None:
    """Return a finite number, or None."""
    if value is None:
        return None
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a number")
    if not abs(value) <= float(np.finfo(np.float64).max) or not math.isfinite(value):
        raise ValueError(f"{argument} is {describe(value)}, but has to be finite")
    return float(value)


def checked_text(argument: str, value: Any) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise TypeError(f"{argument} is {describe(value)}, but has to be a text")
    return value


def plain(value: Any) -> Any:
    """Return numpy's numbers and arrays, also inside mappings and lists, as Python's: what a preset may hold."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [plain(item) for item in value]
    return value


def _check_array(argument: str, image: Any, wanted: str) -> None:
    if not isinstance(image, np.ndarray):
        raise TypeError(f"{argument} is {describe(image)}, but has to be a numpy array, {wanted}")
    if isinstance(image, np.ma.MaskedArray):
        raise TypeError(f"{argument} is a masked array, whose mask would be lost; fill it")


def _check_pixels(argument: str, image: NDArray[Any]) -> None:
    if not image.size:
        raise ValueError(f"{argument} has the shape {image.shape}, which has no pixels")


def _as_float32(argument: str, image: NDArray[Any], remedy: str = "") -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        made = np.ascontiguousarray(image, dtype=np.float32)
    finite = np.isfinite(made)
    if not finite.all():
        row, column = (int(index[0]) for index in np.nonzero(~finite)[:2])
        raise ValueError(f"{argument} holds {image[row, column].max():g} at row {row}, column {column}{remedy}")
    return made
