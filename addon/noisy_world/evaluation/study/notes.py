# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user hears of the sequences of a study: each note once, and no progress of their own."""

from ...core.progress import Progress


class NotesOnly:
    """A listener that hands on notes on a scene alone."""

    def __init__(self, progress: Progress, scene: str) -> None:
        """Take who hears them."""
        self._progress = progress
        self._scene = scene

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Say nothing."""

    def advance(self, count: int = 1) -> None:
        """Say nothing."""

    def note(self, text: str, subject: str = "") -> None:
        """Hand on a sentence on the scene: what concerns the sequence's files, nobody sees."""
        if text.startswith(self._scene):
            self._progress.note(text, subject or text)

    def finish(self) -> None:
        """Say nothing."""


class EachOnce:
    """A listener that hands on all but a second note on a subject."""

    def __init__(self, progress: Progress) -> None:
        """Take who hears it."""
        self._progress = progress
        self._subjects = set[str]()

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Hand it on."""
        self._progress.start(label, total, done)

    def advance(self, count: int = 1) -> None:
        """Hand it on."""
        self._progress.advance(count)

    def note(self, text: str, subject: str = "") -> None:
        """Hand on a sentence, unless there was one on its subject."""
        if (subject or text) not in self._subjects:
            self._subjects.add(subject or text)
            self._progress.note(text)

    def finish(self) -> None:
        """Hand it on."""
        self._progress.finish()
