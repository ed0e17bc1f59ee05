# SPDX-License-Identifier: GPL-3.0-or-later
"""The progress of a command that runs for long, and what stops it."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import IO, TextIO

from ..core.progress import JsonProgress, PlainProgress, Progress, TerminalProgress


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
