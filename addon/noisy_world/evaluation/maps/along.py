# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of an estimated path, where a system writes none: the frames it was given, fused along its poses."""

from collections.abc import Sequence

import numpy as np

from ...core.geometry import Intrinsics
from ..estimate import Estimate
from ..metrics.alignment import Similarity, aligned_poses
from ..metrics.association import MAX_DIFFERENCE_S, associate_poses
from .fusing import FAR_M, VOXEL_M, Fused, fuse


def fuse_along(
    estimate: Estimate,
    frames: Sequence,
    camera: Intrinsics,
    *,
    by: Similarity | None = None,
    max_difference_s: float = MAX_DIFFERENCE_S,
    voxel_m: float = VOXEL_M,
    far_m: float = FAR_M,
) -> Fused:
    """Fuse the frames that have an estimated pose, as stamps say; images of the others are not read.

    frames: as they were given to the system, with stamp_s, rgb and depth_m. by: the alignment of the estimate; the map
    then lies in the true world, with the frames' own scale, also where the estimate has another.
    """
    stamps_s = np.array([frame.stamp_s for frame in frames])
    rows, of_frames = associate_poses(estimate.stamps_s, stamps_s, max_difference_s)
    c2w = estimate.c2w[rows] if by is None else aligned_poses(estimate.c2w[rows], by)
    poses = dict(zip(of_frames.tolist(), c2w, strict=True))
    every = (poses.get(index) for index in range(len(frames)))
    return fuse(frames, every, camera, voxel_m=voxel_m, far_m=far_m)
