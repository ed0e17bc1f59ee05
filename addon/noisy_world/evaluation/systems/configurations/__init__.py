# SPDX-License-Identifier: GPL-3.0-or-later
"""Systems' own configuration files, written from the frames that a system is given, and how each is started.

A system lies where its environment does: `.venv-NAME/bin/python` is its Python, `.venv-NAME/checkout` its code.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...estimates.frames import Index
from .co_slam import co_slam
from .go_slam import go_slam, go_slam_mono
from .nice_slam import imap, nice_slam
from .splatam import splatam_s

__all__ = ["CONFIGURATIONS", "Configuration"]


@dataclass(frozen=True)
class Configuration:
    """How a system is configured and started.

    environment: the environment beside the project that it is run in. home: where its code comes from. write: writes
    what it reads into a folder, whose path is absolute, and returns the arguments of its Python, which is started in
    its checkout. programs: files of the checkout that have to be there.
    """

    environment: str
    home: str
    write: Callable[[Index, Path], list[str]]
    programs: tuple[str, ...]


CONFIGURATIONS: dict[str, Configuration] = {
    "imap": Configuration(
        "nice-slam", "https://github.com/cvg/nice-slam", imap, ("run.py", "configs/Replica/replica_imap.yaml")
    ),
    "nice_slam": Configuration(
        "nice-slam", "https://github.com/cvg/nice-slam", nice_slam,
        ("run.py", "configs/Replica/replica.yaml", "pretrained/coarse.pt", "pretrained/middle_fine.pt"),
    ),
    "co_slam": Configuration(
        "co-slam", "https://github.com/HengyiWang/Co-SLAM", co_slam, ("coslam.py", "configs/Replica/replica.yaml")
    ),
    "go_slam": Configuration(
        "go-slam", "https://github.com/youmi-zym/GO-SLAM", go_slam, ("run.py", "configs/Replica/replica.yaml")
    ),
    "go_slam_mono": Configuration(
        "go-slam", "https://github.com/youmi-zym/GO-SLAM", go_slam_mono, ("run.py", "configs/Replica/replica_mono.yaml")
    ),
    "splatam_s": Configuration(
        "splatam", "https://github.com/spla-tam/SplaTAM", splatam_s,
        ("scripts/splatam.py", "configs/replica/splatam_s.py"),
    ),
}  # fmt: skip
"""Every configuration by the name of its system."""
