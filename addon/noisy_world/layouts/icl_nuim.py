# SPDX-License-Identifier: GPL-3.0-or-later
"""ICL-NUIM, its "TUM RGB-D compatible PNGs" with the trajectory beside them.

https://www.doc.ic.ac.uk/~ahanda/VaFRIC/iclnuim.html: rgb/0.png, depth/0.png (16 bits, steps of 1 / 5000 m),
associations.txt, and a trajectory such as livingRoom0.gt.freiburg, whose lines begin with the number of the frame; the
first pose is that of frame 1. Its calibration has fx 481.20, fy -480.00, cx 319.50, cy 239.50: POV-Ray's axes, x right,
y up, z forward, are left-handed, and so is its world. Mirroring y in camera and world keeps every distance, makes fy
positive, and gives rotations again.
"""

from collections.abc import Collection
from decimal import Decimal
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..trajectories.formats import read_trajectory_file
from .cam_params import read_cam_params
from .numbered import LARGEST_NUMBER, Cameras, ImageFiles, NumberedLayout, NumberedPoses
from .stored_recording import MatchedFrames, PosePolicy

TRUTH = "*.gt.freiburg"
CAMERA = Intrinsics(640, 480, 481.2, 480.0, 319.5, 239.5)  # fy without its sign
MIRROR_Y = np.diag([1.0, -1.0, 1.0, 1.0])
_ASSUMED = "the dataset's camera of fx 481.2, fy 480 and (319.5, 239.5) is used; camera says another"
_MIRRORED = "y is mirrored in camera and world: the dataset's axes are left-handed (fy is -480)"


class IclNuimLayout(NumberedLayout):
    """`rgb/0.png`, `depth/0.png`, and a trajectory `*.gt.freiburg`."""

    name = "icl_nuim"
    order = 90
    label = "ICL-NUIM"
    meaning = "a sequence of ICL-NUIM in its TUM form; its left-handed axes (negative fy) are mirrored"
    files = "rgb/0.png, depth/0.png, *.gt.freiburg"
    rgb = ImageFiles("rgb", r"([0-9]+)\.png")
    depth = ImageFiles("depth", r"([0-9]+)\.png")
    depth_scale_per_m = 5000.0

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a trajectory of the dataset beside colour and depth."""
        return any(folder.glob(TRUTH)) and (folder / "rgb").is_dir() and (folder / "depth").is_dir()

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the one trajectory."""
        files = sorted(folder.glob(TRUTH))
        if len(files) > 1:
            raise InputError(folder, f"has {files[0].name} and {files[1].name}", remedy="leave one trajectory in it")
        return None if policy == "none" else files[0]

    def poses(self, path: Path, rgb: Collection[int], depth: Collection[int] | None) -> NumberedPoses:
        """Return the poses by the numbers that their lines begin with, mirrored."""
        del rgb, depth
        found = read_trajectory_file(path, format="tum", stamp_unit="s").trajectory
        numbers = [Decimal(stamp_s) for stamp_s in found.stamps_s.tolist()]
        if any(number != int(number) or not 0 <= number <= LARGEST_NUMBER for number in numbers):
            raise InputError(path, "its lines do not begin with the numbers of frames", remedy="as ICL-NUIM gives it")
        c2w = MIRROR_Y @ found.c2w @ MIRROR_Y + 0.0  # + 0.0: no negative zeros
        return NumberedPoses(path, dict(zip(map(int, numbers), c2w, strict=True)), (_MIRRORED,))

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the camera of a cam_params.json, else the dataset's."""
        del found
        params = read_cam_params(folder)
        scale_per_m = params.depth_scale_per_m if params else None
        if params is None or params.camera is None:
            return Cameras(CAMERA, assumed=_ASSUMED, depth_scale_per_m=scale_per_m)
        return Cameras(params.camera, params.path, depth_scale_per_m=scale_per_m)


LAYOUT = IclNuimLayout()
