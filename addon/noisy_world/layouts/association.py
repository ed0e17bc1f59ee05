# SPDX-License-Identifier: GPL-3.0-or-later
"""Which colour, depth and pose of a recording belong together, decided by their time stamps.

The rule is that of associate.py, which the TUM RGB-D benchmark publishes: of all pairs closer than PAIRING_S, the
closest is taken, then the closest of those that are left, and each stamp is used once. Of equally close pairs the one
that is earlier in the first list comes first, then the one that is earlier in the second.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.trajectory import FrameStamps, Stamps, Trajectory

# Frames of a recording whose pose is not known: left out, kept, or refused.


PosePolicy = Literal["drop", "keep", "require", "none"]
"""What becomes of frames without a pose: left out, kept without one, refused; none: no pose is looked for at all."""

_POSES = "poses: drop leaves them out, poses: keep keeps them"


def chosen_by_pose(path: Path, known: NDArray[np.bool_], policy: PosePolicy) -> tuple[NDArray[np.intp], str]:
    """Return the rows of the frames that are used, and a note on the others; "" where there is nothing to say.

    path: the file or folder of the poses, for messages. known: (N,) whether a frame has a pose. Raises InputError where
    a frame without one is not allowed, or none would be left.
    """
    rows, lacking = np.flatnonzero(known), int(np.count_nonzero(~known))
    everything = np.arange(len(known))
    if not lacking or policy == "none":
        return everything, ""
    message = f"{lacking} of {len(known)} frames have no valid pose"
    if policy == "require":
        raise InputError(path, f"{message}, the first is frame {int(np.argmin(known))}", remedy=_POSES)
    if policy == "keep":
        return everything, f"{message}; they are kept, and no pose is written for them"
    if not rows.size:
        raise InputError(path, message, remedy="poses: none uses the images without ground truth")
    return rows, f"{message} and are left out"


def truth_file(path: Path, policy: PosePolicy) -> Path | None:
    """Return the file of the poses; None where none is to be read, or it is not there and frames are kept anyway."""
    return None if policy == "none" or (policy == "keep" and not path.exists()) else path


def unposed(count: int) -> Trajectory:
    """Return a path of so many frames, a second apart, none of whose poses is known."""
    return Trajectory(np.tile(np.eye(4), (count, 1, 1)), np.arange(float(count)), posed=np.zeros(count, dtype=np.bool_))


PAIRING_S = 0.02  # stamps that belong together differ by less; the default of associate.py
# Chosen: seconds and a gigabyte; stamps of a camera in seconds make a few pairs for each image.
MAX_CANDIDATES = 10_000_000


@dataclass(frozen=True, eq=False)
class StampedFiles:
    """A list of images with their stamps, which increase; those of paired depth need not."""

    stamps: Stamps
    files: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class MatchedFrames:
    """The frames of a recording: a colour image each, with depth where it has any, and a pose where that is known.

    depth_files: one for each colour image; () of a recording without depth. trajectory: the poses, at the stamps of the
    colour. stamps: of colour, depth and poses. notes: on what is left out, and on how the poses were read.
    """

    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory: Trajectory
    stamps: FrameStamps
    notes: tuple[str, ...]


def associate(
    first_s: NDArray[np.float64], second_s: NDArray[np.float64], within_s: float = PAIRING_S
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of two lists of stamps that belong together, in the order of the first.

    first_s (N,), second_s (M,): seconds, increasing. Raises ValueError where more than MAX_CANDIDATES pairs are closer
    than within_s.
    """
    # The window is wider than the limit by float64's rounding; the limit itself is applied to the difference.
    wide_s = within_s + 4 * np.spacing(np.abs(first_s) + within_s)
    begin = np.searchsorted(second_s, first_s - wide_s, side="left")
    end = np.searchsorted(second_s, first_s + wide_s, side="right")
    count = end - begin
    total = int(count.sum())
    if total > MAX_CANDIDATES:
        raise ValueError(f"{total} pairs of stamps are closer than {within_s:g} s")
    first = np.repeat(np.arange(len(first_s)), count)
    second = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + np.repeat(begin, count)
    apart_s = np.abs(first_s[first] - second_s[second])
    close = apart_s < within_s
    first, second, apart_s = first[close], second[close], apart_s[close]
    partner: dict[int, int] = {}
    taken: set[int] = set()
    for index in np.lexsort((second, first, apart_s)).tolist():
        here, there = int(first[index]), int(second[index])
        if here not in partner and there not in taken:
            partner[here] = there
            taken.add(there)
    rows = sorted(partner)
    return np.array(rows, dtype=np.int64), np.array([partner[row] for row in rows], dtype=np.int64)


def associate_frames(
    folder: Path,
    rgb: StampedFiles,
    depth: StampedFiles | None,
    path: Trajectory | None,
    pose_stamps: Stamps | None = None,
    *,
    paired: bool = False,
    policy: PosePolicy = "drop",
) -> MatchedFrames:
    """Return the frames of a recording: first each colour image with its depth, then each of these with its pose.

    depth, path: images of depth, and the ground truth; None where there is none. pose_stamps: those of the path where
    they are known more exactly than it holds them. paired: the i-th depth is that of the i-th colour image, whatever
    their stamps. policy: what becomes of frames without a pose. Raises InputError where no colour image has all that
    there is, or none is left.
    """
    poses = pose_stamps or Stamps(np.zeros(0) if path is None else path.stamps_s)
    try:
        if depth is None or paired:
            of_rgb = of_depth = np.arange(len(rgb.files), dtype=np.int64)
        else:
            of_rgb, of_depth = associate(rgb.stamps.seconds, depth.stamps.seconds)
        with_pose, of_pose = associate(rgb.stamps.seconds[of_rgb], poses.seconds)
    except ValueError as error:
        raise InputError(folder, str(error), remedy="stamps are seconds: are these in another unit?") from error
    if not len(of_rgb if path is None else with_pose):
        stamped = {"colour": rgb.stamps}
        stamped |= {} if depth is None else {"depth": depth.stamps}
        stamped |= {} if path is None else {"pose": poses}
        spans = [f"{name} {item.seconds[0]:.6f} to {item.seconds[-1]:.6f} s" for name, item in stamped.items() if item]
        *others, last = stamped
        problem = f"no {', '.join(others)} and {last} lie within {PAIRING_S} s of one another"
        raise InputError(folder, problem, remedy=", ".join(spans))
    with_depth = len(of_rgb)
    notes = () if path is None else path.notes
    if path is None or (policy in ("keep", "require") and len(with_pose) < with_depth):
        known = np.zeros(with_depth, dtype=np.bool_)
        known[with_pose] = True
        _, note = chosen_by_pose(folder, known, policy)
        notes += (note,) if note else ()
        c2w, taken = np.tile(np.eye(4), (with_depth, 1, 1)), rgb.stamps.take(of_rgb)
        if path is not None:
            c2w[with_pose] = path.c2w[of_pose]
        of_poses = _pose_stamps(taken, poses, with_pose, of_pose)
        trajectory = Trajectory(c2w, taken.seconds, posed=known)
    else:
        of_rgb, of_depth = of_rgb[with_pose], of_depth[with_pose]
        taken, of_poses = rgb.stamps.take(of_rgb), poses.take(of_pose)
        trajectory = Trajectory(path.c2w[of_pose], taken.seconds)
    excluded = _excluded(len(rgb.files), with_depth, len(of_rgb))
    return MatchedFrames(
        tuple(rgb.files[row] for row in of_rgb),
        () if depth is None else tuple(depth.files[row] for row in of_depth),
        trajectory,
        FrameStamps(taken, taken if depth is None else depth.stamps.take(of_depth), of_poses),
        (*notes, excluded) if excluded else notes,
    )


def _pose_stamps(taken: Stamps, poses: Stamps, with_pose: NDArray[np.int64], of_pose: NDArray[np.int64]) -> Stamps:
    """Return the stamps of the frames' poses; where there is none, that of the colour stands for it."""
    rows = dict(zip(with_pose.tolist(), of_pose.tolist(), strict=True))
    parts = [poses.take([rows[row]]) if row in rows else taken.take([row]) for row in range(len(taken))]
    seconds = np.concatenate([part.seconds for part in parts])
    exact = [part.exact_ns for part in parts]
    return Stamps(seconds, None if None in exact else tuple(stamp for part in exact if part for stamp in part))


def _excluded(images: int, paired: int, frames: int) -> str:
    """Say how many colour images have no depth, and how many of the others no pose; "" where each has both."""
    reasons = [(images - paired, "no depth image"), (paired - frames, "no pose")]
    parts = [f"{number} with {reason}" for number, reason in reasons if number]
    if not parts:
        return ""
    return f"{images - frames} of {images} colour images are left out: {', '.join(parts)} within {PAIRING_S} s"
