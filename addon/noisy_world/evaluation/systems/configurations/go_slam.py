# SPDX-License-Identifier: GPL-3.0-or-later
"""GO-SLAM (https://github.com/youmi-zym/GO-SLAM): `run.py CONFIGURATION --mode mono|rgbd`.

As configs/Replica/replica.yaml, replica_mono.yaml and room0_mono.yaml, which a configuration inherits. Poses:
OUTPUT/checkpoints/est_poses.npy.
"""

import math
from pathlib import Path
from typing import Any, Literal

from ....core.yaml_reading import yaml_text
from ...estimates.frames import Index
from .given import RESULT, camera_keys, write_sequence, write_text

_AREA_PX = 320 * 640  # of the images that it works on: H_out, W_out of configs/Replica/replica.yaml
_STEP_PX = 8  # src/motion_filter.py works on eighths of the image
_MOST_KEYFRAMES = 512  # configs/go_slam.yaml: tracking.buffer, some 10 MB of GPU memory each


def go_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration of a run with depth; return the arguments of Python."""
    return _write(index, folder, "rgbd", "configs/Replica/replica.yaml")


def go_slam_mono(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration of a run without depth; return the arguments of Python."""
    return _write(index, folder, "mono", "configs/Replica/replica_mono.yaml")


def _write(index: Index, folder: Path, mode: Literal["mono", "rgbd"], inherited: str) -> list[str]:
    sequence = write_sequence(index, folder)
    height, width = working_size(int(index["camera"]["height"]), int(index["camera"]["width"]))
    document: dict[str, Any] = {
        "inherit_from": inherited,
        "mode": mode,
        "mapping": {"bound": [[-2.0, 2.0]] * 3},  # where it begins: it finds the bounds itself
        "tracking": {"buffer": min(max(len(index["frames"]), 64), _MOST_KEYFRAMES)},
        "cam": {**camera_keys(index), "H_out": height, "W_out": width, "H_edge": 0, "W_edge": 0},
        "meshing": {"eval_rec": False, "gt_mesh_path": ""},
        "data": {"input_folder": str(sequence), "output": str(folder / RESULT)},
    }
    configuration = write_text(folder / "configuration.yaml", yaml_text(document))
    return ["run.py", str(configuration), "--device", "cuda:0", "--mode", mode]


def working_size(height_px: int, width_px: int) -> tuple[int, int]:
    """Return the size of the images that it works on: of the shape of the given ones, not larger, of whole eighths."""
    scale = min(1.0, math.sqrt(_AREA_PX / (height_px * width_px)))
    return (
        max(_STEP_PX, round(scale * height_px / _STEP_PX) * _STEP_PX),
        max(_STEP_PX, round(scale * width_px / _STEP_PX) * _STEP_PX),
    )
