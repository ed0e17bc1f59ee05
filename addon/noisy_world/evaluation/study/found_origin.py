# SPDX-License-Identifier: GPL-3.0-or-later
"""The sequences of a folder: a dataset of Noisy World, or recordings with ground truth. Nothing is made or removed."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...core.datasets.dataset_state import read_dataset_state
from ...core.datasets.provenance import path_sha256
from ...core.errors import InputError
from ...core.presets.selection import selected
from ...core.progress import Progress
from ...core.schema import ConfigPath
from ...perturbations import registry
from ...recipes.from_files import OpenedFolder, SequenceOfFiles
from ...recipes.opening import open_path
from .cases import CLEAN, RECORDED, Case, Condition
from .origin import CaseSequence


class FoundOrigin:
    """The sequences of a folder. What a setting is follows from the dataset's manifest, or else from its name."""

    def __init__(self, folder: Path, scenes: Sequence[str] = (), settings: Sequence[str] = ()) -> None:
        """Find the sequences. scenes, settings: names or globs of those that are wanted, if not all.

        Raises InputError where there is none, and where the folder holds sequences in tars.
        """
        opened = open_path(folder)
        if not isinstance(opened, OpenedFolder):
            raise InputError(folder, "holds sequences in tars, and systems read files", remedy="unpack them")
        self._opened = opened
        state = read_dataset_state(folder)
        self._made_from = None if state is None else state.identity
        seed = 0 if self._made_from is None else int(self._made_from["seed"])
        self._names = {_case(name, seed): name for name in opened}
        if len(self._names) < len(opened):
            raise InputError(folder, "holds two sequences of one name", remedy="name one of the folders in it")
        of_scenes = self._wanted("scene", scenes)
        of_settings = self._wanted("setting", settings)
        self._names = {
            case: name for case, name in self._names.items() if case.scene in of_scenes and case.setting in of_settings
        }
        if not self._names:
            raise InputError(folder, "holds none of these scenes in any of these settings")

    def _wanted(self, what: Literal["scene", "setting"], globs: Sequence[str]) -> set[str]:
        """Return the scenes or settings that are wanted. Raises InputError where a glob matches none."""
        names = list(dict.fromkeys(getattr(case, what) for case in self._names))
        return set(selected(names, list(globs) or None, ConfigPath(self._opened.place).at(f"{what}s")))

    @property
    def identity(self) -> dict[str, Any]:
        """The sequences with what their frames and true poses are known by; and what the dataset was made from."""
        return self._identity

    @cached_property
    def _identity(self) -> dict[str, Any]:
        return {
            "found": {case.name: self._known_by(case) for case in sorted(self._names)},
            "settings": self._settings,
        }

    def _known_by(self, case: Case) -> dict[str, Any]:
        truth = self._sequence(case).stored.trajectory
        return {"frames": len(truth), "sha256": path_sha256(truth, truth.stamps_s, len(truth))}

    @property
    def _settings(self) -> dict[str, Any]:
        known = {} if self._made_from is None else self._made_from["settings"]
        return {case.setting: known[case.setting] for case in sorted(self._names) if case.setting in known}

    @property
    def frames(self) -> Mapping[Case, int]:
        """The cases, scene by scene, their settings by name; the clean one of a scene is the first."""
        return self._frames

    @cached_property
    def _frames(self) -> Mapping[Case, int]:
        ordered = sorted(self._names, key=lambda case: (case.scene, case.setting != CLEAN))
        return {case: len(self._opened[self._names[case]]) for case in ordered}

    def condition(self, setting: str) -> Condition:
        """Return what is done in a setting: of one that no manifest tells of, its name."""
        if setting in self._settings:
            return Condition.of(self._settings[setting], registry())
        return Condition.of_name(setting)

    @contextmanager
    def sequence(self, case: Case, progress: Progress) -> Iterator[CaseSequence]:
        """Return the sequence of a case."""
        opened = self._sequence(case)
        for note in opened.stored.notes:
            progress.note(f"{case.scene}: {note}", case.name)
        yield CaseSequence(opened.stored.folder, opened.stored.trajectory, opened, self._clean(case, opened))

    def _clean(self, case: Case, opened: SequenceOfFiles) -> SequenceOfFiles | None:
        """Return the clean sequence of the scene, where each of its frames is seen from where the case's is."""
        other = Case(case.scene, CLEAN, case.seed)
        if case.setting == CLEAN or other not in self._names:
            return None
        clean = self._sequence(other)
        same = np.array_equal(clean.stored.trajectory.c2w, opened.stored.trajectory.c2w)
        return clean if same and list(clean.frames) == list(opened.frames) else None

    def _sequence(self, case: Case) -> SequenceOfFiles:
        opened = self._opened[self._names[case]]
        assert isinstance(opened, SequenceOfFiles), "a folder's sequences are files"
        return opened

    def finished(self, scene: str) -> None:
        """Do nothing: nothing was kept."""
        del scene


def _case(name: str, seed: int) -> Case:
    *above, scene = name.split("/")
    return Case(scene, above[-1] if above else RECORDED, seed)
