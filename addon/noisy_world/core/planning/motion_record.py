# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of motion in frames.jsonl: which pose of the planned path a frame shows, and its deviation."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry import quat_wxyz_from_rotation
from ..perturbing.execution import chosen_poses, drawn_motion
from ..trajectories.sensor_paths import SensorPaths
from .numbers import array_of
from .plan import Render
from .sequence import PlannedSequence

Float64: TypeAlias = NDArray[np.float64]


def motion_of_frames(render: Render, sequence: PlannedSequence, paths: SensorPaths) -> list[dict[str, Any]]:
    """Return for each frame of a sequence what motion did to it; [] where it did nothing.

    paths: the render's. source_frame: the number of the pose on the scene's path, where frames show others than their
    own. deviation: of the colour camera from the planned path: the planned pose, times this pose, is the true one;
    translation_m in the planned camera's axes, quat_wxyz. drawn: what the perturbations drew, by their names.
    """
    rows = array_of(sequence.source_frames)  # of the render's path
    count = render.scene.frame_count
    chosen = chosen_poses(render.moving, count, render.identifiers)
    planned = rows if chosen is None else chosen[rows]
    found: list[dict[str, Any]] = [{} for _ in rows]
    if not np.array_equal(planned, np.arange(len(planned))):
        for frame, pose in zip(found, planned.tolist(), strict=True):
            frame["source_frame"] = pose
    if paths.nominal is not None:
        nominal, true = paths.nominal.c2w[rows], paths.rgb.c2w[rows]
        to_camera = nominal[:, :3, :3].swapaxes(1, 2)
        # The difference first: far from the origin, little of it would be left of the product of poses.
        moved_m = _product(to_camera, true[:, :3, 3:] - nominal[:, :3, 3:])[..., 0] + 0.0
        quats_wxyz = quat_wxyz_from_rotation(_product(to_camera, true[:, :3, :3])) + 0.0
        for frame, translation_m, quat_wxyz in zip(found, moved_m.tolist(), quats_wxyz.tolist(), strict=True):
            frame["deviation"] = {"translation_m": translation_m, "quat_wxyz": quat_wxyz}
    for name, made in drawn_motion(render.moving, count, render.identifiers).items():
        for frame, row in zip(found, rows, strict=True):
            frame.setdefault("drawn", {})[name] = {key: (values[row] + 0.0).tolist() for key, values in made.items()}
    return found if any(found) else []


def _product(left: Float64, right: Float64) -> Float64:
    """(N, 3, 3), (N, 3, K) -> (N, 3, K): their product, added up in one order, so the same everywhere."""
    return sum((left[:, :, k, None] * right[:, k, None, :] for k in (1, 2)), left[:, :, 0, None] * right[:, 0, None, :])
