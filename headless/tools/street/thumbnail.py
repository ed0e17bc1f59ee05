# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of a frame of the street that the groups' previews are made on.

    python headless/tools/street_frames.py out/frame --size 1200x680 --frames 0 --samples 12
    python headless/tools/street/thumbnail.py out/frame/0000.exr

writes thumbnail.exr, beside this file, anew.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np

from noisy_world.core.geometry import Intrinsics
from tools.street.frames import LitFrame, read_frame, write_frame
from tools.street.scene import FOCAL_WIDTHS

FRAME_PX = (1200, 680)
CUT_PX = (480, 90, 512)  # column, row and side of the part; chosen by eye: a lamp, cars, sky, near and far
SIDE_PX = 256  # the size that Blender stores previews in
GAIN = 1.7  # chosen, for small pictures on a grey ground
STORED = Path(__file__).with_name("thumbnail.exr")


def cut(frame: LitFrame) -> LitFrame:
    """Return the part of a frame of FRAME_PX, smaller; depth is that of single pixels, as it cannot be averaged."""
    left, top, side = CUT_PX
    rgb = frame.rgb[top : top + side, left : left + side] * np.float32(GAIN)
    small = np.asarray(cv2.resize(rgb, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA), np.float32)
    step = side // SIDE_PX
    return LitFrame(small, frame.depth_m[top : top + side : step, left : left + side : step])


def thumbnail() -> LitFrame:
    """Return the frame of the previews."""
    return read_frame(STORED)


def thumbnail_camera() -> Intrinsics:
    """Return its intrinsics, but for the middle, which is taken to be the picture's."""
    focal_px = FOCAL_WIDTHS * FRAME_PX[0] * SIDE_PX / CUT_PX[2]
    return Intrinsics(SIDE_PX, SIDE_PX, focal_px, focal_px, (SIDE_PX - 1) / 2, (SIDE_PX - 1) / 2)


if __name__ == "__main__":
    write_frame(STORED, cut(read_frame(Path(sys.argv[1]))), exact_depth=False)
    print(f"wrote {STORED}")
