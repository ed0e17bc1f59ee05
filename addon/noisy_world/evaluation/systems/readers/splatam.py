# SPDX-License-Identifier: GPL-3.0-or-later
"""The parameters of SplaTAM, `params.npz`.

As rgbd_slam in scripts/splatam.py and build_rotation in utils/slam_external.py of
https://github.com/spla-tam/SplaTAM have them: `cam_unnorm_rots` (1, 4, N), quaternions w first of any length, and
`cam_trans` (1, 3, N), metres: world-to-camera, where the world is the first camera. Axes are OpenCV's.
"""

from pathlib import Path

import numpy as np

from ....core.errors import InputError
from ....core.geometry import pose, rotation_from_quat_wxyz
from ...estimate import Estimate
from ..leavings import LARGEST_READ_BYTES
from .arrays import load_arrays
from .frames import Index, check_every_frame, check_finite, estimate_of_frames

ROTATIONS = "cam_unnorm_rots"
TRANSLATIONS = "cam_trans"


def read(path: Path, index: Index, *, largest_bytes: int = LARGEST_READ_BYTES) -> Estimate:
    """Return the estimate of the parameters. Raises InputError."""
    arrays = load_arrays(path, (ROTATIONS, TRANSLATIONS), largest_bytes=largest_bytes)
    lacking = next((name for name in (ROTATIONS, TRANSLATIONS) if name not in arrays), None)
    if lacking is not None:
        raise InputError(path, f"holds no {lacking}")
    quats, translations = (arrays[name] for name in (ROTATIONS, TRANSLATIONS))
    count = quats.shape[-1] if quats.ndim else 0
    if quats.shape != (1, 4, count) or translations.shape != (1, 3, count):
        raise InputError(path, f"has {ROTATIONS} of {quats.shape} and {TRANSLATIONS} of {translations.shape}")
    check_every_frame(path, count, index)
    values = np.concatenate([quats[0], translations[0]]).T.astype(np.float64)
    check_finite(path, [f"frame {number}" for number in range(count)], values)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(values[:, :4], axis=1)
    if not (usable := (lengths > 0.0) & np.isfinite(lengths)).all():
        problem = "its rotation is a quaternion of zeros, or of numbers beyond 1e154"
        raise InputError(path, problem, where=f"frame {int(np.argmin(usable))}")
    w2c = pose(rotation_from_quat_wxyz(values[:, :4] / lengths[:, None]), values[:, 4:])
    return estimate_of_frames(path, range(count), w2c, index, direction="w2c")
