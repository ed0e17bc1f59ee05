# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that ORB-SLAM is given for a camera; they are the same for every implementation.

How much depth counts beside pixels is said by bf: from the depth Z of a corner at column u ORB-SLAM makes the column
u - bf / Z of a second camera, and weighs that as it weighs u. So depth counts rightly where its errors move that column
as far as corners are off: bf * sd(1 / Z) = sd(u). sd(1 / Z) has two parts: the noise of the depth itself, which the
index tells, and what comes of reading it beside a corner that is sd(u) off, which on a surface of slope t, rise of
depth over width, is sd(u) * t / (fx * Z). The second bounds bf where depth is exact: a baseline bf / fx of Z / t.

The second camera is on the left, by a negative bf: ORB-SLAM takes a column below 0 for depth that is missing, so with
one on the right all corners left of bf / Z lose theirs; and it triangulates from keyframes that are more than the
baseline apart only, which are all of them where it is negative.
"""

import argparse
import math
import statistics
from itertools import pairwise

# As TUM1.yaml of ORB-SLAM3 has them, but for what follows from camera, rate and depth.
FEATURES = 1000
SETTINGS = """%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: {fx:.9f}
Camera1.fy: {fy:.9f}
Camera1.cx: {cx:.9f}
Camera1.cy: {cy:.9f}
Camera1.k1: 0.0
Camera1.k2: 0.0
Camera1.p1: 0.0
Camera1.p2: 0.0
Camera.width: {width:d}
Camera.height: {height:d}
Camera.fps: {fps:d}
Camera.RGB: 1
Stereo.b: {baseline_m:.9f}
Stereo.ThDepth: {near_baselines:.9f}
RGBD.DepthMapFactor: 1.0
ORBextractor.nFeatures: {features:d}
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""

NAMES_2 = {"Camera1.": "Camera.", "Stereo.ThDepth": "ThDepth", "RGBD.DepthMapFactor": "DepthMapFactor"}
"""What ORB-SLAM2 calls a setting of ORB-SLAM3."""


def settings_text_2(index: dict, options: argparse.Namespace) -> str:
    """Return ORB-SLAM2's settings: those of ORB-SLAM3, but for names, and with the baseline in pixels times metres."""
    text = settings_text(index, options)
    for name, older in NAMES_2.items():
        text = text.replace(name, older)
    baseline_m = float(text.partition("Stereo.b: ")[2].partition("\n")[0])
    return f"{text}Camera.bf: {baseline_m * index['camera']['fx']:.9f}\n"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how depth counts: a system's definition names their values, as they decide results."""
    parser.add_argument("--mono", action="store_true", help="without depth")
    parser.add_argument("--pixel-noise-px", type=float, help="standard deviation of a corner's column")
    parser.add_argument("--slope", type=float, help="of surfaces, rise of depth over width")
    parser.add_argument("--bf-px-m", type=float, help="in place of the last two: how much depth counts, as it is given")
    parser.add_argument("--near-m", type=float, help="points that are farther are triangulated from several frames")


def settings_text(index: dict, options: argparse.Namespace) -> str:
    """Return ORB-SLAM3's settings for a camera, its rate and its depth. options: as add_options has them."""
    camera = index["camera"]
    baseline_m, near_m = 1.0, 1.0  # which mean nothing without depth
    if not options.mono:
        by_noise, given = (options.pixel_noise_px, options.slope), options.bf_px_m
        if options.near_m is None or (None in by_noise) == (given is None):
            raise SystemExit("with depth, --near-m is needed, and --pixel-noise-px with --slope, or --bf-px-m")
        near_m = options.near_m
        baseline_m = (bf_px_m(index, *by_noise) if given is None else given) / camera["fx"]
    return SETTINGS.format(
        **camera,
        fps=max(1, round(1.0 / gap_of(index))),
        baseline_m=baseline_m,
        near_baselines=near_m / baseline_m,
        features=FEATURES,
    )


def bf_px_m(index: dict, pixel_noise_px: float, slope: float) -> float:
    """Return bf, pixels times metres. pixel_noise_px: of a corner's column. slope: of surfaces.

    Of a sequence that has no depth, which no weight can help, it is that of exact depth at 1 m.
    """
    known = index["inverse_depth"] or {"median_per_m": 1.0, "noise_per_m": 0.0}
    beside_per_m = pixel_noise_px * slope * known["median_per_m"] / index["camera"]["fx"]
    return -pixel_noise_px / math.hypot(known["noise_per_m"], beside_per_m)


def gap_of(index: dict) -> float:
    """Return the seconds between frames; those of 20 Hz for a single frame."""
    stamps_s = [frame["stamp_s"] for frame in index["frames"]]
    return statistics.median(b - a for a, b in pairwise(stamps_s)) if len(stamps_s) > 1 else 0.05
