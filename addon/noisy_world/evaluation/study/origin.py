# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the sequences of a study come from: made of a preset one by one, or found in a folder."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ...core.progress import Progress
from ...core.scenes.mesh import Mesh
from ...core.trajectories.trajectory import Trajectory
from ...recipes.opened import OpenedSequence
from .cases import Case, Condition


@dataclass(frozen=True)
class CaseSequence:
    """The sequence of a case, on the disk.

    folder: where it lies. truth: the colour camera's poses, one for each frame. opened: its frames. clean: the frames
    that it would have without what was done to colour, depth and their pairing; None where nothing was, or they are not
    there. mesh: returns what the true scene is; None where nobody knows.
    """

    folder: Path
    truth: Trajectory
    opened: OpenedSequence
    clean: OpenedSequence | None
    mesh: Callable[[], Mesh] | None = None


class Origin(Protocol):
    """The sequences of a study."""

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the sequences, as plain JSON values."""
        ...

    @property
    def frames(self) -> Mapping[Case, int]:
        """The cases in the order in which they are evaluated, with the number of frames of each."""
        ...

    def condition(self, setting: str) -> Condition:
        """Return what is done in a setting."""
        ...

    def sequence(self, case: Case, progress: Progress) -> AbstractContextManager[CaseSequence]:
        """Return the sequence of a case, which is there as long as the context; the progress hears its notes."""
        ...

    def finished(self, scene: str) -> None:
        """Let go of what was kept for a scene, of which no case is left."""
        ...
