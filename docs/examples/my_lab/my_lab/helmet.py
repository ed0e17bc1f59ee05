# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera on our helmet."""

from noisy_world.extend import CameraDevice, Intrinsics

CAMERA = CameraDevice(
    "helmet",
    "Helmet Camera",
    "a global shutter that sees wide",
    Intrinsics(640, 480, 320.0, 320.0, 319.5, 239.5),
    {},
    {"vignetting": {"corner_loss": 0.4}},
    {"lens": "our calibration of one unit", "vignetting": "measured on a white wall"},
)
