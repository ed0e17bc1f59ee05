# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a study: notes of its sequences are passed on, their own progress is not."""

from ...core.progress import Progress


class NotesOnly(Progress):
    """A listener that hands on notes on a scene alone."""

    def __init__(self, progress: Progress, scene: str) -> None:
        """Take who hears them."""
        self._progress = progress
        self._scene = scene

    def note(self, text: str, subject: str = "") -> None:
        """Hand on a sentence on the scene: what concerns the sequence's files, nobody sees."""
        if text.startswith(self._scene):
            self._progress.note(text, subject or text)
