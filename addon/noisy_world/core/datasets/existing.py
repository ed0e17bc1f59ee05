# SPDX-License-Identifier: GPL-3.0-or-later
"""A sequence that exists: which files it has, in Replica's layout or TUM's, and its frames, read as they are needed."""

import json
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..trajectories.files import read_trajectory
from ..trajectories.trajectory import Trajectory
from .layouts import REPLICA_SCALE_PER_M, TUM_SCALE_PER_M

PAIRING_S = 0.02  # the TUM benchmark's own tolerance between stamps that belong together


@dataclass(frozen=True)
class StoredFrame:
    """One frame on disk; its images are read when they are asked for."""

    rgb_file: Path
    depth_file: Path
    depth_scale_per_m: float

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, sRGB-encoded. Raises InputError where the file is no image."""
        import cv2

        return np.ascontiguousarray(_read(self.rgb_file, cv2.IMREAD_COLOR)[..., ::-1])

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image."""
        import cv2

        steps = _read(self.depth_file, cv2.IMREAD_UNCHANGED)
        if steps.ndim != 2 or steps.dtype != np.uint16:
            raise InputError(self.depth_file, f"is {steps.dtype} {steps.shape}, but depth has to be 16-bit grey")
        return (steps / np.float64(self.depth_scale_per_m)).astype(np.float32)


@dataclass(frozen=True)
class ExistingSequence:
    """A sequence on disk: its pairs of images, its ground truth and how it counts depth."""

    folder: Path
    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory_path: Path
    trajectory: Trajectory
    depth_scale_per_m: float

    @cached_property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its first image."""
        height, width = self.frame(0).rgb.shape[:2]
        return width, height

    @property
    def files(self) -> tuple[Path, ...]:
        """Every image."""
        return self.rgb_files + self.depth_files

    def frame(self, index: int) -> StoredFrame:
        """Return a frame."""
        return StoredFrame(self.rgb_files[index], self.depth_files[index], self.depth_scale_per_m)


def find_sequence(folder: Path) -> ExistingSequence:
    """Find the files of a sequence; its layout is told from what is there.

    Raises InputError where files are missing or do not match in number.
    """
    if (folder / "rgb.txt").is_file():
        return _tum(folder)
    if (folder / "results").is_dir():
        return _replica(folder)
    raise InputError(folder, "is no sequence", remedy="a results folder (Replica) or rgb.txt (TUM) has to be in it")


def _replica(folder: Path) -> ExistingSequence:
    results = folder / "results"
    rgb = sorted((path for kind in ("jpg", "png") for path in results.glob(f"frame*.{kind}")), key=_number)
    depth = sorted(results.glob("depth*.png"), key=_number)
    if not rgb or [_number(path) for path in rgb] != [_number(path) for path in depth]:
        raise InputError(results, f"has {len(rgb)} colour and {len(depth)} depth images, which do not match by number")
    poses = folder / "traj.txt"
    trajectory = read_trajectory(poses)
    if len(trajectory) != len(rgb):
        raise InputError(poses, f"has {len(trajectory)} poses for {len(rgb)} frames", remedy="one line a frame")
    return ExistingSequence(folder, tuple(rgb), tuple(depth), poses, trajectory, _scale(folder))


def _number(path: Path) -> int:
    digits = re.search(r"(\d+)$", path.stem)
    if digits is None:
        raise InputError(path, "has no number in its name", remedy="frame000000.jpg, depth000000.png and so on")
    return int(digits[1])


def _scale(folder: Path) -> float:
    """Look for cam_params.json, which lies a level up."""
    for place in (folder.parent, folder):
        path = place / "cam_params.json"
        if path.is_file():
            try:
                return float(json.loads(path.read_text(encoding="utf-8"))["camera"]["scale"])
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(path, "holds no camera with a scale", remedy="mend or remove it") from error
    return REPLICA_SCALE_PER_M


def _tum(folder: Path) -> ExistingSequence:
    rgb, depth = (_listed(folder / name) for name in ("rgb.txt", "depth.txt"))
    poses = folder / "groundtruth.txt"
    path = read_trajectory(poses)
    pairs = []
    for stamp_s, file in rgb:
        near_depth = _nearest([other for other, _ in depth], stamp_s)
        near_pose = _nearest(path.stamps_s, stamp_s)
        if near_depth is not None and near_pose is not None:
            pairs.append((file, depth[near_depth][1], near_pose))
    if not pairs:
        raise InputError(folder, f"no colour, depth and pose lie within {PAIRING_S} s of one another")
    files, depths, rows = zip(*pairs, strict=True)
    chosen = Trajectory(path.c2w[list(rows)], path.stamps_s[list(rows)])
    return ExistingSequence(folder, files, depths, poses, chosen, TUM_SCALE_PER_M)


def _listed(path: Path) -> list[tuple[float, Path]]:
    """Read a list of stamps and files."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error
    found = []
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            found.append((float(words[0]), path.parent / words[1]))
        except (ValueError, IndexError) as error:
            raise InputError(path, "is no time stamp and file name", where=f"line {number}") from error
    return found


def _nearest(stamps_s: Any, stamp_s: float) -> int | None:
    gaps = np.abs(np.asarray(stamps_s) - stamp_s)
    return int(gaps.argmin()) if gaps.size and gaps.min() <= PAIRING_S else None


def _read(path: Path, mode: int) -> NDArray[Any]:
    import cv2

    image = cv2.imread(str(path), mode) if path.is_file() else None
    if image is None:
        raise InputError(path, "is not there or no image")
    return image
