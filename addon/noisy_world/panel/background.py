# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that run in other processes, followed from a window that stays usable. It does not use Blender."""

import contextlib
import queue
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from ..core.errors import INTERRUPTED
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


# Commands that run in other processes, one after another; each as a BackgroundRun. It does not use Blender.


@dataclass(frozen=True)
class SeriesTask:
    """One command of a series. name: what it makes. told: an error of it in the words of whoever reads it."""

    name: str
    start: Callable[[], BackgroundRun]
    told: Callable[[str], str] = str


@dataclass(frozen=True)
class SeriesEnd:
    """What became of a task. text: its result, or its error as it was sent."""

    task: SeriesTask
    phase: Phase
    text: str

    @property
    def line(self) -> str:
        """What became of it in a line."""
        return f"{self.task.name}: {self.task.told(self.text) if self.phase == 'failed' else self.text}"


class BackgroundSeries:
    """Tasks that run one after another, with the state of a BackgroundRun; one that fails does not keep the others."""

    def __init__(self, tasks: Sequence[SeriesTask]) -> None:
        """Start the first task. Raises OSError where it cannot be started."""
        self.ended: list[SeriesEnd] = []
        self._tasks = tuple(tasks)
        self._stopping = False
        self._current = self._tasks[0].start()

    @property
    def active(self) -> bool:
        """Tell whether a task was running at the last poll."""
        return len(self.ended) < len(self._tasks) and not self._is_stopped

    @property
    def _is_stopped(self) -> bool:
        return self._stopping and not self._current.active

    @property
    def phase(self) -> Phase:
        """The state of the task that runs; at the end that of the whole: failed where any has failed."""
        if self.active:
            return "stopping" if self._stopping else self._current.phase
        if len(self.ended) < len(self._tasks) or any(end.phase == "stopped" for end in self.ended):
            return "stopped"
        return "failed" if any(end.phase == "failed" for end in self.ended) else "finished"

    @property
    def where(self) -> str:
        """Which task runs, to stand before what it has to say."""
        if not self.active:
            return ""
        place = len(self.ended)
        return f"{place + 1} of {len(self._tasks)}, {self._tasks[place].name}: "

    @property
    def label(self) -> str:
        """What the task that runs says it is at, "" for nothing."""
        return self._current.label

    @property
    def done(self) -> int:
        """Frames of the task that runs which are done."""
        return self._current.done

    @property
    def total(self) -> int:
        """All frames of the task that runs."""
        return self._current.total

    @property
    def fraction(self) -> float:
        """The share of the whole that is done, 0 to 1; every task counts alike."""
        running = self._current.fraction if self.active else 0.0
        return (len(self.ended) + running) / len(self._tasks)

    @property
    def frames_per_s(self) -> float | None:
        """Frames per second of the task that runs; None before its first."""
        return self._current.frames_per_s

    @property
    def notes(self) -> list[str]:
        """What the task that runs, or ran last, has to say."""
        return list(self._current.notes)

    @property
    def result(self) -> str:
        """What was made, in a line for each task that has finished."""
        return "; ".join(end.line for end in self.ended if end.phase == "finished")

    @property
    def error(self) -> str:
        """What failed, in a line for each task."""
        return "\n".join(end.line for end in self.ended if end.phase == "failed")

    def poll(self) -> bool:
        """Process the messages that have arrived and start the next task; return whether anything changed."""
        if not self.active:
            return False
        changed = self._current.poll()
        if self._current.active:
            return changed
        state = self._current
        self._end(state.phase, state.error if state.phase == "failed" else state.result)
        if state.phase == "stopped":  # by us, or by someone who ended the process: the rest is not wanted either
            self._stopping = True
        while self.active and not self._current.active:
            try:
                self._current = self._tasks[len(self.ended)].start()
            except OSError as error:
                self._end("failed", f"cannot be started: {error}")
        return True

    def _end(self, phase: Phase, text: str) -> None:
        self.ended.append(SeriesEnd(self._tasks[len(self.ended)], phase, text))

    def cancel(self) -> None:
        """Ask the task that runs to end after its frame, and start no other; called again, end it at once."""
        if self.active:
            self._stopping = True
            self._current.cancel()

    def close(self, timeout_s: float = 2.0) -> None:
        """End the task that runs, by force if necessary, and start no other."""
        if self.active:
            self._stopping = True
            self._current.close(timeout_s)
            self.poll()

    def wait(self) -> None:
        """Process messages until the last task ends."""
        while self.active:
            if not self.poll():
                time.sleep(0.02)
