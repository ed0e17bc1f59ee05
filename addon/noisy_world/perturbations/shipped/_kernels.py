# SPDX-License-Identifier: GPL-3.0-or-later
"""The blur kernels of lens and motion, and correlation with a kernel."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

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
