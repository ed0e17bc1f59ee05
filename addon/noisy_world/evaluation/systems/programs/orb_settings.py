# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that ORB-SLAM is given for a camera; they are the same for every implementation."""

import statistics
from itertools import pairwise

# As TUM1.yaml of ORB-SLAM3 has them, but for what follows from camera and rate. The baseline of a virtual right camera
# says how much depth counts against pixels. TUM1.yaml has 40 pixels of disparity at a metre, for a Kinect; with depth
# as exact as a renderer's, 80 nearly halve the error of two clean embedded rooms at 320 x 240.
BASELINE_PX_M = 80.0
NEAR_M = 3.1  # points that are farther are triangulated from several frames: 40 px / 517 px * 40, of TUM1.yaml
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


def settings_text_2(index: dict) -> str:
    """Return ORB-SLAM2's settings for a camera and its rate: the same, but for names and pixels for the baseline."""
    text = settings_text(index)
    for name, older in NAMES_2.items():
        text = text.replace(name, older)
    baseline_m = float(text.partition("Stereo.b: ")[2].partition("\n")[0])
    return f"{text}Camera.bf: {baseline_m * index['camera']['fx']:.9f}\n"


def settings_text(index: dict) -> str:
    """Return ORB-SLAM3's settings for a camera and its rate."""
    camera = index["camera"]
    baseline_m = BASELINE_PX_M / camera["fx"]
    return SETTINGS.format(
        **camera,
        fps=max(1, round(1.0 / gap_of(index))),
        baseline_m=baseline_m,
        near_baselines=NEAR_M / baseline_m,
        features=FEATURES,
    )


def gap_of(index: dict) -> float:
    """Return the seconds between frames; those of 20 Hz for a single frame."""
    stamps_s = [frame["stamp_s"] for frame in index["frames"]]
    return statistics.median(b - a for a, b in pairwise(stamps_s)) if len(stamps_s) > 1 else 0.05
