# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether an estimate's rotations look as if its quaternions were written in another order than they were read."""

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import quat_wxyz_from_rotation, rotation_from_quat_wxyz
from .alignment import IDENTITY, aligned_poses, full_pose_alignment
from .compared import Compared
from .errors import rotation_errors_deg

WRONG_DEG = 30.0  # chosen: the median error of rotations from which on they cannot be those of the positions
SMALL_SHARE = 0.1  # chosen: of the path's extent, below which an ATE says that the positions are right
BETTER = 5.0  # chosen: times that the other order has to make the error smaller
TURNED_DEG = 150.0  # chosen: a median error from which on the camera looks the other way


def rotation_notes(matched: Compared) -> tuple[str, ...]:
    """Return a sentence where the positions fit and the rotations do not, as of quaternions w x y z read as x y z w.

    matched: an estimate that lies over the truth. Rotations are those of full poses, so that a path which does not say
    how it is turned about itself accuses nobody.
    """
    by, known = matched.by, matched.conditioning
    if by is None or known is None or matched.rotation.median < WRONG_DEG:
        return ()
    rotation = matched.rotation
    extent_m = float(np.linalg.norm(np.ptp(matched.true[:, :3, 3], axis=0)))
    if matched.position.rmse > SMALL_SHARE * extent_m:
        return ()
    said = f"the positions fit and the rotations are off by {rotation.median:.0f} degrees (median)"
    other = _read_w_first(matched.estimate, by.rotation)
    if by is not matched.by_poses:
        other = aligned_poses(other, full_pose_alignment(other, matched.true, IDENTITY, known))
    other_deg = float(np.median(rotation_errors_deg(other, matched.true)))
    if other_deg * BETTER < rotation.median:
        return (
            f"{said}, but by {other_deg:.2g} if the quaternions are taken for w x y z: they look as if they were "
            "written w first and read as x y z w. Write them w last, as TUM's format has them, or as EuRoC's table",
        )
    if rotation.median > TURNED_DEG:
        return (f"{said}: its cameras may have other axes (--axes), or its quaternions another order than x y z w",)
    return ()


def _read_w_first(aligned: NDArray[np.float64], alignment: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 4, 4) after an alignment (3, 3) -> the same with the numbers x y z w of each rotation taken for w x y z."""
    found = np.array(aligned)
    read_xyzw = np.roll(quat_wxyz_from_rotation(alignment.T @ aligned[:, :3, :3]), -1, axis=1)
    found[:, :3, :3] = alignment @ rotation_from_quat_wxyz(read_xyzw)
    return found
