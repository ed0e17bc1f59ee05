# SPDX-License-Identifier: GPL-3.0-or-later
"""A run that another process has opened, and that this one takes part in."""

from pathlib import Path
from typing import Any

from ..errors import CannotJoinError
from .dataset_state import IDENTITY, WORK_FOLDER, read_dataset_state
from .identity_mismatch import identity_mismatch


class OpenRun:
    """The run that is open in a dataset's folder. What it makes is read once: each shard asks, of maybe thousands."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._read: tuple[tuple[int, int, int], dict[str, Any] | None] | None = None  # by the file's version

    def join(self, identity: dict[str, Any], *, any_processor: bool = False) -> None:
        """Take part in the run, which was opened with the same `identity`, or with more than that.

        any_processor: whether frames of another kind of processor are good enough. Raises CannotJoinError where no run
        is open, or where this process has another identity and would write other bytes.
        """
        opened = self._identity()
        if opened is None:
            raise CannotJoinError("no run is open here", file=self._out)
        if difference := identity_mismatch(opened, identity, any_processor=any_processor):
            raise CannotJoinError(
                f"the run was opened with another identity ({difference})",
                file=self._out,
                remedy="do not change its inputs while it runs, and start it again",
            )

    def _identity(self) -> dict[str, Any] | None:
        """Return what the run makes; None where no run is open, or where that cannot be read."""
        work = self._out / WORK_FOLDER
        try:
            found = (work / IDENTITY).stat()
        except OSError:
            return None
        version = found.st_ino, found.st_size, found.st_mtime_ns
        if self._read is None or self._read[0] != version:
            there = read_dataset_state(self._out, ()) if (work / "unfinished").is_dir() else None
            self._read = version, None if there is None or there.problem else there.identity
        return self._read[1]
