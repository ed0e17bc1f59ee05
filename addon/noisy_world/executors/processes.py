# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes of this machine as an executor.

On Linux they are split from this one, which has loaded what they need: modules, paths, meshes. Where it cannot be split
(elsewhere, or once Blender or a thread is there) they are started by a command, and load for themselves.
"""

import atexit
import contextlib
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from typing import IO, Any, Self

from ..core.errors import DONE, INTERRUPTED, NoisyWorldError, how_it_ended
from ..core.machine import available_threads, end_opencv_threads_before_forks, limit_threads, thread_variables
from .jobs import QUESTION, Job, TaskMessage, TaskOutcome, TaskQueue
from .worker_process import Heard, Started, WorkerProcess, started


class WorkerProcesses:
    """Processes of this machine, each of which does one task after another."""

    goes_on = False

    def __init__(self, command: Sequence[str], jobs: int, work: Callable[[], int] | None = None) -> None:
        """Prepare. command: starts a worker. jobs: how many work at once. work: what a worker does that is split off.

        As a context manager it keeps them: they are split off when it is entered, and end with it.
        """
        self._command = command
        self._jobs = jobs
        self._work = work
        self._kept: list[Started] = []
        self._heard = Heard()
        self._asked: WorkerProcess | None = None

    @property
    def slots(self) -> int:
        """How many there are."""
        return self._jobs

    @property
    def kept(self) -> bool:
        """Whether there are workers before there is a job."""
        return bool(self._kept)

    def __enter__(self) -> Self:
        """Split the workers off, where that can be."""
        if self._work is not None and self._jobs > 1 and _can_split():
            end_opencv_threads_before_forks()
            threads = max(1, available_threads() // self._jobs)
            for _ in range(self._jobs):
                self._kept.append(SplitProcess(self._work, self._kept, threads))
        return self

    def __exit__(self, *_: object) -> None:
        """Let go of workers that had nothing to do."""
        for process in self._kept:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            process.wait()
        self._kept = []

    def ask(self) -> Any:
        """Return what a worker that is kept answers before it has an order; see `worker.work`.

        Raises NoisyWorldError where it cannot.
        """
        self._asked = worker = WorkerProcess(self._kept[0], self._heard)
        worker.tell(QUESTION)
        while True:
            match self._heard.get()[1]:
                case {"answer": answer}:
                    return answer
                case {"error": text}:
                    raise NoisyWorldError(text)
                case {"end": status}:
                    raise NoisyWorldError(f"a worker {how_it_ended(status)}; its messages are above")

    def run(
        self, job: Job, hear: Callable[[TaskMessage], None], ended: Callable[[TaskOutcome], None], stop: threading.Event
    ) -> None:
        """Let the processes do the tasks. One that dies ends the job, and its task is named."""
        pool = _Pool(TaskQueue(job.tasks), hear, ended, self._heard)
        try:
            pool.start(self._workers(min(self._jobs, len(job.tasks))), job.order)
            pool.attend(stop)
        finally:
            pool.end()

    def _workers(self, count: int) -> list[WorkerProcess]:
        """Return so many workers without an order."""
        if not self._kept:
            environment = {**os.environ, **thread_variables(max(1, available_threads() // count))}
            processes: Sequence[Started] = [started(self._command, environment) for _ in range(count)]
        else:
            processes, self._kept = self._kept[:count], self._kept[count:]
        asked, self._asked = [] if self._asked is None else [self._asked], None
        return asked + [
            WorkerProcess(process, self._heard, number=number)
            for number, process in enumerate(processes)
            if number >= len(asked)
        ]


def _can_split() -> bool:
    """Tell whether this process may be split: Blender's threads would be missing in the other one, as ours would."""
    return sys.platform == "linux" and "bpy" not in sys.modules and threading.active_count() == 1


class SplitProcess:
    """A process split from this one; it does `work`, and ends with its exit status."""

    def __init__(self, work: Callable[[], int], others: Sequence[Started], threads: int) -> None:
        """Split it off. others: those before it, whose pipes it lets go of. threads: that it may run at once."""
        here_in, there_out = os.pipe()
        there_in, here_out = os.pipe()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads: numpy's and OpenCV's end before a fork
            self.pid = os.fork()
        if self.pid == 0:
            os.close(here_in)
            os.close(here_out)
            _be_split(work, others, there_in, there_out, threads)
        os.close(there_in)
        os.close(there_out)
        self.stdin: IO[str] | None = os.fdopen(here_out, "w")
        self.stdout: IO[str] | None = os.fdopen(here_in, errors="replace")
        self.stderr: IO[str] | None = None
        self._status: int | None = None
        self._lock = threading.Lock()

    def poll(self) -> int | None:
        """Return its exit status, negative where a signal ended it; None while it runs."""
        return self._waited(os.WNOHANG)

    def wait(self, timeout: float | None = None) -> int:
        """Return its exit status when it has ended. Raises subprocess.TimeoutExpired."""
        end_s = None if timeout is None else time.monotonic() + timeout
        while (status := self._waited(os.WNOHANG if end_s is not None else 0)) is None:
            if end_s is not None and time.monotonic() > end_s:
                raise subprocess.TimeoutExpired("worker", timeout or 0.0)
            time.sleep(0.05)
        return status

    def _waited(self, how: int) -> int | None:
        with self._lock:
            if self._status is None:
                pid, status = os.waitpid(self.pid, how)
                if pid:
                    self._status = os.waitstatus_to_exitcode(status)
            return self._status

    def terminate(self) -> None:
        """Ask it to end."""
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self._signal(signal.SIGKILL)

    def _signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)


def _be_split(work: Callable[[], int], others: Sequence[Started], there_in: int, there_out: int, threads: int) -> None:
    """Be the process that was split off, and end. What this one would do when it ends is the other's to do."""
    status = 1
    try:
        atexit._clear()
        for other in others:
            for stream in (other.stdin, other.stdout):
                if stream is not None:
                    os.close(stream.fileno())
        os.dup2(there_in, 0)
        os.dup2(there_out, 1)
        os.close(there_in)
        os.close(there_out)
        os.environ.update(thread_variables(threads))
        limit_threads(threads)
        status = work()
    except BaseException:  # noqa: BLE001 - a bug; this process ends here
        traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):
            sys.stderr.flush()
            if (bpy := sys.modules.get("bpy")) is not None:
                shutil.rmtree(bpy.app.tempdir, ignore_errors=True)  # which Blender removes when an interpreter ends
        os._exit(status)


class _Pool:
    """The workers of one job."""

    def __init__(
        self,
        waiting: TaskQueue,
        hear: Callable[[TaskMessage], None],
        ended: Callable[[TaskOutcome], None],
        heard: Heard,
    ) -> None:
        self._waiting = waiting
        self._hear = hear
        self._ended = ended
        self._heard = heard
        self._workers: list[WorkerProcess] = []
        self._tasks: dict[int, str] = {}  # what each worker is at
        self._errors: dict[int, str] = {}
        self._failed = False

    def start(self, workers: list[WorkerProcess], order: str) -> None:
        """Give workers their order, and each its first task."""
        self._workers = workers
        for number, worker in enumerate(workers):
            worker.tell(order)
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
