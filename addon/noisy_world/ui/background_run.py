# SPDX-License-Identifier: GPL-3.0-or-later
"""A command that runs in another process, followed from a window that stays usable. It does not use Blender."""

import contextlib
import queue
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias

from ..core.exit_statuses import INTERRUPTED
from ..core.progress import read_message

NOTES_KEPT = 4  # chosen: as many sentences as the panel can show

Phase: TypeAlias = Literal["starting", "running", "stopping", "finished", "stopped", "failed"]


class BackgroundRun:
    """A command's process and its messages so far. All methods are called from one thread."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        who: str = "the generator",
        patient: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start the command, which has to send the messages of `--progress json`.

        who: its name in messages. patient: whether it is asked to end, rather than ended, when it is cancelled.

        Raises OSError where it cannot be started.
        """
        self.phase: Phase = "starting"
        self.label = self.where = ""
        self.done = self.total = 0
        self.notes: deque[str] = deque(maxlen=NOTES_KEPT)
        self.result = ""
        self.error = ""
        self._who = who
        self._patient = patient
        self._clock = clock
        self._first = 0
        self._start_s = self._last_s = clock()
        self._messages: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        # A file, not a pipe, which would block the process if nobody read it.
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process has ended
        try:
            self._process = subprocess.Popen(  # noqa: S603 - this program and the generator beside it
                list(command), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._errors, text=True,
                encoding="utf-8", errors="replace",
            )  # fmt: skip
        except BaseException:
            self._errors.close()
            raise
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if (message := read_message(line)) is not None:
                self._messages.put(message)

    @property
    def active(self) -> bool:
        """Tell whether the process was running at the last poll."""
        return self.phase in ("starting", "running", "stopping")

    @property
    def fraction(self) -> float:
        """The share of frames that are done, 0 to 1."""
        return self.done / self.total if self.total else 0.0

    @property
    def frames_per_s(self) -> float | None:
        """Frames per second of this run, including loading; None before the first frame."""
        made, elapsed_s = self.done - self._first, self._last_s - self._start_s
        return made / elapsed_s if made > 0 and elapsed_s > 0 else None

    def poll(self) -> bool:
        """Process the messages that have arrived; return whether anything changed."""
        if not self.active:
            return False
        ended = self._process.poll() is not None
        if ended:  # its last messages may still be in the pipe
            self._listener.join(timeout=2.0)
        changed = ended
        with contextlib.suppress(queue.Empty):
            while True:
                self._hear(self._messages.get_nowait())
                changed = True
        if ended:
            self._conclude(self._process.returncode)
        return changed

    def _hear(self, message: dict[str, Any]) -> None:
        match message:
            case {"start": {"label": label, "total": total, "done": done}}:
                self.label, self.total, self.done, self._first = label, total, done, done
                self._start_s = self._last_s = self._clock()
                if self.phase == "starting":
                    self.phase = "running"
            case {"advance": count}:
                self.done += count
                self._last_s = self._clock()
            case {"note": text}:
                if text not in self.notes:  # each sequence of a run may say it
                    self.notes.append(text)
            case {"error": text}:
                self.error = text
            case {"result": text}:
                self.result = text

    def _conclude(self, status: int) -> None:
        if status == 0:
            self.phase = "finished"
        elif self.phase == "stopping" or (status == INTERRUPTED and not self.error):
            self.phase = "stopped"
        else:
            self.phase = "failed"
            self.error = self.error or f"{self._who} ended with status {status}: {self._last_words()}"
        self._close()

    def _last_words(self) -> str:
        self._errors.seek(0)
        lines = [line.strip() for line in self._errors.read().decode(errors="replace").splitlines()]
        return next((line for line in reversed(lines) if line), "it said nothing")

    def _close(self) -> None:
        self._errors.close()
        if self._process.stdout is not None and not self._listener.is_alive():
            self._process.stdout.close()

    def cancel(self) -> None:
        """Ask the process to end after the current frame; called again, end it at once. Either way a run can resume."""
        if not self.active:
            return
        if self.phase == "stopping" or not self._patient:
            self._process.kill()
        else:
            # Not SIGINT, which a Blender program ignores while it starts.
            self._process.terminate()
        self.phase = "stopping"

    def close(self, timeout_s: float = 2.0) -> None:
        """End the process, by force if necessary, and release its files."""
        if not self.active:
            return
        self.cancel()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.poll()

    def wait(self) -> None:
        """Process messages until the process ends."""
        while self.active:
            self.poll()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(0.1)
