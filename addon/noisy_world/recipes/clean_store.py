# SPDX-License-Identifier: GPL-3.0-or-later
"""A store of clean frames, with the paths that they lie on.

It holds, for each scene, `SCENE/path.npy`, and the clean files of each render in the folder of its name. `clean.json`
is written first: what they were made from.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ..core.channels import CHANNELS
from ..core.channels.surface import Fact
from ..core.datasets.dataset_state import WORK_FOLDER, identity_problem
from ..core.datasets.differences import first_difference
from ..core.datasets.identity_mismatch import clean_identity
from ..core.datasets.json_text import read_json
from ..core.datasets.provenance import FORMAT as IDENTITY_FORMAT
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.planning.simple_source import SimpleSource
from ..core.planning.source import PreparedSource, SourceCapabilities
from ..core.trajectories.trajectory import Axes, Trajectory
from ..pipeline.clean_files import AGAIN, CleanFiles, KeptFrame, array_in
from .inputs import different_input

CLEAN = "clean.json"
PATH = "path.npy"
KIND = "clean frames of Noisy World"
FORMAT = 2  # version of the store; raised when its files change


@dataclass(frozen=True)
class CleanStore:
    """A store of clean frames. identity: what they were made from, as in a dataset's manifest, and robot_axes."""

    folder: Path
    identity: Mapping[str, Any]

    def has_scene(self, scene: str) -> bool:
        """Tell whether it holds the path of a scene."""
        return scene in self.identity["scenes"] and (self.folder / scene / PATH).is_file()

    def files(self, render: str) -> CleanFiles:
        """Return the clean frames of a render."""
        return CleanFiles(self.folder / render, self.folder / WORK_FOLDER)

    def frame(self, render: str, source: int) -> KeptFrame | None:
        """Return a source frame of a render; None where it holds none of its images."""
        files = self.files(render)
        return files.kept(source) if any(files.path(name, source).is_file() for name in CHANNELS) else None

    def source(self, scene: str) -> "StoredScene":
        """Return what is known of a scene, as a source. Raises InputError where its path is damaged."""
        path = self.folder / scene / PATH
        rows = array_in(path)
        if rows.ndim != 2 or rows.shape[1] != 17 or rows.dtype != np.float64 or not len(rows):
            raise InputError(path, f"is {rows.dtype} {rows.shape}, but a path is float64 (N, 17)", remedy=AGAIN)
        known = self.identity["scenes"][scene]
        axes = known.get("robot_axes")
        return StoredScene(self.folder / scene, Trajectory(rows[:, 1:].reshape(-1, 4, 4), rows[:, 0]), axes, known)

    def check(self, wanted: Mapping[str, Any], scene: str, setting: str) -> None:
        """Raise InputError where its frames of a scene are not those of a recipe; see `difference`."""
        if problem := self.difference(wanted, scene, setting):
            remedy = "take the clean frames that were made from this recipe"
            raise InputError(self.folder, f"holds frames of another recipe: {problem}", remedy=remedy)

    def difference(self, wanted: Mapping[str, Any], scene: str, setting: str) -> str:
        """Return why its frames of a scene are not those of a recipe, or "".

        wanted: the recipe's identity. setting: whose render is asked for.
        """
        moved = setting if (self.folder / f"{scene}@{setting}").is_dir() else ""
        left, right = (clean_identity(identity, scene, moved) for identity in (wanted, self.identity))
        inputs = [made_from["scenes"][scene].pop("inputs") for made_from in (left, right)]
        if found := different_input(*inputs):
            return f"{scene}: {found[0]} {found[1]}"
        other = {"versions": None, "processor": None}  # of which the user is warned
        return first_difference({**left, **other}, {**right, **other}) or ""


def read_store(folder: Path) -> CleanStore:
    """Open a store. Raises InputError where the folder is none."""
    path = folder / CLEAN
    try:
        content = read_json(path)
    except FileNotFoundError as error:
        problem = "is no folder of clean frames" if folder.is_dir() else "no such folder"
        raise InputError(folder, problem, remedy="'noisy-world render-clean RECIPE --out DIR' makes one") from error
    except ValueError as error:
        raise InputError(path, str(error), remedy=AGAIN) from error
    identity: Any = content.get("identity") if isinstance(content, dict) else None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(path, "does not tell of clean frames", remedy=AGAIN)
    if content.get("format") != FORMAT or not isinstance(identity, dict) or identity.get("format") != IDENTITY_FORMAT:
        raise InputError(path, "was written by another version of Noisy World", remedy="make the frames again")
    if problem := identity_problem(identity):
        raise InputError(path, problem, remedy=AGAIN)
    return CleanStore(folder, identity)


ANY: frozenset[Fact] = frozenset(get_args(Fact))  # what the frames have of it has been made


@dataclass(frozen=True)
class StoredScene(SimpleSource):
    """A scene of a store as a source: its path is known, and its frames are those that the store holds."""

    folder: Path
    path: Trajectory
    axes: Axes | None
    known: Mapping[str, Any]

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.folder)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Frames that nobody renders, from paths that may deviate."""
        return SourceCapabilities(rendered=False, any_pose=True, surface=ANY, moving="blend" in self.known["inputs"])

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses."""
        return self.axes

    def trajectory(self) -> Trajectory:
        """Return the path."""
        return self.path

    def hashes(self) -> dict[str, Any]:
        """Return the inputs that the frames were made from."""
        return dict(self.known["inputs"])

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Raise InputError: there are no frames but those that the store holds."""
        del camera, note
        raise InputError(self.folder, "does not hold this frame", remedy=AGAIN)
