# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that run in other processes, one after another; each as a BackgroundRun. It does not use Blender."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .background_run import BackgroundRun, Phase


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
