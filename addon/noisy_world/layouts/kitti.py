# SPDX-License-Identifier: GPL-3.0-or-later
"""KITTI's odometry benchmark: colour of the left camera, with times, calibration and, of sequences 00 to 10, poses.

https://www.cvlibs.net/datasets/kitti/eval_odometry.php, and the readme of its development kit: image_2/000000.png is
the left colour camera, image_0 the left grey one; times.txt has seconds, a line for each image; calib.txt has P0 to P3,
3 x 4 matrices that project points in the axes of camera 0; a line of poses/00.txt takes these points to the world.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..trajectories.formats import read_file_poses
from ..trajectories.pose_files import read_text
from .association import MatchedFrames, PosePolicy
from .layout import intrinsics_of_matrix
from .numbered import Cameras, ImageFiles, NumberedLayout, NumberedPoses
from .stored_recording import size_of

IMAGES = ("image_2", "image_0")  # colour, and grey where there is none
CALIBRATION = "calib.txt"
TIMES = "times.txt"


class KittiLayout(NumberedLayout):
    """`image_2/000000.png`, `times.txt`, `calib.txt`, and `poses.txt`, or `poses/00.txt` beside the sequences."""

    name = "kitti"
    order = 130
    label = "KITTI"
    meaning = "a sequence of KITTI's odometry benchmark: the left camera, without depth"
    files = "image_2/000000.png (or image_0), times.txt, calib.txt, poses.txt or ../../poses/NAME.txt"
    depth = None

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are images of a left camera with a calibration."""
        return (folder / CALIBRATION).is_file() and any((folder / name).is_dir() for name in IMAGES)

    def images(self, folder: Path) -> tuple[dict[int, Path], None]:
        """Return the images of the left camera by number."""
        return ImageFiles(_camera_of(folder), r"([0-9]+)\.(?:png|jpg)").of(folder), None

    def times(self, folder: Path) -> tuple[Path, NDArray[np.float64]] | None:
        """Return the times of the images, by number."""
        path = folder / TIMES
        if not path.is_file():
            return None
        try:
            times_s = np.array([float(word) for word in read_text(path).split()])
        except ValueError:
            times_s = np.full(1, np.nan)
        if not np.isfinite(times_s).all() or np.any(np.diff(times_s) <= 0):
            raise InputError(path, "has to have a time in seconds on each line, each later than the one before")
        return path, times_s

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the file of poses; None where the policy asks for none, or keeps frames without."""
        if policy == "none":
            return None
        places = (folder / "poses.txt", folder.resolve().parents[1] / "poses" / f"{folder.resolve().name}.txt")
        found = next((path for path in places if path.is_file()), None)
        if found is None and policy != "keep":
            remedy = "sequences 11 to 21 have none: poses: none uses the images without ground truth"
            raise InputError(folder, "has no file of poses", remedy=remedy)
        return found

    def poses(self, path: Path, rgb: Collection[int], depth: Collection[int] | None) -> NumberedPoses:
        """Return the poses of camera 0, a line for each image from number 0 on."""
        del rgb, depth
        return NumberedPoses(path, dict(enumerate(read_file_poses(path, format="kitti").poses)))

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the intrinsics of the calibration, and where the camera sits beside camera 0."""
        path, name = folder / CALIBRATION, f"P{_camera_of(folder)[-1]}"
        rows = dict(line.split(":", 1) for line in read_text(path).splitlines() if ":" in line)
        try:
            matrix = np.array(rows.get(name, "").split(), dtype=np.float64).reshape(3, 4)
        except ValueError:
            raise InputError(path, "is no matrix of 3 x 4 numbers", where=name) from None
        camera = intrinsics_of_matrix(path, matrix[:, :3], size_of(found.rgb_files[0]))
        beside = np.eye(4)
        beside[:3, 3] = -np.linalg.solve(matrix[:, :3], matrix[:, 3])
        return Cameras(camera, path, posed_from_camera=beside)


def _camera_of(folder: Path) -> str:
    return next(name for name in IMAGES if (folder / name).is_dir())


LAYOUT = KittiLayout()
