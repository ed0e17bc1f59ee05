# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of this machine that work at one order, each at one named piece after another.

Each reads lines from standard input: its order first, then the names of pieces, each when the last is done, and END.
On standard output it reports in lines of JSON; {"made": NAME} says that a piece is done.
"""

import contextlib
import os
import queue
import subprocess
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.progress import read_message
from .entry import INTERRUPTED

END = "end"  # what a worker is told when there is no piece left: none is called so

Next: TypeAlias = Callable[[int], str | None]
"""Returns the name of the next piece for the worker of a number; None where there is none."""


class WorkerPool:
    """Workers on this machine."""

    def __init__(
        self,
        command: list[str],
        order: str,
        next_for: Next,
        stop: threading.Event,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Prepare. command: starts a worker. order: what it is told first.

        stop: ends them after their current work. environment: variables that they get, beside this process's.
        """
        self._command = command
        self._order = order
        self._next_for = next_for
        self._stop = stop
        self._environment = None if environment is None else {**os.environ, **environment}
        self._messages: queue.Queue[tuple[int, dict[str, Any]]] = queue.Queue()
        self._processes: list[subprocess.Popen[str]] = []
        self.errors: list[str] = []

    def work(self, jobs: int, made: Callable[[str], None], hear: Callable[[dict[str, Any]], None]) -> None:
        """Let so many workers do all pieces.

        made: is told the name of each that is done. hear: is given other messages. Both are called in this thread. An
        error that is appended to `errors` ends all.

        Raises NoisyWorldError with the first error, InterruptedRunError where `stop` was set.
        """
        try:
            for number in range(jobs):
                self._start(number)
                self._give(number)
            self._attend(made, hear)
        finally:
            for process in self._processes:  # none is left, unless an error of this process ends it
                if process.poll() is None:
                    process.kill()
        if self.errors:
            raise NoisyWorldError(self.errors[0])
        if self._stop.is_set():
            raise InterruptedRunError("stopped")

    def _attend(self, made: Callable[[str], None], hear: Callable[[dict[str, Any]], None]) -> None:
        """Hear the workers, and give each its next piece, until all have ended."""
        working, told_to_stop = len(self._processes), False
        while working:
            if (self.errors or self._stop.is_set()) and not told_to_stop:
                told_to_stop = True
                for process in self._processes:
                    process.terminate()
            with contextlib.suppress(queue.Empty):
                number, message = self._messages.get(timeout=0.2)
                match message:
                    case {"made": name}:
                        self._give(number)
                        made(name)
                    case {"end": status}:
                        working -= 1
                        if status == INTERRUPTED:
                            self._stop.set()
                        elif status != 0 and not (told_to_stop or self.errors):
                            self.errors.append(f"a worker ended with status {status}; its messages are above")
                    case _:
                        hear(message)

    def _start(self, number: int) -> None:
        """Start a worker on the order, and a thread that puts the worker's messages into the queue."""
        process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=self._environment
        )
        self._processes.append(process)
        self._tell(process, self._order)
        threading.Thread(target=self._listen, args=(number, process), daemon=True).start()

    def _give(self, number: int) -> None:
        """Tell a worker its next piece, or that there is none."""
        name = self._next_for(number)
        self._tell(self._processes[number], END if name is None else name)

    @staticmethod
    def _tell(process: subprocess.Popen[str], line: str) -> None:
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the worker died; its exit status is heard
            process.stdin.write(line + "\n")
            process.stdin.flush()

    def _listen(self, number: int, process: subprocess.Popen[str]) -> None:
        """Pass on a worker's messages until it ends."""
        assert process.stdout is not None
        for line in process.stdout:
            if (message := read_message(line)) is not None:
                self._messages.put((number, message))
        self._messages.put((number, {"end": process.wait()}))
