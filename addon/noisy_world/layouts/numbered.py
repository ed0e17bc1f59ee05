# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings whose images and poses are matched by the numbers in their names.

A `NumberedLayout` says which files they are and what the cameras are; the rest follows.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..trajectories.formats import read_file_poses
from .layout import MILLIMETRES, RECORDED_HZ, RecordedLayout, counted_note
from .stored_recording import MatchedFrames, PosePolicy, StoredSequence, chosen_by_pose, truth_file

LARGEST_NUMBER = 10**9  # over a year at 30 Hz: what is larger is no count


@dataclass(frozen=True, eq=False)
class NumberedPoses:
    """Poses by the number of their frame.

    path: their file or folder. c2w: (4, 4) each, OpenCV's camera axes. notes: on how they were read.
    """

    path: Path
    c2w: Mapping[int, NDArray[np.float64]]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CountedPoses:
    """Poses by their place in a file that counts frames from 0, whatever the numbers of their images.

    listed: the places, increasing, of which the file has a pose, valid or not.
    """

    path: Path
    c2w: Mapping[int, NDArray[np.float64]]
    listed: Sequence[int]


def numbered_images(folder: Path, pattern: str) -> dict[int, Path]:
    """Return the files of a folder whose whole name matches a pattern, by the number that its first group catches.

    Raises InputError where two have one number, or the folder cannot be read.
    """
    found: dict[int, Path] = {}
    try:
        files = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    for path in files:
        match = re.fullmatch(pattern, path.name)
        if match is None:
            continue
        number = int(match[1][-20:])
        if number > LARGEST_NUMBER or len(match[1]) > 20:
            raise InputError(path, "its number is too large to count frames", remedy="number the frames from 0")
        if (same := found.setdefault(number, path)) != path:
            raise InputError(folder, f"{same.name} and {path.name} have one number", remedy="keep one of them")
    return found


def poses_of_images(
    poses: CountedPoses, images: Collection[int], pairs: Collection[int], begins: Collection[int]
) -> NumberedPoses:
    """Return counted poses by the numbers of their images.

    images: the numbers of all images, colour's or depth's. pairs: of those that have both. begins: the numbers that
    such recordings begin with. The first pose belongs to an image of such a number or to the first that there is. Where
    images are lost, the ends tell which: the last pose belongs to the last image. Or the poses are of the images that
    are there, one after another. Raises InputError where none of these, or several, can be.
    """
    first, last, path, frames = min(images), max(images), poses.path, poses.listed[-1] + 1
    fitting = {begin for begin in (*begins, first) if begin <= first and begin + frames - 1 == last}
    ways: set[Sequence[int]] = {range(begin, begin + frames) for begin in (*fitting, *({first} & set(begins)))}
    if len(poses.listed) == frames == len(pairs):
        there = sorted(pairs)
        ways.add(tuple(there) if there[-1] - there[0] >= frames else range(there[0], there[-1] + 1))
    if len(ways) == 1:
        (numbers,) = ways
        return NumberedPoses(path, {numbers[place]: c2w for place, c2w in poses.c2w.items()})
    gaps = ", with gaps" if len(images) <= last - first else ""
    problem = (
        f"has poses of {frames} frames, but images are numbered {first} to {last}{gaps}, and {len(pairs)} have "
        "colour and depth: which pose is whose cannot be told"
    )
    remedy = "put the images back that are missing, or make it of the images that are there, numbered from 0"
    raise InputError(path, problem, remedy=remedy)


def folder_of_poses(folder: Path, colour: Collection[int]) -> NumberedPoses:
    """Return the poses of a folder that has a file for each.

    colour: the numbers of the colour images. Raises InputError.
    """
    found = read_file_poses(folder, format="matrices")
    assert found.numbers is not None
    assert found.listed is not None
    check_same_numbers(folder, colour, list(map(int, found.listed.tolist())), ("colour images", "poses"))
    return NumberedPoses(folder, dict(zip(map(int, found.numbers.tolist()), found.poses, strict=True)))


def check_same_numbers(folder: Path, one: Collection[int], other: Collection[int], kinds: tuple[str, str]) -> None:
    """Raise InputError where as many files are numbered one after another, but from another number on.

    told: what the files are, in words.
    """
    if not one or len(one) != len(other) or min(one) == min(other):
        return
    if all(max(numbers) - min(numbers) + 1 == len(numbers) for numbers in (one, other)):
        ranges = [f"{what} {min(numbers)} to {max(numbers)}" for what, numbers in zip(kinds, (one, other), strict=True)]
        remedy = "number both alike; where files are missing, take away those of the same frames"
        raise InputError(folder, f"has {' and '.join(ranges)}: which belong together cannot be told", remedy=remedy)


def numbered_frames(
    folder: Path,
    rgb: Mapping[int, Path],
    depth: Mapping[int, Path] | None,
    poses: NumberedPoses | None,
    *,
    policy: PosePolicy,
    rate_hz: float,
) -> MatchedFrames:
    """Return the frames that have colour and depth, and a pose where the policy wants it; frame i is at i / rate_hz.

    depth: None for a recording without depth. poses: None for one without ground truth, whose policy is "keep" or
    "none". Raises InputError where no frame is left.
    """
    if depth is not None:
        check_same_numbers(folder, rgb, depth, ("colour images", "depth images"))
    numbers = sorted(rgb if depth is None else rgb.keys() & depth.keys())
    if not numbers:
        images = len(depth or ())
        problem = f"has {len(rgb)} colour and {images} depth images, none of which have one number"
        raise InputError(folder, problem)
    known = np.array([poses is not None and number in poses.c2w for number in numbers])
    rows, pose_note = chosen_by_pose(folder if poses is None else poses.path, known, policy)
    chosen = [numbers[row] for row in rows]
    c2w = np.tile(np.eye(4), (len(chosen), 1, 1))
    if poses is not None:
        for row, number in enumerate(chosen):
            c2w[row] = poses.c2w.get(number, c2w[row])
    stamps_s = np.array(chosen, dtype=np.float64) / rate_hz
    unpaired = 0 if depth is None else len(rgb) + len(depth) - 2 * len(numbers)
    alone = f"{unpaired} images are left out: no colour or no depth has their number" if unpaired else ""
    spare = len(poses.c2w.keys() - set(numbers)) if poses is not None else 0
    if spare:
        pose_note = f"{pose_note}; " * bool(pose_note) + f"{spare} poses are left out: no frame has their number"
    return MatchedFrames(
        tuple(rgb[number] for number in chosen),
        () if depth is None else tuple(depth[number] for number in chosen),
        Trajectory(c2w, stamps_s, posed=known[rows]),
        FrameStamps.of(stamps_s),
        tuple(note for note in (alone, pose_note) if note),
    )


# --- layouts that are described by their files ---


@dataclass(frozen=True)
class ImageFiles:
    """Where images of one kind lie: a folder in the recording, "" for its own, and a pattern of their whole names.

    The first group of the pattern is the number of the frame.
    """

    folder: str
    pattern: str

    def of(self, recording: Path) -> dict[int, Path]:
        """Return the images of a recording by number. Raises InputError as `numbered_images` does."""
        return numbered_images(recording / self.folder, self.pattern)

    def there(self, recording: Path) -> dict[int, Path] | None:
        """Return the images, as `of` does; None where the recording has none."""
        if not (recording / self.folder).is_dir():
            return None
        return self.of(recording) or (None if self.folder == "" else {})


@dataclass(frozen=True)
class Cameras:
    """What a recording says of its cameras.

    camera: of colour; None where nothing says it. path: the file that says it; None where it is the dataset's
    documented one, which `assumed` says in a sentence. depth_scale_per_m: None where it is the layout's.
    posed_from_camera: (4, 4), the pose of colour in the axes of the camera whose poses the recording has; None where it
    is that camera.
    """

    camera: Intrinsics | None = None
    path: Path | None = None
    optics: Optics = PINHOLE
    assumed: str = ""
    depth_scale_per_m: float | None = None
    posed_from_camera: NDArray[np.float64] | None = None


class NumberedLayout(RecordedLayout):
    """A layout of recordings whose images and poses are matched by number. A subclass describes its files.

    rgb, depth: the images; a recording may lack depth, and depth is None where all do. pose_folder: that of a file for
    each pose, "" for the recording's own. usual_hz: frames a second, where no file says it. depth_scale_per_m: steps
    per metre. void_steps: what depth images hold where there is no depth, besides 0.
    """

    rgb: ClassVar[ImageFiles]
    depth: ClassVar[ImageFiles | None]
    pose_folder: ClassVar[str] = ""
    usual_hz: ClassVar[float] = RECORDED_HZ
    depth_scale_per_m: ClassVar[float] = MILLIMETRES
    void_steps: ClassVar[tuple[int, ...]] = ()

    def images(self, folder: Path) -> tuple[dict[int, Path], dict[int, Path] | None]:
        """Return colour and depth by number; None for depth where there is none."""
        return self.rgb.of(folder), None if self.depth is None else self.depth.there(folder)

    def times(self, folder: Path) -> tuple[Path, NDArray[np.float64] | Stamps] | None:
        """Return the file of the images' times, and these, increasing; None where none says them.

        Seconds, or stamps in nanoseconds: of as many images in their order, else by number.
        """
        del folder

    def stated_rate_hz(self, folder: Path) -> float | None:
        """Return the frames a second that a file says; None where none does."""
        del folder

    def poses_path(self, folder: Path, policy: PosePolicy) -> Path | None:
        """Return the file or folder of the poses; None where the policy asks for none, or none has to be there."""
        return truth_file(folder / self.pose_folder, policy)

    def poses(self, path: Path, rgb: Collection[int], depth: Collection[int] | None) -> NumberedPoses:
        """Return the poses by number. rgb, depth: the numbers of the images."""
        del depth
        return folder_of_poses(path, rgb)

    def cameras(self, folder: Path, found: MatchedFrames) -> Cameras:
        """Return the cameras of the frames that were found."""
        del folder, found
        return Cameras()

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Match images and poses by their numbers."""
        rgb, depth = self.images(folder)
        stated_hz = self.stated_rate_hz(folder)
        used_hz = rate_hz or stated_hz or self.usual_hz
        path = self.poses_path(folder, poses)
        given = None if path is None else self.poses(path, rgb, depth)
        found = numbered_frames(folder, rgb, depth, given, policy=poses, rate_hz=used_hz)
        cameras, timed = self.cameras(folder, found), self.times(folder)
        trajectory, stamps = found.trajectory, found.stamps
        if cameras.posed_from_camera is not None:
            trajectory = replace(trajectory, c2w=trajectory.c2w @ cameras.posed_from_camera, curve=None)
        if timed is not None:
            taken = _times_of(*timed, rgb, found.rgb_files)
            stamps = FrameStamps(taken, taken, taken)
            trajectory = trajectory.at(slice(None), stamps.rgb.seconds)
        return StoredSequence(
            folder,
            found.rgb_files,
            found.depth_files,
            path,
            trajectory,
            stamps,
            cameras.depth_scale_per_m or self.depth_scale_per_m,
            stamps_path=None if timed is None else timed[0],
            camera=cameras.camera,
            camera_path=cameras.path,
            notes=(
                *found.notes,
                *(() if given is None else given.notes),
                *(() if stated_hz or timed else counted_note(rate_hz, used_hz)),
            ),
            counted_hz=None if timed else used_hz,
            void_steps=self.void_steps,
            optics=cameras.optics,
            assumed=cameras.assumed,
        )


def _times_of(
    path: Path, times: NDArray[np.float64] | Stamps, images: Mapping[int, Path], chosen: Collection[Path]
) -> Stamps:
    """Return the times of chosen images. Raises InputError where one has none."""
    stamps, of_chosen = times if isinstance(times, Stamps) else Stamps(times), set(chosen)
    numbers = [number for number, file in sorted(images.items()) if file in of_chosen]
    if len(images) == len(stamps):
        there = {number: place for place, number in enumerate(sorted(images))}
        return stamps.take([there[number] for number in numbers])
    if numbers[-1] >= len(stamps):
        raise InputError(path, f"has {len(stamps)} times, but images are numbered to {numbers[-1]}")
    return stamps.take(numbers)
