# SPDX-License-Identifier: GPL-3.0-or-later
"""The path of a scene from a file of poses, as a preset's `trajectory` names it."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.datasets.storage import sha256_of_file
from ..core.geometry import Intrinsics
from ..core.messages import Message
from ..core.presets.preset import Preset
from ..core.presets.scene_keys import TrajectorySpec
from ..core.schema import ConfigPath
from ..core.trajectories.files import read_trajectory_file
from ..core.trajectories.matrix_poses import numbered_files
from ..core.trajectories.trajectory import MOST_POSES, Trajectory, resample, subsample
from .scene_files import filled, found_path


def path_file_of(preset: Preset, place: ConfigPath, spec: TrajectorySpec, parts: tuple[str, ...]) -> Path:
    """Return the file of poses that a trajectory names. parts: what the entry's wildcards matched."""
    text = spec.file or ""
    return found_path(preset, place, filled(text, parts, place) if "*" in text else text, folder=None)


def read_path(
    path: Path, spec: TrajectorySpec, place: ConfigPath, camera: Intrinsics
) -> tuple[Trajectory, TrajectorySpec]:
    """Read and select the poses of a file; return also the keys with the conventions that it was read with.

    camera: the preset's; a file that states another gets a note. Raises InputError.
    """
    found = read_trajectory_file(
        path, format=spec.format, direction=spec.pose, axes=spec.axes, rate_hz=spec.rate_hz, stamp_unit=spec.stamp_unit
    )
    chosen = selected_poses(found.trajectory, spec, place)
    difference = "" if found.camera is None else found.camera.difference(camera)
    notes = [Message(f"{path.name}: ", note) for note in (*chosen.notes, difference) if note]
    return replace(chosen, notes=tuple(notes)), replace(spec, pose=found.direction, axes=found.axes)


def selected_poses(trajectory: Trajectory, spec: TrajectorySpec, place: ConfigPath) -> Trajectory:
    """Resample and subsample a trajectory as the preset says. Raises InputError where no pose is left, or too many."""
    if spec.resample_hz is not None:
        try:
            trajectory = resample(trajectory, spec.resample_hz)
        except ValueError as error:
            span_s = float(np.ptp(trajectory.stamps_s))
            remedy = f"at most {0.99 * MOST_POSES / span_s:.2g} Hz, or mend the stamps"
            raise place.at("resample_hz").error(str(error), remedy) from error
    try:
        return subsample(trajectory, spec.start, spec.stop, spec.every)
    except ValueError as error:
        raise place.error(str(error)) from error


def sha256_of_path(path: Path) -> str | None:
    """Return the hash of a file of poses; of a folder's files, that of their names and hashes."""
    if path.is_file():
        return sha256_of_file(path)
    listed = "".join(f"{sha256_of_file(file)} {file.name}\n" for file in numbered_files(path))
    return hashlib.sha256(listed.encode(errors="surrogateescape")).hexdigest()
