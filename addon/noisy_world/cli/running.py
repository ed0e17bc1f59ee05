# SPDX-License-Identifier: GPL-3.0-or-later
"""What long commands share: progress, stopping by a signal, and the executor of their tasks."""

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, TextIO

from ..core.progress import JsonProgress, PlainProgress, Progress, TerminalProgress

if TYPE_CHECKING:
    from ..executors.jobs import Executor
    from .entry import Entry


def listener(form: str) -> tuple[Progress, threading.Event]:
    """Return the listener for a run's progress, and the event that stops the run.

    form: "text" for people, "json" for programs.
    """
    if form == "json":
        stop = stop_on_signal(None)
        return machine_listener(stop.set), stop
    # A copy of the stream, as the original descriptors are redirected while Blender renders, to hide its output.
    stream = os.fdopen(os.dup(sys.stderr.fileno()), "w", buffering=1)
    return text_listener(stream), stop_on_signal(stream)


def text_listener(stream: TextIO) -> Progress:
    """Return the listener for people who read a stream: a bar for a terminal, lines for a log file."""
    # A terminal that does not know its size shows no bar.
    watched = stream.isatty() and os.get_terminal_size(stream.fileno()).lines > 1
    return TerminalProgress(stream) if watched else PlainProgress(stream)


def machine_listener(lost: Callable[[], object] = lambda: None) -> JsonProgress:
    """Return a listener for the program that started this one; `lost` is called when that program is gone."""
    sys.stdout.flush()
    return JsonProgress(os.fdopen(os.dup(1), "w", buffering=1), lost=lost)


def stop_on_signal(stream: IO[str] | None) -> threading.Event:
    """Let Ctrl-C and a batch system's SIGTERM end the run after the current frame; a second Ctrl-C ends it at once."""
    stop = threading.Event()

    def handle(number: int, _: FrameType | None) -> None:
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()
        if stream is not None:
            print("\nstopping after the current frames", file=stream, flush=True)

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop


def executor_of(
    options: argparse.Namespace, entry: "Entry", jobs: int, work: Callable[[], int] | None = None
) -> "AbstractContextManager[Executor]":
    """Return what carries out tasks: the cluster that the options name, or else processes of this machine.

    work: what those do that are split from this one; see `WorkerProcesses`.
    """
    if options.ray is not None:
        from ..executors.ray_cluster import ray_cluster

        return ray_cluster(options.ray, options.cpus)
    from ..executors.processes import WorkerProcesses

    return WorkerProcesses(entry.command(["--worker"]), jobs, work)


def work_on(prepare: Callable[..., AbstractContextManager[Any]], answer: Callable[[], Any] | None = None) -> int:
    """Be a worker: do tasks for the process that started this one; return the exit status.

    prepare: as `executors.jobs.Prepare`, and takes the event that stops it as `stop`. answer: as of `worker.work`.
    """
    from ..executors.worker import work

    stop = stop_on_signal(None)
    return work(partial(prepare, stop=stop), stop, answer)
