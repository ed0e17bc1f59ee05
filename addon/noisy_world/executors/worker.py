# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker: a process that does the tasks which another one names on standard input; `worker_process` is that side."""

import contextlib
import os
import queue
import threading
from collections.abc import Callable
from typing import Any

from ..core.errors import BusyError, CannotJoinError, InterruptedRunError, NoisyWorldError, memory_errors
from ..core.exit_statuses import BUSY, DONE, INTERRUPTED, REFUSED, USERS_ERROR
from ..core.progress import JsonProgress
from .jobs import Prepare

QUESTION = "?"  # a line in place of the order, which follows it


def work(prepare: Prepare, stop: threading.Event, answer: Callable[[], Any] | None = None) -> int:
    """Do the tasks that the process names which started this one; return the exit status.

    stop: when set, this process ends where its task can be taken up again. answer: to a question before the order, as
    plain data: what takes something to find out that a worker loads anyway.
    """
    parent = Parent(stop)
    order = parent.next()
    with contextlib.ExitStack() as closing:
        try:
            if order == QUESTION and answer is not None:
                with memory_errors():
                    parent.tell({"answer": answer()})
                order = parent.next()
            if order is None:
                return INTERRUPTED if stop.is_set() else DONE
            with memory_errors():
                perform = closing.enter_context(prepare(order, parent))
        except NoisyWorldError as error:  # the parent could prepare it, so it is this machine that lacks something
            parent.tell({"error": error.message})
            return REFUSED
        try:
            while (name := parent.next()) is not None:
                with memory_errors():
                    report = perform(name)
                parent.made(name, report)
        except InterruptedRunError:
            return INTERRUPTED
        except NoisyWorldError as error:
            parent.tell({"error": error.message})
            return (
                REFUSED if isinstance(error, CannotJoinError) else BUSY if isinstance(error, BusyError) else USERS_ERROR
            )
    return INTERRUPTED if stop.is_set() else DONE


class Parent(JsonProgress):
    """The process that started this one: it names tasks, and hears of them. If it is gone, this process ends."""

    def __init__(self, stop: threading.Event) -> None:
        """Listen. stop: when set, there is nothing more to do."""
        # A copy of the stream, as descriptor 1 is redirected while Blender renders, to hide its output.
        super().__init__(os.fdopen(os.dup(1), "w", buffering=1), lost=lambda: os._exit(INTERRUPTED))
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._stop = stop
        self._working = False
        threading.Thread(target=self._listen, daemon=True).start()

    def next(self) -> str | None:
        """Return the next line; None where the parent has said that there is none, and where this process stops."""
        while not self._stop.is_set():
            with contextlib.suppress(queue.Empty):
                return self._lines.get(timeout=0.2)
        return None

    def made(self, name: str, report: dict[str, Any] | None) -> None:
        """Say that a task is done; from now on the parent may end this process by saying nothing more."""
        self._working = False
        self.tell({"made": name, "report": report})

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Send nothing: the parent shows one bar for all workers."""

    def finish(self) -> None:
        """Send nothing."""

    def _listen(self) -> None:
        # Without Python's own stream: its lock, held by a thread that waits, would end the process with a message.
        rest = b""
        while data := os.read(0, 1 << 16):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._working = True
                self._lines.put(line.decode())
        if self._working:
            os._exit(INTERRUPTED)  # the parent is gone; what is finished stays, and another run takes it up
        self._lines.put(None)
