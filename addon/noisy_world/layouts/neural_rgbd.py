# SPDX-License-Identifier: GPL-3.0-or-later
"""Neural RGB-D: images, depth, focal.txt and poses.txt.

https://github.com/dazinovic/neural-rgbd-surface-reconstruction, README.md: images/img0.png, depth/depth0.png
(depth_filtered and depth_with_noise beside), focal.txt "a single floating point value representing the focal length of
the camera in pixels", poses.txt and trainval_poses.txt "in the format 4N x 4", with "the OpenGL convention"; a pose
that is not known is nan. load_scannet.py: depth in millimetres, the focal length is that of images of depth's size, to
which colour is resized. nerf_helpers.py: rays go through (i + 0.5 - W / 2) / focal.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..trajectories.pose_files import read_text as read_numbers
from ..trajectories.pose_files import text_rows
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, PoseFilesSpec, SequenceSpec, Told
from .numbered import Cameras
from .stored_recording import size_of

FOCAL = "focal.txt"
DEPTHS = ("depth", "depth_filtered", "depth_with_noise")  # the first that is there
POSES = ("poses.txt", "trainval_poses.txt")


class NeuralRgbdLayout(DescribedLayout):
    """`images/img0.png`, `depth/depth0.png`, `focal.txt` and `poses.txt`."""

    name = "neural_rgbd"
    order = 150
    label = "Neural RGB-D"
    meaning = "a scene of Neural RGB-D: depth in mm, one focal length, poses with OpenGL's axes"
    files = "images/img0.png, depth/depth0.png, focal.txt, poses.txt"
    told_by = ("images/img*.png", FOCAL)
    described = SequenceSpec(rgb=ImageFilesSpec("images/img*.png"))

    def description(self, folder: Path) -> SequenceSpec:
        """Return where the files are, with the first depth and poses that there are."""
        depth = next((name for name in DEPTHS if (folder / name).is_dir()), None)
        poses = next((name for name in POSES if (folder / name).is_file()), POSES[0])
        return replace(
            self.described,
            depth=None if depth is None else DepthFilesSpec(f"{depth}/depth*.png"),
            poses=PoseFilesSpec(poses, format="matrices", axes="opengl"),
        )

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return the camera: the focal length is that of images of depth's size."""
        path = folder / FOCAL
        numbers = text_rows(path, read_numbers(path)).numbers
        if numbers.size != 1 or not 0 < numbers[0] < np.inf:
            raise InputError(path, "has to be one number above 0, the focal length in pixels")
        width_px, height_px = size_of(images[0])
        depth = next((files[0] for name in DEPTHS if (files := sorted((folder / name).glob("depth*.png")))), images[0])
        wide_px, high_px = size_of(depth)
        fx_px, fy_px = float(numbers[0]) * width_px / wide_px, float(numbers[0]) * height_px / high_px
        camera = Intrinsics(width_px, height_px, fx_px, fy_px, (width_px - 1) / 2, (height_px - 1) / 2)
        return Told(Cameras(camera, path))


LAYOUT = NeuralRgbdLayout()
