# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes for one dataset: the same command started again for each share of the frames.

A worker gets its frames on standard input and tells on standard output, in lines of JSON behind a mark, what it does;
whatever else comes there (Blender talks) is passed over.
"""

import contextlib
import json
import os
import queue
import subprocess
import threading
from dataclasses import asdict
from typing import Any

from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.machine import peak_memory_bytes
from ..core.progress import JsonProgress, Progress, read_message
from ..pipeline import Report, Run, Work
from .entry import INTERRUPTED


def run_workers(commands: list[list[str]], pieces: list[Work], progress: Progress, stop: threading.Event) -> Report:
    """Run each piece of work with its command in a process of its own, and gather what they tell.

    Raises NoisyWorldError with the first worker's error, InterruptedRunError where `stop` was set.
    """
    messages: queue.Queue[dict[str, Any]] = queue.Queue()
    workers = [start_worker(words, piece, messages) for words, piece in zip(commands, pieces, strict=True)]
    total = Report()
    errors: list[str] = []
    open_workers = len(workers)
    told_to_stop = False
    while open_workers:
        if (errors or stop.is_set()) and not told_to_stop:
            told_to_stop = True
            for process in workers:
                process.terminate()
        with contextlib.suppress(queue.Empty):
            message = messages.get(timeout=0.2)
            status = message.get("end")
            if status is None:
                hear(message, progress, total, errors)
                continue
            open_workers -= 1
            if status == INTERRUPTED:
                stop.set()
            elif status != 0 and not (told_to_stop or errors):
                errors.append(f"a worker ended with status {status}; its messages are above")
    if errors:
        raise NoisyWorldError(errors[0])
    if stop.is_set():
        raise InterruptedRunError("stopped")
    return total


def hear(message: dict[str, Any], progress: Progress, total: Report, errors: list[str]) -> None:
    """Take in what a worker tells while it lives."""
    match message:
        case {"advance": count}:
            progress.advance(count)
        case {"note": text}:
            progress.note(text)
        case {"report": content}:
            total.merge(Report(**content))
        case {"error": text}:
            errors.append(text)


def start_worker(words: list[str], piece: Work, messages: queue.Queue[dict[str, Any]]) -> subprocess.Popen[str]:
    """Start a worker on a piece of work, and a thread that puts what it tells into the queue."""
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    threading.Thread(target=listen, args=(process, piece, messages), daemon=True).start()
    return process


def listen(process: subprocess.Popen[str], piece: Work, messages: queue.Queue[dict[str, Any]]) -> None:
    """Hand a worker its work and pass on what it tells until it ends."""
    assert process.stdin is not None
    assert process.stdout is not None
    with contextlib.suppress(BrokenPipeError):  # its end, below, tells that it died
        process.stdin.write(json.dumps(piece))
        process.stdin.close()
    for line in process.stdout:
        if (message := read_message(line)) is not None:
            messages.put(message)
    messages.put({"end": process.wait()})


class Parent(JsonProgress):
    """The process that started this one, as a listener to progress; without it this process ends."""

    def __init__(self) -> None:
        # A copy of the stream: Blender's own lines are turned away from the descriptor 1 while it renders.
        super().__init__(os.fdopen(os.dup(1), "w", buffering=1), lost=lambda: os._exit(INTERRUPTED))

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Say nothing: the parent has a bar for all."""

    def finish(self) -> None:
        """Say nothing."""


def work_for(parent: Parent, run: Run, work: Work, number: int) -> int:
    """Render a share of the frames as worker `number`, and tell the parent; return the exit status."""
    try:
        report = run.take_part(work, number)
    except InterruptedRunError:
        return INTERRUPTED
    except NoisyWorldError as error:
        parent.tell({"error": str(error)})
        return 1
    report.peak_memory_bytes = peak_memory_bytes()
    parent.tell({"report": asdict(report)})
    return 0
