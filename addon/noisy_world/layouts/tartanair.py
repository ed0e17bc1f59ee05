# SPDX-License-Identifier: GPL-3.0-or-later
"""TartanAir: image_left, depth_left and pose_left.txt.

https://github.com/castacks/tartanair_tools, data_type.md: 640 x 480 PNG, "fx = 320.0, fy = 320.0, cx = 320.0,
cy = 240.0", depth as NPY in metres, poses as `tx ty tz qx qy qz qw` in the NED frame, a line for each image;
image_left/000000_left.png and depth_left/000000_left_depth.npy as DROID-SLAM's and others' loaders have them.
"""

from ..core.geometry import Intrinsics
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, PoseFilesSpec, SequenceSpec


class TartanAirLayout(DescribedLayout):
    """`image_left/000000_left.png`, `depth_left/000000_left_depth.npy` and `pose_left.txt`."""

    name = "tartanair"
    order = 140
    label = "TartanAir"
    meaning = "a trajectory of TartanAir: the left camera, depth in metres, poses in an aircraft's axes"
    files = "image_left/000000_left.png, depth_left/000000_left_depth.npy, pose_left.txt"
    told_by = ("image_left/*.png", "pose_left.txt")
    described = SequenceSpec(
        rgb=ImageFilesSpec("image_left/*_left.png"),
        depth=DepthFilesSpec("depth_left/*_left_depth.npy"),
        poses=PoseFilesSpec("pose_left.txt", format="tartanair"),
    )
    documented = Intrinsics(640, 480, 320.0, 320.0, 320.0, 240.0)
    assumed = "the dataset's camera of fx = fy = 320 and (320, 240) is used; camera says another"


LAYOUT = TartanAirLayout()
