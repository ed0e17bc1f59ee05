# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimates of SLAM systems: from what a system wrote to poses of frames. Studies, `score` and the library read so.

A format is one module with a `FORMAT`, and its name in the list in `reading`.
"""

from ...core.errors import NotFiniteError
from .format import Asked, EstimateFormat
from .frames import Frames, Index
from .poses import ReadPoses
from .reading import FORMATS, estimate_of, match_frames, read_estimate, read_poses

__all__ = [
    "FORMATS",
    "Asked",
    "EstimateFormat",
    "Frames",
    "Index",
    "NotFiniteError",
    "ReadPoses",
    "estimate_of",
    "match_frames",
    "read_estimate",
    "read_poses",
]
