# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read."""

import re
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics, distortion_of
from ..core.trajectory import Stamps
from ..trajectories.formats import read_trajectory
from ..trajectories.stamped_poses import tum_text
from .cam_params import CAM_PARAMS, cam_params_text, read_cam_params
from .described import exact_stamps, read_intrinsics
from .layout import PATH_SUFFIXES, Layout, SequenceFacts, lines, path_suffix, poses_at
from .stored_recording import (
    PosePolicy,
    StampedFiles,
    StoredSequence,
    associate_frames,
    check_files,
    recorded_text,
    size_of,
    truth_file,
)

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
PAIRS = ("associations.txt", "associate.txt", "association.txt")
CALIBRATION = "calibration.txt"
OTHERS = ("*.gt.freiburg", "*.log", "*-traj.txt")
"""Poses of other datasets that have a list of pairs too."""
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
    order = 20
    label = "TUM"
    meaning = "of the TUM RGB-D benchmark, which ORB-SLAM2 and 3 read"
    images = ("png",)
    colours = ("rgb", "grey")
    depth_scale_per_m = 5000.0  # the benchmark's own
    rgb_file, depth_file = "rgb/{frame:06d}.{image}", "depth/{frame:06d}.png"
    patterns = (
        *(f"groundtruth{suffix}.txt" for suffix in PATH_SUFFIXES),
        "rgb.txt",
        "depth.txt",
        "associations.txt",
        CAM_PARAMS,
    )
    setting_files = (CAM_PARAMS,)
    lists_depth = True
    optics = True  # in cam_params.json

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
        """Tell whether there is a list of colour images, or of pairs."""
        return (folder / "rgb.txt").is_file() or _pairs_file(folder) is not None

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses of groundtruth.txt by their stamps."""
        poses = folder / "groundtruth.txt"
        return poses_at(read_trajectory(poses, format="tum", stamp_unit="s"), time_s, poses)

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find images and poses with close stamps; without lists, the pairs of associations.txt."""
        del rate_hz  # the lists have stamps
        listing, of_depth = folder / "rgb.txt", folder / "depth.txt"
        has_depth = of_depth.is_file() or (folder / "depth").is_dir()
        pairs = None if listing.is_file() else _pairs_file(folder)
        if pairs is None and (folder / "depth").is_dir() and not of_depth.is_file():
            remedy = "write it like rgb.txt, or remove depth/"
            raise InputError(of_depth, "is not there, though depth/ is", remedy=remedy)
        if pairs is None:
            rgb, depth = _listed(listing), _listed(of_depth) if has_depth else None
        else:
            listing = of_depth = pairs
            rgb, depth = _paired(pairs)
        file = truth_file(folder / "groundtruth.txt", poses)
        path = None if file is None else read_trajectory(file)
        found = associate_frames(folder, rgb, depth, path, paired=pairs is not None, policy=poses)
        check_files(listing, found.rgb_files)
        check_files(of_depth, found.depth_files)
        params = read_cam_params(folder)
        known = params and params.camera
        calibration = None if known else _calibration(folder, found.rgb_files[0])
        kinect = None if known or calibration else _kinect(folder)
        camera = calibration[0] if calibration else kinect[0] if kinect else None
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            file,
            found.trajectory,
            found.stamps,
            params.depth_scale_per_m if params else self.depth_scale_per_m,
            listing,
            known or camera,
            calibration[1] if calibration else params.path if params else None,
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


def _pairs_file(folder: Path) -> Path | None:
    """Return the list of pairs of a folder without lists of its images; None without one, and in another dataset."""
    names = [folder / name for name in PAIRS if (folder / name).is_file()]
    others = any(path for pattern in OTHERS for path in folder.glob(pattern))
    return names[0] if names and not others else None


def _listed(path: Path) -> StampedFiles:
    """Read a list of stamps and files, in any order. Raises InputError where a stamp is given twice."""
    found: dict[Decimal, Path] = {}
    for where, words in _lines(path):
        if len(words) < 2:
            raise InputError(path, "is no time stamp and file name", where=where)
        stamp = _stamp(path, where, words[0])
        if stamp in found:
            problem = f"the time stamp {words[0]} is that of an earlier line"
            raise InputError(path, problem, where=where, remedy=_ONE_STAMP)
        found[stamp] = path.parent / words[1]
    return _in_order(path, list(found.items()))


def _paired(path: Path) -> tuple[StampedFiles, StampedFiles]:
    """Read a list of pairs, a stamp and a file of colour and of depth in each line, in the order of colour's stamps.

    Raises InputError where a stamp of colour is given twice. A line may begin with depth, as its file's folder says.
    """
    found: dict[Decimal, tuple[Path, Decimal, Path]] = {}
    for where, words in _lines(path):
        if len(words) != 4:
            problem = f"has {len(words)} words, and no time stamp and file name of colour and of depth"
            raise InputError(path, problem, where=where)
        one, other = ((_stamp(path, where, words[at]), words[at + 1]) for at in (0, 2))
        (stamp, name), (of_depth, depth_name) = (other, one) if one[1].startswith("depth") else (one, other)
        if stamp in found:
            problem = f"the time stamp of {name} is that of an earlier line"
            raise InputError(path, problem, where=where, remedy=_ONE_STAMP)
        found[stamp] = path.parent / name, of_depth, path.parent / depth_name
    rgb = _in_order(path, [(stamp, name) for stamp, (name, _, _) in found.items()])
    depth = [found[stamp][1:] for stamp in sorted(found)]
    return rgb, StampedFiles(exact_stamps([stamp for stamp, _ in depth]), tuple(file for _, file in depth))


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield for each line with words where it is ("line 3"), and its words; associate.py takes commas too."""
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"line {number}", re.split(r"[\s,]+", line.strip())


def _stamp(path: Path, where: str, word: str) -> Decimal:
    if not re.fullmatch(_NUMBER, word):
        raise InputError(path, "is no time stamp and file name", where=where)
    stamp = Decimal(word)
    if abs(stamp) > LARGEST_S:
        problem = f"{word} s is {float(stamp) / SECONDS_PER_YEAR:.0f} years"
        raise InputError(path, problem, where=where, remedy="write the stamps in seconds")
    return stamp


def _in_order(path: Path, images: list[tuple[Decimal, Path]]) -> StampedFiles:
    """Return images in the order of their stamps, which differ. Raises InputError where there is none."""
    if not images:
        raise InputError(path, "lists no image")
    images.sort(key=lambda image: image[0])
    stamps = exact_stamps([stamp for stamp, _ in images])
    if np.any(np.diff(stamps.seconds) <= 0):
        raise InputError(path, "has two time stamps that are equal in float64", remedy=_ONE_STAMP)
    return StampedFiles(stamps, tuple(file for _, file in images))


def _calibration(folder: Path, image: Path) -> tuple[Intrinsics, Path] | None:
    """Return the camera of ETH3D's calibration.txt, `fx fy cx cy`, and that file; None where there is none."""
    path = folder / CALIBRATION
    if not path.is_file():
        return None
    return read_intrinsics(path, size_of(image)), path


LAYOUT = TumLayout()
