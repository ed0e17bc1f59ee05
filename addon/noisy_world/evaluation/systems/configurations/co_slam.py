# SPDX-License-Identifier: GPL-3.0-or-later
"""Co-SLAM (https://github.com/HengyiWang/Co-SLAM): `coslam.py --config CONFIGURATION`.

As configs/Replica/replica.yaml, which a configuration inherits, and room0.yaml. Its loader takes the whole part of the
intrinsics (datasets/dataset.py divides them by the downsampling factor with //). Its checkpoints are
OUTPUT/EXP_NAME/checkpointN.pt.
"""

from pathlib import Path
from typing import Any

from ....core.yaml_reading import yaml_text
from ...estimates.frames import Index
from .given import RESULT, bound_m, camera_keys, scaled_edges, then_poses, write_sequence, write_text

_EDGE_PX = 20  # configs/Replica/replica.yaml: tracking.ignore_edge_W and _H


def co_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    sequence, bound = write_sequence(index, folder), bound_m(index)
    document: dict[str, Any] = {
        "inherit_from": "configs/Replica/replica.yaml",
        "tracking": scaled_edges(index, _EDGE_PX),
        "mapping": {"bound": bound, "marching_cubes_bound": bound},
        "cam": {**camera_keys(index), "crop_edge": 0, "near": 0, "far": bound[0][1]},
        "data": {"datadir": str(sequence), "trainskip": 1, "output": str(folder), "exp_name": RESULT},
    }
    configuration = write_text(folder / "configuration.yaml", yaml_text(document))
    return then_poses("co_slam", folder / RESULT, folder, "coslam.py", "--config", str(configuration))
