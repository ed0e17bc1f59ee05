# SPDX-License-Identifier: GPL-3.0-or-later
"""ICL-NUIM, its "TUM RGB-D compatible PNGs" with the trajectory beside them.

https://www.doc.ic.ac.uk/~ahanda/VaFRIC/iclnuim.html: rgb/0.png, depth/0.png (16 bits, steps of 1 / 5000 m),
associations.txt, and a trajectory such as livingRoom0.gt.freiburg, whose lines begin with the number of the frame; the
first pose is that of frame 1. Its calibration has fx 481.20, fy -480.00, cx 319.50, cy 239.50: POV-Ray's axes, x right,
y up, z forward, are left-handed, and so is its world. Mirroring y in camera and world keeps every distance, makes fy
positive, and gives rotations again.
"""

from decimal import Decimal
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...geometry import Intrinsics
from ...trajectories.files import read_trajectory_file
from ..known_poses import PosePolicy
from ..stored import StoredSequence
from .cam_params import read_cam_params
from .numbered import LARGEST_NUMBER, NumberedPoses, numbered_frames, numbered_images
from .recorded import RECORDED_HZ, RecordedLayout, counted_note

IMAGE = r"([0-9]+)\.png"
SCALE_PER_M = 5000.0
CAMERA = Intrinsics(640, 480, 481.2, 480.0, 319.5, 239.5)  # fy without its sign
MIRROR_Y = np.diag([1.0, -1.0, 1.0, 1.0])
_ASSUMED = "the dataset's camera of fx 481.2, fy 480 and (319.5, 239.5) is used; camera says another"
_MIRRORED = "y is mirrored in camera and world: the dataset's axes are left-handed (fy is -480)"


class IclNuimLayout(RecordedLayout):
    """`rgb/0.png`, `depth/0.png`, and a trajectory `*.gt.freiburg`."""

    name = "icl_nuim"
    label = "ICL-NUIM"
    meaning = "a sequence of ICL-NUIM in its TUM form; its left-handed axes (negative fy) are mirrored"
    files = "rgb/0.png, depth/0.png, *.gt.freiburg"

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a trajectory of the dataset beside colour and depth."""
        return any(folder.glob("*.gt.freiburg")) and (folder / "rgb").is_dir() and (folder / "depth").is_dir()

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Match images and poses by their numbers."""
        files = sorted(folder.glob("*.gt.freiburg"))
        if len(files) > 1:
            raise InputError(folder, f"has {files[0].name} and {files[1].name}", remedy="leave one trajectory in it")
        given = None if poses == "none" else _poses(files[0])
        used_hz = rate_hz or RECORDED_HZ
        images = [numbered_images(folder / name, IMAGE) for name in ("rgb", "depth")]
        found = numbered_frames(folder, images[0], images[1], given, policy=poses, rate_hz=used_hz)
        params = read_cam_params(folder)
        stated = params is not None and params.camera is not None
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            None if given is None else files[0],
            found.trajectory,
            found.stamps,
            params.depth_scale_per_m if params else SCALE_PER_M,
            None,
            params.camera if params and stated else CAMERA,
            params.path if params and stated else None,
            (*found.notes, *counted_note(rate_hz, used_hz), *(() if given is None else (_MIRRORED,))),
            used_hz,
            assumed="" if stated else _ASSUMED,
        )


def _poses(path: Path) -> NumberedPoses:
    found = read_trajectory_file(path, format="tum", stamp_unit="s").trajectory
    numbers = [Decimal(stamp_s) for stamp_s in found.stamps_s.tolist()]
    if any(number != int(number) or not 0 <= number <= LARGEST_NUMBER for number in numbers):
        raise InputError(path, "its lines do not begin with the numbers of frames", remedy="as ICL-NUIM gives it")
    c2w = MIRROR_Y @ found.c2w @ MIRROR_Y + 0.0  # + 0.0: no negative zeros
    return NumberedPoses(path, dict(zip(map(int, numbers), c2w, strict=True)))
