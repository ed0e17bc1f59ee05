# SPDX-License-Identifier: GPL-3.0-or-later
"""The parameters of SplaTAM, `params.npz`.

As rgbd_slam in scripts/splatam.py and build_rotation in utils/slam_external.py of
https://github.com/spla-tam/SplaTAM have them: `cam_unnorm_rots` (1, 4, N), quaternions w first of any length, and
`cam_trans` (1, 3, N), metres: world-to-camera, where the world is the first camera. Axes are OpenCV's.
"""

from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.geometry import pose, rotation_from_quat_wxyz
from ...core.trajectory import convert_convention
from . import Asked, EstimateFormat, ReadPoses, check_finite, unit_quats
from .pose_arrays import load_arrays

ROTATIONS = "cam_unnorm_rots"
TRANSLATIONS = "cam_trans"


def read(path: Path, asked: Asked) -> ReadPoses:
    """Read the parameters: a pose for every frame. Raises InputError."""
    arrays = load_arrays(path, (ROTATIONS, TRANSLATIONS), largest_bytes=asked.largest_bytes)
    lacking = next((name for name in (ROTATIONS, TRANSLATIONS) if name not in arrays), None)
    if lacking is not None:
        raise InputError(path, f"holds no {lacking}")
    quats, translations = (arrays[name] for name in (ROTATIONS, TRANSLATIONS))
    count = quats.shape[-1] if quats.ndim else 0
    if quats.shape != (1, 4, count) or translations.shape != (1, 3, count):
        raise InputError(path, f"has {ROTATIONS} of {quats.shape} and {TRANSLATIONS} of {translations.shape}")
    values = np.concatenate([quats[0], translations[0]]).T.astype(np.float64)
    places = [f"frame {number}" for number in range(count)]
    check_finite(path, places, values)
    w2c = pose(rotation_from_quat_wxyz(unit_quats(path, places, values[:, :4])), values[:, 4:])
    c2w = convert_convention(w2c, direction="w2c", axes="opencv")
    return ReadPoses("splatam", c2w, numbers=np.arange(count), count=count)


def _recognises(path: Path, head: bytes) -> bool:
    del head
    return path.name == "params.npz"


FORMAT = EstimateFormat("splatam", "SplaTAM's params.npz", read, _recognises, reads_parts=True)
