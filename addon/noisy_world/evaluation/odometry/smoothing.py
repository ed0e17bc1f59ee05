# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooths noisy depth, by as much as its noise was measured to be."""

import numpy as np

from .frames import Depth

LITTLE_M = 0.005  # less noise than this is left alone; chosen: rounding to 16 bits is 0.1 mm, a real sensor's 1 to 5 mm
MEDIAN_PX = 5  # the largest that OpenCV has for float
REACH_PX = 3.0  # standard deviation of the bilateral filter; chosen among 0 to 4 on embedded rooms
OF_SECOND_DIFFERENCE = 1.4826 / np.sqrt(6.0)  # MAD of x - 2y + z to the standard deviation of x (normal distribution)


def depth_noise_m(depth_m: Depth) -> float:
    """Return the standard deviation of noise from pixel to pixel, in metres: robust, of second differences along rows.

    NaN is void; without three pixels in a row anywhere the noise is 0.
    """
    second = depth_m[::2, 2:] - 2.0 * depth_m[::2, 1:-1] + depth_m[::2, :-2]
    second = np.abs(second[np.isfinite(second)])
    return float(np.median(second) * OF_SECOND_DIFFERENCE) if len(second) else 0.0


def smoothed(depth_m: Depth) -> Depth:
    """Return depth with its noise averaged out, edges and voids kept; the same array where there is little noise."""
    import cv2

    noise_m = depth_noise_m(depth_m)
    if noise_m < LITTLE_M:
        return depth_m
    known = np.isfinite(depth_m)
    filled = np.where(known, depth_m, np.float32(0.0))
    middle = cv2.medianBlur(filled, MEDIAN_PX)
    out = np.asarray(cv2.bilateralFilter(middle, 0, noise_m, REACH_PX), np.float32)
    out[~known | (out <= 0.0)] = np.nan
    return out
