# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes of this machine as an executor."""

import contextlib
import os
import queue
import threading
from collections.abc import Callable, Sequence

from ..core.exit_statuses import DONE, INTERRUPTED, how_it_ended
from ..core.machine import available_threads, thread_variables
from .jobs import Job, TaskMessage, TaskOutcome, TaskQueue
from .worker_process import Heard, WorkerProcess


class WorkerProcesses:
    """Processes of this machine, each of which does one task after another."""

    goes_on = False

    def __init__(self, command: Sequence[str], jobs: int) -> None:
        """Prepare. command: starts a worker. jobs: how many work at once."""
        self._command = command
        self._jobs = jobs

    @property
    def slots(self) -> int:
        """How many there are."""
        return self._jobs

    def run(
        self, job: Job, hear: Callable[[TaskMessage], None], ended: Callable[[TaskOutcome], None], stop: threading.Event
    ) -> None:
        """Let the processes do the tasks. One that dies ends the job, and its task is named."""
        pool = _Pool(TaskQueue(job.tasks), hear, ended)
        try:
            pool.start(self._command, job.order, min(self._jobs, len(job.tasks)))
            pool.attend(stop)
        finally:
            pool.end()


class _Pool:
    """The workers of one job."""

    def __init__(
        self, waiting: TaskQueue, hear: Callable[[TaskMessage], None], ended: Callable[[TaskOutcome], None]
    ) -> None:
        self._waiting = waiting
        self._hear = hear
        self._ended = ended
        self._heard = Heard()
        self._workers: list[WorkerProcess] = []
        self._tasks: dict[int, str] = {}  # what each worker is at
        self._errors: dict[int, str] = {}
        self._failed = False

    def start(self, command: Sequence[str], order: str, count: int) -> None:
        """Start workers, each at its first task."""
        environment = {**os.environ, **thread_variables(max(1, available_threads() // count))}
        for number in range(count):
            worker = WorkerProcess(command, order, self._heard, number=number, environment=environment)
            self._workers.append(worker)
            self._give(number)

    def attend(self, stop: threading.Event) -> None:
        """Hear the workers, and give each its next task, until all have ended."""
        working, stopped = len(self._workers), False
        while working:
            if (self._failed or stop.is_set()) and not stopped:
                stopped = True
                for worker in self._workers:
                    worker.stop()
            with contextlib.suppress(queue.Empty):
                number, message = self._heard.get(timeout=0.2)
                match message:
                    case {"made": name, "report": report}:
                        self._give(number)
                        self._ended(TaskOutcome(name, report=report))
                    case {"error": text}:
                        self._errors[number] = text
                    case {"end": status}:
                        working -= 1
                        if status == INTERRUPTED:
                            stop.set()
                        elif number in self._errors or not stopped:
                            self._take_end(number, status)
                    case _:
                        self._hear(message)

    def end(self) -> None:
        """End the workers: none is left, unless an error of this process ends it."""
        for worker in self._workers:
            worker.end()

    def _give(self, number: int) -> None:
        """Give a worker its next task, or let it end."""
        task = self._waiting.next_for(number)
        if task is None:
            self._tasks.pop(number, None)
            self._workers[number].finish()
        else:
            self._tasks[number] = task.name
            self._workers[number].tell(task.name)

    def _take_end(self, number: int, status: int) -> None:
        """Take the end of a worker that nobody has stopped."""
        name, line = self._tasks.get(number), self._errors.get(number)
        if name is not None:
            self._failed = True
            died = f"{name}: its worker {how_it_ended(status)}; its messages are above, and the same command goes on"
            self._ended(TaskOutcome(name, status, line or died))
        elif status != DONE:
            self._hear({"note": f"a worker that had done all its tasks {how_it_ended(status)}"})
