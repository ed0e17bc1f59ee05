# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read."""

import re
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry import Intrinsics
from ...optics import PINHOLE, Optics, distortion_of
from ...trajectories.files import read_trajectory
from ...trajectories.stamped_poses import tum_text
from ...trajectories.stamps import NS_PER_S, Stamps
from ..association import StampedFiles, associate_frames
from ..known_poses import PosePolicy, truth_file
from ..stored import StoredSequence, check_files, recorded_text
from .cam_params import CAM_PARAMS, cam_params_text, read_cam_params
from .layout import PATH_SUFFIXES, Image, Layout, SequenceFacts, lines, numbered, path_suffix, poses_at

LARGEST_S = 10**11  # 3,000 years: what is later is in another unit
SECONDS_PER_YEAR = 31_557_600  # Julian
# https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats, "Intrinsic camera calibration of the Kinect": of
# colour, to which depth is registered; fx, fy, cx, cy, and d0 to d4 as OpenCV has them. ORB-SLAM2's
# Examples/RGB-D/TUM2.yaml has more digits of the second: 520.908620, 521.007327, 325.141442, 249.701764.
KINECTS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": ((535.4, 539.2, 320.1, 247.6), (0.0, 0.0, 0.0, 0.0, 0.0)),
}
_ASSUMED = "the benchmark's calibration of this Kinect is used, by the folder's name; camera says another"
_ONE_STAMP = "an image has a stamp of its own"
# float() would also take "nan", "1_000" and digits of other scripts.
_NUMBER = r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?"
# The benchmark's files begin with three lines of comments. Readers rely on them: ORB-SLAM's mono_tum leaves out three
# lines of rgb.txt whatever they are, NICE-SLAM and its successors one of groundtruth.txt.
_NO_BAG = "# file: none; written by Noisy World"
_LISTED = "# timestamp filename"
_POSES_HEADER = lines(["# ground truth trajectory", _NO_BAG, "# timestamp tx ty tz qx qy qz qw"])


class TumLayout(Layout):
    """`rgb/*.png`, `depth/*.png`, their lists `rgb.txt` and `depth.txt`, `associations.txt` and `groundtruth.txt`."""

    name = "tum"
    label = "TUM"
    meaning = "of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read"
    images = ("png",)
    colours = ("rgb", "grey")
    depth_scale_per_m = 5000.0  # the benchmark's own
    patterns = (
        *numbered("rgb/{}.png"),
        *numbered("depth/{}.png"),
        *(f"groundtruth{suffix}.txt" for suffix in PATH_SUFFIXES),
        "rgb.txt",
        "depth.txt",
        "associations.txt",
        CAM_PARAMS,
    )
    setting_files = (CAM_PARAMS,)
    lists_depth = True
    optics = True  # in cam_params.json

    def rgb_name(self, frame: int, stamp_ns: int, image: Image) -> str:
        """Return the name of a frame's colour image."""
        del stamp_ns
        return f"rgb/{frame:06d}.{image}"

    def depth_name(self, frame: int, stamp_ns: int) -> str:
        """Return the name of a frame's depth image."""
        del stamp_ns
        return f"depth/{frame:06d}.png"

    def sequence_texts(self, facts: SequenceFacts) -> dict[str, str]:
        """Return a file of poses for each path, a list of colour and of depth, and the pairs if there are both.

        Colour, depth and poses have their own stamps, and each list is in the order of its stamps.
        """
        names, modalities, taken = facts.names, facts.format.modalities, facts.taken
        rgb = [f"{at} {names.rgb(frame)}" for at, frame in zip(_stamp_texts(taken.rgb), facts.frames, strict=True)]
        depth = [
            f"{at} {names.depth(frame)}" for at, frame in zip(_stamp_texts(taken.depth), facts.frames, strict=True)
        ]
        paths = {} if facts.timed is None else facts.timed[0].named()
        texts = {f"groundtruth{path_suffix(name)}.txt": _POSES_HEADER + tum_text(path) for name, path in paths.items()}
        if "rgb" in modalities:
            texts["rgb.txt"] = lines(["# color images", _NO_BAG, _LISTED, *rgb])
        if "depth" in modalities:
            order = np.argsort(taken.depth.seconds, kind="stable").tolist()
            texts["depth.txt"] = lines(["# depth maps", _NO_BAG, _LISTED, *(depth[row] for row in order)])
        if {"rgb", "depth"} <= set(modalities):  # without comments: ORB-SLAM's rgbd_tum reads every line as a pair
            texts["associations.txt"] = lines([f"{left} {right}" for left, right in zip(rgb, depth, strict=True)])
        return texts

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float, optics: Optics = PINHOLE) -> dict[str, str]:
        """Return cam_params.json, as the benchmark has no file of intrinsics of its own."""
        return {CAM_PARAMS: cam_params_text(camera, depth_scale_per_m, optics)}

    def recognises(self, folder: Path) -> bool:
        """Tell whether there is a list of colour images."""
        return (folder / "rgb.txt").is_file()

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses of groundtruth.txt by their stamps."""
        poses = folder / "groundtruth.txt"
        return poses_at(read_trajectory(poses, format="tum", stamp_unit="s"), time_s, poses)

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find images and poses with close stamps."""
        del rate_hz  # the lists have stamps
        rgb, depth = _listed(folder / "rgb.txt"), _listed(folder / "depth.txt")
        file = truth_file(folder / "groundtruth.txt", poses)
        found = associate_frames(folder, rgb, depth, None if file is None else read_trajectory(file), policy=poses)
        check_files(folder / "rgb.txt", found.rgb_files)
        check_files(folder / "depth.txt", found.depth_files)
        params = read_cam_params(folder)
        kinect = None if params and params.camera else _kinect(folder)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            file,
            found.path,
            found.stamps,
            params.depth_scale_per_m if params else self.depth_scale_per_m,
            folder / "rgb.txt",
            params.camera if params and params.camera else kinect[0] if kinect else None,
            params.path if params else None,
            found.notes,
            optics=kinect[1] if kinect else params.optics if params else PINHOLE,
            assumed=_ASSUMED if kinect else "",
            likely=_likely(folder),
        )


def _kinect(folder: Path) -> tuple[Intrinsics, Optics] | None:
    """Return the Kinect of a folder that is named as the benchmark does it; None for another."""
    named = re.match(r"rgbd_dataset_freiburg([123])_", folder.resolve().name)
    if named is None:
        return None
    values, coefficients = KINECTS[named[1]]
    return Intrinsics(640, 480, *values), Optics(distortion=distortion_of("radial-tangential", coefficients))


def _likely(folder: Path) -> Intrinsics | None:
    """Return the Kinect of a sequence whose folder, or the one above, is called like one of the benchmark's."""
    names = " ".join([folder.resolve().parent.name, folder.resolve().name]).lower()
    named = re.search(r"(?<![a-z])(?:freiburg|fr)[-_ ]?([123])(?![0-9])", names)
    return None if named is None else Intrinsics(640, 480, *KINECTS[named[1]][0])


def _stamp_texts(stamps: Stamps) -> list[str]:
    """Return stamps in seconds as text: in microseconds, as the benchmark has them, or exact nanoseconds if known."""
    if stamps.exact_ns is not None and any(stamp_ns % 1000 for stamp_ns in stamps.exact_ns):
        return [f"{Decimal(stamp_ns).scaleb(-9):.9f}" for stamp_ns in stamps.exact_ns]
    return [f"{stamp_s:.6f}" for stamp_s in stamps.seconds]


def _listed(path: Path) -> StampedFiles:
    """Read a list of stamps and files, in any order. Raises InputError where a stamp is given twice."""
    found: dict[Decimal, Path] = {}
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"line {number}"
        words = re.split(r"[\s,]+", line.strip())  # associate.py takes commas too
        if len(words) < 2 or not re.fullmatch(_NUMBER, words[0]):
            raise InputError(path, "is no time stamp and file name", where=where)
        stamp = Decimal(words[0])
        if abs(stamp) > LARGEST_S:
            problem = f"{words[0]} s is {float(stamp) / SECONDS_PER_YEAR:.0f} years"
            raise InputError(path, problem, where=where, remedy="write the stamps in seconds")
        if stamp in found:
            problem = f"the time stamp {words[0]} is that of an earlier line"
            raise InputError(path, problem, where=where, remedy=_ONE_STAMP)
        found[stamp] = path.parent / words[1]
    if not found:
        raise InputError(path, "lists no image")
    ordered = sorted(found)
    stamps_ns = [stamp * NS_PER_S for stamp in ordered]
    whole = all(stamp_ns == int(stamp_ns) for stamp_ns in stamps_ns)
    seconds = np.array([float(stamp) for stamp in ordered])
    stamps = Stamps(seconds, tuple(map(int, stamps_ns)) if whole else None)
    if np.any(np.diff(seconds) <= 0):
        raise InputError(path, "has two time stamps that are equal in float64", remedy=_ONE_STAMP)
    return StampedFiles(stamps, tuple(found[stamp] for stamp in ordered))
