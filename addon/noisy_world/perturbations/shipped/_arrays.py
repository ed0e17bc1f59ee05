# SPDX-License-Identifier: GPL-3.0-or-later
"""Images and depth as arrays: in bands of rows, kept for a sequence, without void, blurred by kernels."""

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.schema import key
from ...images.pixels import as_float, rgb_bytes
from ..kinds import QUICK, FrameContext

T = TypeVar("T", bound=np.generic)
U = TypeVar("U", bound=np.generic)
Level = TypeVar("Level", np.float32, np.uint8)  # of a colour: from 0 to 1, or a byte

# 32 rows x any width x 3 codes of 16 bits fill whole 64-bit words of Philox, so bands draw what whole frames would.
ROWS = 32


def bands(image: NDArray[T]) -> Iterator[NDArray[T]]:
    """Yield bands of 32 rows from the top down, the last one of what is left."""
    for top in range(0, len(image), ROWS):
        yield image[top : top + ROWS]


def by_bands(
    image: NDArray[T], dtype: np.dtype[U], perturb: Callable[..., NDArray[Any]], *others: NDArray[Any]
) -> NDArray[U]:
    """Apply `perturb`, which returns arrays of `dtype`, to bands of 32 rows from the top down; return the whole image.

    others: images as high as this one, whose bands `perturb` is given too. A band's intermediate arrays stay in the
    processor's cache; those of a whole frame are allocated anew each time. Measured: shot noise takes 9 ms by bands and
    22 ms on the whole frame, brightness 2 ms and 7 ms.
    """
    result = np.empty(image.shape, dtype)
    for parts in zip(*map(bands, (result, image, *others)), strict=True):
        parts[0][:] = perturb(*parts[1:])
    return result


def colour_by_bands(
    rgb: NDArray[Level], perturb: Callable[..., NDArray[np.float32]], *others: NDArray[Any]
) -> NDArray[Level]:
    """Apply `perturb`, which takes and returns float colour, to bands of (H, W, 3), float32 or uint8, as `by_bands`.

    Bytes are made float before it and rounded after it, as on the whole image, in half the time.
    """
    if rgb.dtype != np.uint8:
        return by_bands(rgb, rgb.dtype, perturb, *others)
    return by_bands(rgb, rgb.dtype, lambda band, *parts: rgb_bytes(perturb(as_float(band), *parts)), *others)


# Periodic patterns (on a torus): looking at a part of one, moving it, and keeping it for a whole sequence.


P = ParamSpec("P")
Drawn = TypeVar("Drawn")

_KEPT = 8  # patterns of the last 8 sequences; chosen, so that memory does not grow with the number of sequences


def kept_for_sequence(
    draw: Callable[Concatenate[FrameContext, P], Drawn],
) -> Callable[Concatenate[FrameContext, P], Drawn]:
    """Decorate `draw`, so that it draws once per sequence unless the pattern is fresh for each frame.

    `draw` takes its random numbers from `pattern_stream`. Threads and frames share what it returns, so nobody may write
    to it.
    """
    kept = lru_cache(maxsize=_KEPT)(draw)

    @wraps(draw)
    def pick(context: FrameContext, *args: P.args, **kwargs: P.kwargs) -> Drawn:
        if context.temporal == "fresh":
            return draw(context, *args, **kwargs)
        # Leave out what belongs to one frame: else the cache would miss, and keep the frame's images in memory.
        return kept(context.for_sequence(), *args, **kwargs)

    return pick


def torus_window(
    field: NDArray[np.float32],
    size: tuple[int, int],
    step: tuple[float, float] = (1.0, 1.0),
    start: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float32]:
    """Sample a periodic field (H, W) bilinearly: size[0] rows, step[0] apart, from row start[0]; columns likewise."""
    import cv2

    rows, columns = start[0] % field.shape[0], start[1] % field.shape[1]
    matrix = np.array([[step[1], 0.0, columns], [0.0, step[0], rows]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(field, matrix, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_WRAP)
    return np.asarray(seen, np.float32)


def three_channels(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Repeat (H, W) to (H, W, 3). Adding the result to an image is ten times as fast as broadcasting (H, W, 1)."""
    import cv2

    return np.asarray(cv2.merge([layer, layer, layer]), np.float32)


def halved_nearest(image: NDArray[T]) -> NDArray[T]:
    """Return (H, W, ...) at half the size, rounded: of each pair of rows the upper one, of columns the right one."""
    height, width = image.shape[:2]
    rows, columns = (
        ((np.arange(half) + 0.5) * (side / half)).astype(int)
        for side, half in ((height, (height + 1) // 2), (width, (width + 1) // 2))
    )
    return image[(height - 1 - rows)[::-1]][:, columns]  # rows are counted from below, as nodes do


# Finding the pixels of a depth image that have no depth (void).


# Farther than any surface: a renderer's Depth pass has 1e10 where it saw none.
SKY_M = 1e9


def without_void(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a copy (H, W) with 0 for all that is no depth (negative, infinite, NaN), and the mask (H, W) of depths."""
    valid = (depth_m > 0) & (depth_m < np.inf)
    return np.where(valid, depth_m, np.float32(0)), valid


def quotient(
    above: NDArray[np.float32] | float, below: NDArray[np.float32], known: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Return above / below (H, W), 0 where not known, in a third of the time of numpy's division with a mask."""
    divisor = np.where(known, below, np.float32(np.inf))
    return np.divide(above if isinstance(above, np.ndarray) else np.float32(above), divisor, out=divisor)


# The field of view, for weather whose camera may be unknown.


def by_camera(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the parameter that intrinsics decide: the field of view."""
    return {"view_deg": math.degrees(2 * math.atan(intrinsics.width_px / 2 / intrinsics.fx_px))}


def view_key() -> float:
    """Return the parameter of the field of view."""
    return key(
        "horizontal field of view, where the camera is unknown", default=90.0, unit="deg", minimum=1, maximum=170
    )


def frame_rate_key() -> float:
    """Return the parameter of the frames a second."""
    return key("frames a second, by which it drifts", default=20.0, unit="Hz", minimum=0.001, maximum=100000)


def camera_of(intrinsics: Intrinsics | None, size_px: tuple[int, int], view_deg: float) -> Intrinsics:
    """Return the intrinsics or, where they are unknown, those of a field of view. size_px: width, height."""
    if intrinsics is not None:
        return intrinsics
    width, height = size_px
    focal = width / 2 / math.tan(math.radians(view_deg / 2))
    return Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


# The quick way of what takes long.


QUICKLY = {QUICK: True}
"""What steps that are newly written have."""
QUICK_NOISE = "On: another pattern of the same kind, in less time"


def quick_key(how: str = "draw random numbers by a shorter hash in node groups: as random, in half the time") -> bool:
    """Return the parameter by which a perturbation does the same in less time. how: it does so, and what differs."""
    return key(how, default=False, later=True, label="Quick")


# The optical axis in the image, for what a lens does around it.


HALF_PX = 0.5


def axis_by_camera(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the parameters that intrinsics decide: where the axis is, as shares of the image's sides."""
    return {
        "axis_across": (intrinsics.cx_px + HALF_PX) / intrinsics.width_px,
        "axis_down": (intrinsics.cy_px + HALF_PX) / intrinsics.height_px,
    }


def axis_px(
    intrinsics: Intrinsics | None, size_px: tuple[int, int], axis_across: float, axis_down: float
) -> tuple[float, float]:
    """Return the column and row of the axis: of the intrinsics or, where they are unknown, by shares of the size."""
    if intrinsics is not None:
        return intrinsics.cx_px, intrinsics.cy_px
    return axis_across * size_px[0] - HALF_PX, axis_down * size_px[1] - HALF_PX


# The blur kernels of lens and motion, and correlation with a kernel.


# filter2D correlates directly, and skips a kernel's zeros, up to 11 x 11 pixels (OpenCV's documentation); larger
# kernels go through the frequency domain, which takes as long as some 250 multiplications a pixel whatever the kernel.
_DIRECT_AREA = 121  # px
_DENSE = 250  # weights that are not zero


def disk_kernel(radius_px: float) -> NDArray[np.float32]:
    """Return the image of a point out of focus: equal weights up to `radius_px`, their sum 1; (odd, odd), square."""
    reach = math.floor(radius_px)
    offsets = np.arange(-reach, reach + 1)
    disk = offsets[:, None] ** 2 + offsets**2 <= radius_px**2
    return (disk / disk.sum()).astype(np.float32)


def line_kernel(radius_px: int, sigma_px: float, angle_deg: float, least: float = 0.0) -> NDArray[np.float32]:
    """Return the one-sided trace of a motion: (odd, odd), square, the pixel itself in the middle, sum 1.

    The trace has 2 radius + 1 steps of one pixel from the middle along `angle_deg` (0 to the right, 90 down). Step k
    has weight exp(-k^2 / (2 sigma^2)), as in ImageNet-C, which follows ImageMagick's motion blur. A step goes to the
    nearest pixel; half way between two, to the left or upper one. least: steps of no larger weight are left out.
    """
    steps = np.arange(2 * radius_px + 1)
    weights = np.exp(-(steps**2) / (2 * sigma_px**2))
    weights[weights <= least] = 0
    angle = math.radians(angle_deg)
    # Rounded to 9 digits first: in float64 the sine of 30 degrees is a bit less than 0.5, the cosine of 60 a bit more.
    columns = np.ceil((steps * math.cos(angle)).round(9) - 0.5).astype(int)
    rows = np.ceil((steps * math.sin(angle)).round(9) - 0.5).astype(int)
    reach = 2 * radius_px
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    np.add.at(kernel, (reach + rows, reach + columns), weights / weights.sum())
    return kernel.astype(np.float32)


def correlate(image: NDArray[np.float32], kernel: NDArray[np.float32]) -> NDArray[np.float32]:
    """Correlate (H, W) or (H, W, 3) with an odd, square kernel about its middle; the border is replicated.

    A kernel of few weights is split into small pieces, in which OpenCV skips the zeros: a line of 41 pixels then costs
    41 multiplications a pixel.
    """
    import cv2

    if np.count_nonzero(kernel) > _DENSE:
        return np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE), np.float32)
    height, width = image.shape[:2]
    middle = kernel.shape[0] // 2
    pieces = list(_pieces(kernel, 0, 0))
    top = middle - min(row for row, _, _ in pieces)
    left = middle - min(column for _, column, _ in pieces)
    bottom = max(row + piece.shape[0] for row, _, piece in pieces) - 1 - middle
    right = max(column + piece.shape[1] for _, column, piece in pieces) - 1 - middle
    top, bottom, left, right = (max(side, 0) for side in (top, bottom, left, right))
    padded = cv2.copyMakeBorder(image, top, bottom, left, right, cv2.BORDER_REPLICATE)
    total: NDArray[np.float32] | None = None
    for row, column, piece in pieces:
        y, x = top + row - middle, left + column - middle
        part = padded[y : y + height + piece.shape[0] - 1, x : x + width + piece.shape[1] - 1]
        result = np.asarray(cv2.filter2D(part, -1, piece, anchor=(0, 0)), np.float32)[:height, :width]
        total = result if total is None else np.add(total, result, out=total)
    assert total is not None
    return total


def _pieces(kernel: NDArray[np.float32], row: int, column: int) -> Iterator[tuple[int, int, NDArray[np.float32]]]:
    """Yield (row, column, piece): pieces of at most _DIRECT_AREA that together hold every weight but zeros."""
    rows, columns = kernel.any(axis=1).nonzero()[0], kernel.any(axis=0).nonzero()[0]
    if not rows.size:
        return
    kernel = kernel[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    row, column = row + int(rows[0]), column + int(columns[0])
    if kernel.size <= _DIRECT_AREA:
        yield row, column, kernel
        return
    axis = int(kernel.shape[1] >= kernel.shape[0])
    half = kernel.shape[axis] // 2
    first, second = np.split(kernel, [half], axis=axis)
    yield from _pieces(first, row, column)
    yield from _pieces(second, row + half * (axis == 0), column + half * (axis == 1))


def gaussian(image: NDArray[np.float32], sigma_px: float) -> NDArray[np.float32]:
    """Blur (H, W) or (H, W, 3) with a Gaussian cut off at 4 sigma, the border replicated; sigma 0 copies."""
    import cv2

    if sigma_px == 0:
        return image.copy()
    size = 2 * int(4 * sigma_px + 0.5) + 1
    blurred = cv2.GaussianBlur(image, (size, size), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def as_blur_node(image: NDArray[np.float32], size_px: float) -> NDArray[np.float32]:
    """Blur (H, W, 3) as Blender's Blur node does with its Gaussian, separable: sigma is a third of the size.

    Its last weight is that of the first whole pixel from the size on; the border is replicated.
    """
    import cv2

    if size_px == 0:
        return image.copy()
    places = np.arange(-math.ceil(size_px), math.ceil(size_px) + 1)
    weights = np.exp(-4.5 * (places / size_px) ** 2)
    weights /= weights.sum()
    blurred = cv2.sepFilter2D(image, -1, weights, weights, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)
