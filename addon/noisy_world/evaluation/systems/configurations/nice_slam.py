# SPDX-License-Identifier: GPL-3.0-or-later
"""NICE-SLAM, and iMAP as it comes with it (https://github.com/cvg/nice-slam): `run.py CONFIGURATION [--imap]`.

A configuration inherits the one that is published for Replica, by its path in the checkout, and says what depends on
the sequence: configs/Replica/replica.yaml, room0.yaml, and their _imap. Its checkpoints are OUTPUT/ckpts/NNNNN.tar.
"""

from pathlib import Path
from typing import Any

from ....core.yaml_reading import yaml_text
from ...estimates.frames import Index
from .given import RESULT, bound_m, camera_keys, scaled_edges, then_poses, write_sequence, write_text

_IMAP_SCALE = 0.1  # configs/imap.yaml, as programs/checkpoint_poses.py undoes it
_EDGE_PX = 100  # configs/Replica/replica.yaml: tracking.ignore_edge_W and _H


def nice_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    return _started("nice_slam", folder, str(_write(index, folder, "configs/Replica/replica.yaml", {})))


def imap(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    own = {"scale": _IMAP_SCALE}
    return _started("imap", folder, str(_write(index, folder, "configs/Replica/replica_imap.yaml", own)), "--imap")


def _started(kind: str, folder: Path, *words: str) -> list[str]:
    return then_poses(kind, folder / RESULT / "ckpts", folder, "run.py", *words)


def _write(index: Index, folder: Path, inherited: str, own: dict[str, Any]) -> Path:
    sequence, bound = write_sequence(index, folder), bound_m(index)
    document: dict[str, Any] = {
        "inherit_from": inherited,
        **own,
        "tracking": scaled_edges(index, _EDGE_PX),
        "mapping": {"bound": bound, "marching_cubes_bound": bound},
        "meshing": {"eval_rec": False},
        "cam": {**camera_keys(index), "crop_edge": 0},
        "data": {"input_folder": str(sequence), "output": str(folder / RESULT)},
    }
    return write_text(folder / "configuration.yaml", yaml_text(document))
