# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of colour and of depth with a trajectory: Open3D's recorders, and the Redwood datasets.

Open3D: examples/python/reconstruction_system/sensors/realsense_recorder.py writes color/000000.jpg, depth/000000.png
(steps of the device, a millimetre for all but the SR300, aligned to colour) and camera_intrinsic.json; RGBDVideoReader
and the Azure Kinect reader write color/00000.jpg, depth/00000.png and intrinsic.json, with fps and, as
RGBDVideoMetadata has it, depth_scale in steps per metre. intrinsic_matrix is stored column by column. The
reconstruction system leaves scene/trajectory.log.

Redwood: http://redwood-data.org/indoor/data.html (image or colors, depth, *-traj.txt or trajectory.log, depth in
millimetres, fx = fy = 525, cx 319.5, cy 239.5: the PrimeSense's factory settings; open3d.data.RedwoodIndoorOffice1 has
colors/00000.jpg, depth/00000.png and office1-traj.txt) and http://redwood-data.org/3dscan
(rgb/0000001-000000000000.jpg, depth/0000001-000000000000.png: number and time in microseconds; no trajectory).
"""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..core.errors import InputError
from ..core.file_access import finite_number, parse_json_file
from ..core.geometry import Intrinsics
from ..core.trajectory import Stamps, Trajectory
from ..trajectories.formats import read_file_poses
from .layout import MILLIMETRES, intrinsics_of_matrix, stated_camera
from .numbered import Cameras, CountedPoses, ImageFiles, NumberedLayout, NumberedPoses, numbered_images, poses_of_images
from .stored_recording import MatchedFrames, PosePolicy, StampedFiles, StoredSequence, associate_frames, recorded_text

INTRINSICS = ("intrinsic.json", "camera_intrinsic.json")
TRAJECTORIES = ("*.log", "scene/*.log", "*-traj.txt", "*trajectory.txt")
COLOURS = ("rgb", "image", "images", "color", "colors")
COLOUR = r"([0-9]+)\.(?:jpg|png)"
TIMED = r"([0-9]+)-([0-9]+)\.(?:jpg|png)"
PRIMESENSE = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
_ASSUMED = "the PrimeSense's factory camera of fx = fy = 525 and (319.5, 239.5) is used, as by the dataset; camera says another"  # fmt: skip  # noqa: E501


_DEPTH = ImageFiles("depth", r"([0-9]+)\.png")


class _LoggedLayout(NumberedLayout):
    """Colour and depth in folders, and a file of poses that counts frames, whatever the numbers of their images.

    begins: the numbers that its recordings begin with.
    """

    depth = _DEPTH
    begins: ClassVar[tuple[int, ...]]

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the one file of poses. Raises InputError where there is none or are several."""
        return _trajectory_file(folder, policy)

    def poses(self, path: Path, rgb: Collection[int], depth: Collection[int] | None) -> NumberedPoses:
        """Return the poses of a .log by the numbers of the images."""
        images, pairs = (set(rgb), set(rgb)) if depth is None else ({*rgb, *depth}, set(rgb) & set(depth))
        if not pairs:
            return NumberedPoses(path, {})  # the images say what is wrong
        return poses_of_images(_counted_poses(path), images, pairs, self.begins)


class Open3DLayout(_LoggedLayout):
    """`color/00000.jpg`, `depth/00000.png`, `intrinsic.json` and a `.log` of poses."""

    name = "open3d"
    order = 100
    label = "Open3D"
    meaning = (
        "a recording of Open3D's RealSense or Azure Kinect recorder, with a .log of poses such as its reconstruction's"
    )
    files = "color/00000.jpg, depth/00000.png, intrinsic.json, *.log"
    rgb = ImageFiles("color", COLOUR)
    begins = (0,)

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are intrinsics of a recorder beside colour."""
        return (folder / "color").is_dir() and _intrinsics_file(folder) is not None

    def stated_rate_hz(self, folder: Path) -> float | None:
        """Return the frames a second of the recorder."""
        return _positive(*_recorder(folder), "fps")

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the camera of the recorder, and its depth scale."""
        del found
        path, document = _recorder(folder)
        return Cameras(_camera(path, document), path, depth_scale_per_m=_positive(path, document, "depth_scale"))


class RedwoodLayout(_LoggedLayout):
    """`image` or `rgb`, `depth` and a trajectory in Redwood's format."""

    name = "redwood"
    order = 110
    label = "Redwood"
    meaning = "a sequence of the Redwood datasets: depth in mm, the PrimeSense's factory camera"
    files = "rgb/ (or image/, colors/), depth/, *.log or *-traj.txt"
    begins = (0, 1)

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are colour and depth with a trajectory, or images named by number and time."""
        if not _has_folders(folder, COLOURS) or _intrinsics_file(folder) or any(folder.glob("*.gt.freiburg")):
            return False
        if (folder / "pose").is_dir() or (folder / "intrinsic").is_dir() or (folder / "rgb.txt").is_file():
            return False
        timed = (re.fullmatch(TIMED, path.name) for path in (folder / "depth").glob("*-*.png"))
        return bool(_trajectories(folder)) or any(timed)

    def images(self, folder: Path) -> tuple[dict[int, Path], dict[int, Path] | None]:
        """Return colour and depth by number."""
        return numbered_images(_colour_folder(folder), COLOUR), _DEPTH.there(folder)

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the camera that a file says, else the PrimeSense's."""
        stated = stated_camera(folder, found.rgb_files[0])
        return Cameras(PRIMESENSE, assumed=_ASSUMED) if stated is None else Cameras(*stated)

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Match images by their numbers, or by their times where their names say them; a .log counts frames."""
        images = _colour_folder(folder)
        if not any(re.fullmatch(TIMED, path.name) for path in images.iterdir()):
            return super().read(folder, rate_hz, poses)
        found = _timed_frames(folder, images, truth := self.poses_path(folder, poses), poses)
        cameras = self.cameras(folder, found)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            truth,
            found.trajectory,
            found.stamps,
            MILLIMETRES,
            images,
            cameras.camera,
            cameras.path,
            found.notes,
            assumed=cameras.assumed,
        )


def _colour_folder(folder: Path) -> Path:
    """Return the one folder of colour. Raises InputError where there are two."""
    colours = [name for name in COLOURS if (folder / name).is_dir()]
    if len(colours) > 1:
        raise InputError(folder, f"has {colours[0]} and {colours[1]}", remedy="leave one folder of colour in it")
    return folder / colours[0]


def _has_folders(folder: Path, colours: tuple[str, ...]) -> bool:
    return (folder / "depth").is_dir() and any((folder / name).is_dir() for name in colours)


def _intrinsics_file(folder: Path) -> Path | None:
    return next((folder / name for name in INTRINSICS if (folder / name).is_file()), None)


# --- intrinsics ---


def _recorder(folder: Path) -> tuple[Path, dict[str, Any]]:
    """Return the file that a recorder describes its cameras in, and what it says."""
    path = _intrinsics_file(folder)
    assert path is not None, "recognised"
    document = parse_json_file(recorded_text(path), path)
    if not isinstance(document, dict) or "intrinsic_matrix" not in document:
        raise InputError(path, "holds no intrinsic_matrix", remedy="as Open3D writes it")
    return path, document


def _camera(path: Path, document: dict[str, Any]) -> Intrinsics:
    values = document["intrinsic_matrix"]
    numbers = [finite_number(value) for value in values] if isinstance(values, list) else []
    found = [number for number in numbers if number is not None]
    if len(found) != 9 or len(numbers) != 9:
        raise InputError(path, "has to be nine numbers, column by column", where="intrinsic_matrix")
    sizes = [finite_number(document.get(name)) for name in ("width", "height")]
    for name, size in zip(("width", "height"), sizes, strict=True):
        if size is None or not size.is_integer():
            raise InputError(path, "has to be whole pixels", where=name)
    wide, high = (int(size) for size in sizes if size is not None)
    return intrinsics_of_matrix(path, np.array(found).reshape(3, 3).T, (wide, high))


def _positive(path: Path, document: dict[str, Any], name: str) -> float | None:
    if name not in document:
        return None
    number = finite_number(document[name])
    if number is None or number <= 0:
        raise InputError(path, "has to be a number above 0", where=name)
    return number


# --- poses ---


def _trajectories(folder: Path) -> list[Path]:
    return sorted({path for pattern in TRAJECTORIES for path in folder.glob(pattern) if path.is_file()})


def _trajectory_file(folder: Path, policy: PosePolicy) -> Path | None:
    """Return the one file of poses; None where none is wanted. Raises InputError where there is none or are several."""
    if policy == "none":
        return None
    found = _trajectories(folder)
    if len(found) > 1:
        raise InputError(folder, f"has {found[0].name} and {found[1].name}", remedy="leave one file of poses in it")
    if not found and policy != "keep":
        remedy = "put a .log of them there; poses: none uses the images without ground truth"
        raise InputError(folder, "holds no file of poses", remedy=remedy)
    return found[0] if found else None


def _counted_poses(path: Path) -> CountedPoses:
    found = read_file_poses(path, format="log")
    assert found.numbers is not None
    assert found.listed is not None
    c2w = dict(zip(map(int, found.numbers.tolist()), found.poses, strict=True))
    return CountedPoses(path, c2w, list(map(int, found.listed.tolist())))


def _timed_frames(folder: Path, images: Path, truth: Path | None, policy: PosePolicy) -> MatchedFrames:
    """Match images that are named by number and microseconds; a pose belongs to the colour image of its number."""
    numbers, colour = _stamped(images)
    _, depth = _stamped(folder / "depth")
    if truth is None:
        return associate_frames(folder, colour, depth, None, policy=policy)
    given = poses_of_images(_counted_poses(truth), numbers, numbers, RedwoodLayout.begins).c2w
    rows = [row for row, number in enumerate(numbers) if number in given]
    if not rows:
        raise InputError(truth, "has no valid pose of an image", remedy="poses: none uses them without ground truth")
    path = Trajectory(np.array([given[numbers[row]] for row in rows]), colour.stamps.seconds[rows])
    return associate_frames(folder, colour, depth, path, policy=policy)


def _stamped(folder: Path) -> tuple[list[int], StampedFiles]:
    """Return the numbers of a folder's images, in order, and the images with their times."""
    files = numbered_images(folder, r"([0-9]+)-[0-9]+\.(?:jpg|png)")
    numbers = sorted(files)
    ordered = [files[number] for number in numbers]
    if not ordered:
        raise InputError(folder, "holds no image named by number and time", remedy="0000001-000000000000.jpg and so on")
    stamps_us = [int(path.stem.partition("-")[2][:18]) for path in ordered]
    late = next((row for row in range(1, len(stamps_us)) if stamps_us[row] <= stamps_us[row - 1]), None)
    if late is not None:
        raise InputError(ordered[late], "is not later than the image before it, by the times in their names")
    return numbers, StampedFiles(Stamps.of_ns(stamp_us * 1000 for stamp_us in stamps_us), tuple(ordered))


LAYOUT = Open3DLayout(), RedwoodLayout()
