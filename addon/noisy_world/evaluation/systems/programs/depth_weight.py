# SPDX-License-Identifier: GPL-3.0-or-later
"""How much depth counts beside pixels in ORB-SLAM2 and ORB-SLAM3: their bf, from the noise of the depth itself.

Both turn the depth Z of a corner at column u into the column u - bf / Z that a second camera would see it at, and weigh
that column as they weigh u. So bf says how much depth counts, and it counts rightly where an error of depth moves that
column as far as corners are off: bf * sd(1 / Z) = sd(u).

sd(1 / Z) has two parts. The depth's own noise is measured in the images: along a row 1 / Z is linear on a plane, so
that second differences are noise alone, of 6 times its variance; their median is taken, which edges do not move. And a
corner that is sd(u) off has its depth read beside it, which on a surface of slope t, rise of depth over width, is an
error of 1 / Z of sd(u) * t / (f * Z). This bounds bf where depth is exact: a baseline bf / f of Z / t.

The second camera is put on the left, by a negative bf. Both programs take a column below 0 for "no depth": with a
camera on the right, all corners left of bf / Z lose theirs, half of the image at 90 degrees with a baseline of Z.
"""

import math

import cv2
import numpy as np
from frame_files import read_image

FRAMES = 8  # chosen: of a sequence, in which noise is measured
OF_MEDIAN = 0.6745  # the median of the absolute values of a standard normal variable
OF_SECOND_DIFFERENCE = math.sqrt(6.0)  # 1 + 4 + 1
OF_ROUNDING = 1.0 / math.sqrt(12.0)  # of a step


def baseline_px_m(index: dict, pixel_noise_px: float, slope: float) -> float:
    """Return bf, pixels times metres: negative, as the second camera is on the left.

    index: of the frames. pixel_noise_px: standard deviation of a corner's column. slope: of surfaces. Of a sequence
    without any depth, which no weight can help, it is that of exact depth at 1 m.
    """
    inverse, differences = [], []
    step_m = 1.0 / index["depth_scale_per_m"]
    frames = index["frames"]
    for place in sorted({round(k * (len(frames) - 1) / (FRAMES - 1)) for k in range(FRAMES)}):
        depth_m = read_image(frames[place]["depth"], cv2.IMREAD_UNCHANGED) * step_m
        with np.errstate(divide="ignore"):
            per_m = np.where(depth_m > 0.0, 1.0 / depth_m, np.nan)
        second = per_m[:, :-2] - 2.0 * per_m[:, 1:-1] + per_m[:, 2:]
        inverse.append(per_m[np.isfinite(per_m)])
        differences.append(np.abs(second[np.isfinite(second)]))
    seen, apart = np.concatenate(inverse), np.concatenate(differences)
    middle_per_m = float(np.median(seen)) if seen.size else 1.0
    measured_per_m = float(np.median(apart)) / OF_MEDIAN / OF_SECOND_DIFFERENCE if apart.size else 0.0
    noise_per_m = max(measured_per_m, OF_ROUNDING * step_m * middle_per_m**2)
    beside_per_m = pixel_noise_px * slope * middle_per_m / index["camera"]["fx"]
    return -pixel_noise_px / math.hypot(noise_per_m, beside_per_m)
