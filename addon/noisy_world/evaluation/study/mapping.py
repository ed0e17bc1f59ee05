# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of a case's runs, held against the true scene: what the system wrote, or its frames fused along its path."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from ...core.progress import Progress
from ..maps.along import map_of_run
from ..maps.score import score_map
from ..maps.truth import TrueMap, true_map_of_mesh, true_map_of_recording
from .origin import CaseSequence
from .scoring import Scored


class MapsOfCase:
    """Scores the maps of a case's runs; the true map is made for the first of them."""

    def __init__(self, sequence: CaseSequence, closing: contextlib.ExitStack) -> None:
        """Take the sequence. closing: ends what the true map is seen with."""
        self._sequence = sequence
        self._closing = closing
        self._truth: TrueMap | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is something to hold a map against: the scene's mesh, or frames without noise."""
        sequence = self._sequence
        return sequence.opened.camera is not None and (sequence.mesh is not None or sequence.clean is not None)

    def score(self, folder: Path, scored: Scored, progress: Progress) -> dict[str, float | None]:
        """Return what is said of the map of the run in a folder; {} where nothing is there to hold it against."""
        camera = self._sequence.opened.camera
        if camera is None or not self.is_known:
            return {}
        frames = list(self._sequence.opened)
        found = map_of_run(folder, scored.estimate, scored.by, frames, camera)
        if found.problem and scored.by is not None:
            progress.note(f"{folder}: has no map: {found.problem}")
        return score_map(found.mesh, self._true()).values

    def _true(self) -> TrueMap:
        if self._truth is None:
            self._truth = self._closing.enter_context(self._made())
        return self._truth

    def _made(self) -> TrueMap:
        sequence = self._sequence
        camera = sequence.opened.camera
        assert camera is not None
        if sequence.mesh is not None:
            return true_map_of_mesh(sequence.mesh(), camera, sequence.truth.c2w)
        assert sequence.clean is not None
        return true_map_of_recording(list(sequence.clean), camera)


@contextlib.contextmanager
def maps_of(sequence: CaseSequence) -> Iterator[MapsOfCase]:
    """Return what scores the maps of a case's runs."""
    with contextlib.ExitStack() as closing:
        yield MapsOfCase(sequence, closing)
