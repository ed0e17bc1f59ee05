# SPDX-License-Identifier: GPL-3.0-or-later
"""KITTI's odometry benchmark: colour of the left camera, with times, calibration and, of sequences 00 to 10, poses.

It has no depth. What is written here has depth in depth_2, of image_2's pixels, as KITTI's depth benchmark encodes it:
16 bits, 256 steps a metre, 0 where there is none (the readme of devkit_depth).

https://www.cvlibs.net/datasets/kitti/eval_odometry.php, and the readme of its development kit: image_2/000000.png is
the left colour camera, image_0 the left grey one; times.txt has seconds, a line for each image; calib.txt has P0 to P3,
3 x 4 matrices that project points in the axes of camera 0; a line of poses/00.txt takes these points to the world.
"""

from collections.abc import Collection
from decimal import Decimal
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.trajectory import NS_PER_S, Stamps
from ..trajectories.formats import read_file_poses
from ..trajectories.matrix_poses import row_text
from ..trajectories.pose_files import read_text
from .layout import PATH_SUFFIXES, SequenceFacts, intrinsics_of_matrix, lines, path_suffix
from .numbered import Cameras, ImageFiles, NumberedLayout, NumberedPoses
from .stored_recording import MatchedFrames, PosePolicy, size_of
from .with_reader import LayoutWithReader

IMAGES = ("image_2", "image_0")  # colour, and grey where there is none
DEPTH = "depth_2"
CALIBRATION = "calib.txt"
TIMES = "times.txt"
POSES = "poses.txt"
DEPTHS = ImageFiles(DEPTH, r"([0-9]+)\.png")


class KittiRecordings(NumberedLayout):
    """`image_2/000000.png`, `times.txt`, `calib.txt`, and `poses.txt`, or `poses/00.txt` beside the sequences."""

    name = "kitti"
    order = 130
    label = "KITTI"
    meaning = "of KITTI's odometry benchmark, the left camera; depth beside it, which the benchmark has not"
    files = "image_2/000000.png (or image_0), times.txt, calib.txt, poses.txt or ../../poses/NAME.txt"
    depth = DEPTHS
    depth_scale_per_m = 256.0

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are images of a left camera with a calibration."""
        return (folder / CALIBRATION).is_file() and any((folder / name).is_dir() for name in IMAGES)

    def images(self, folder: Path) -> tuple[dict[int, Path], dict[int, Path] | None]:
        """Return the images of the left camera by number, and depth, where there is any."""
        return ImageFiles(_camera_of(folder), r"([0-9]+)\.(?:png|jpg)").of(folder), DEPTHS.there(folder)

    def times(self, folder: Path) -> tuple[Path, Stamps] | None:
        """Return the times of the images, to the nanosecond."""
        path = folder / TIMES
        if not path.is_file():
            return None
        words = read_text(path).split()
        try:
            stamps = Stamps.of_ns(int((Decimal(word) * NS_PER_S).to_integral_value()) for word in words)
        except (ArithmeticError, ValueError):
            stamps = None
        if stamps is None or np.any(np.diff(stamps.seconds) <= 0):
            raise InputError(path, "has to have a time in seconds on each line, each later than the one before")
        return path, stamps

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the file of poses; None where the policy asks for none, or keeps frames without."""
        if policy == "none":
            return None
        places = (folder / POSES, folder.resolve().parents[1] / "poses" / f"{folder.resolve().name}.txt")
        found = next((path for path in places if path.is_file()), None)
        if found is None and policy != "keep":
            remedy = "sequences 11 to 21 have none: poses: none uses the images without ground truth"
            raise InputError(folder, "has no file of poses", remedy=remedy)
        return found

    def poses(self, path: Path, rgb: Collection[int], depth: Collection[int] | None) -> NumberedPoses:
        """Return the poses of camera 0, a line for each image: of as many images in their order, else from 0 on."""
        del depth
        poses = read_file_poses(path, format="kitti").poses
        numbers = sorted(rgb) if len(rgb) == len(poses) else range(len(poses))
        return NumberedPoses(path, dict(zip(numbers, poses, strict=True)))

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


class KittiLayout(LayoutWithReader):
    """`image_2/000000.png`, `depth_2/000000.png`, `times.txt`, `calib.txt` and `poses.txt`."""

    reader = KittiRecordings()
    images = ("png",)
    colours = ("rgb",)
    depth_scale_per_m = KittiRecordings.depth_scale_per_m
    rgb_file = f"{IMAGES[0]}/{{frame:06d}}.{{image}}"
    depth_file = f"{DEPTH}/{{frame:06d}}.png"
    patterns = (*(f"poses{suffix}.txt" for suffix in PATH_SUFFIXES), TIMES, CALIBRATION)
    gaps = False  # poses.txt has a line for each frame

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return times, a calibration of four cameras in one place, and a file of poses for each path that is known."""
        camera, chosen = facts.camera, facts.chosen
        matrix = [camera.fx_px, 0.0, camera.cx_px, 0.0, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
        numbers = " ".join(repr(float(value)) for value in matrix)
        texts = {
            TIMES: lines([f"{Decimal(stamp_ns).scaleb(-9):.9f}" for stamp_ns in facts.taken.rgb.ns]),
            CALIBRATION: lines([f"P{index}: {numbers}" for index in range(4)]),
        }
        paths = chosen.named() if chosen.rgb.known.any() else {}
        return texts | {
            f"poses{path_suffix(name)}.txt": row_text(path.c2w[:, :3].reshape(-1, 12)) for name, path in paths.items()
        }


LAYOUT = KittiLayout()
