# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes for one dataset: each is given the plan and a share of its frames.

A worker reads its order from standard input, as JSON: the preset as it was read, overrides included, rather than the
arguments of a command line. On standard output it reports progress in lines of JSON, each after a mark; other output
there, such as Blender's, is skipped.
"""

import contextlib
import json
import os
import queue
import subprocess
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.machine import available_threads, peak_memory_bytes
from ..core.planning.plan import Plan
from ..core.presets.preset import check_document
from ..core.progress import JsonProgress, Progress, read_message
from ..pipeline.report import Report
from ..pipeline.run import Run, Work
from ..planning import make_plan
from .entry import INTERRUPTED


@dataclass(frozen=True)
class Order:
    """What a worker has to do.

    number: the worker's. preset, document: the preset's file and its content, overrides included. chosen: start and
    stop of the frames of each sequence, if not all are made. out: the dataset's folder, which a run has opened.
    jobs: how many workers share the machine. work: this worker's source frames.
    """

    number: int
    preset: str
    document: dict[str, Any]
    chosen: tuple[int | None, int | None] | None
    out: str
    jobs: int
    work: Work

    def run(self, progress: Progress, stop: threading.Event) -> Run:
        """Return the run that the worker takes part in. Raises InputError where files are missing or wrong."""
        chosen = None if self.chosen is None else slice(*self.chosen)
        plan = make_plan(check_document(self.document, Path(self.preset)), chosen)
        return Run(plan, Path(self.out), progress=progress, stop=stop, jobs=self.jobs)


def useful_jobs(asked: int, frames: int) -> tuple[int, str]:
    """Return how many of the processes asked for are of use, and a sentence where that is fewer, else "".

    More than the processors that this process may use only take memory, and each needs a frame to render.
    """
    threads = available_threads()
    jobs = max(1, min(asked, threads, frames))
    if jobs == asked:
        return jobs, ""
    count, what = (threads, "processor") if threads <= frames else (frames, "frame")
    plural = "" if count == 1 else "s"
    return jobs, f"--jobs {asked} is more than is of use with {count} {what}{plural}, so it is taken as {jobs}"


def orders_for(plan: Plan, out: Path, pieces: list[Work]) -> list[Order]:
    """Return an order for each piece of a plan's work."""
    chosen = None if plan.chosen is None else (plan.chosen.start, plan.chosen.stop)
    preset = plan.preset
    return [
        Order(number, str(preset.path), preset.document, chosen, str(out.resolve()), len(pieces), piece)
        for number, piece in enumerate(pieces)
    ]


def run_workers(command: list[str], orders: list[Order], progress: Progress, stop: threading.Event) -> Report:
    """Start the command in a process for each order, and merge their reports.

    Raises NoisyWorldError with the first worker's error, InterruptedRunError where `stop` was set.
    """
    messages: queue.Queue[dict[str, Any]] = queue.Queue()
    workers = [start_worker(command, order, messages) for order in orders]
    total = Report()
    errors: list[str] = []
    subjects: set[str] = set()
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
                hear(message, progress, total, errors, subjects)
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


def hear(message: dict[str, Any], progress: Progress, total: Report, errors: list[str], subjects: set[str]) -> None:
    """Process a worker's message. subjects: those that a note has been on; another note on one is not shown."""
    match message:
        case {"advance": count}:
            progress.advance(count)
        case {"note": text, "subject": subject}:
            if subject not in subjects:
                subjects.add(subject)
                progress.note(text)
        case {"note": text}:
            progress.note(text)
        case {"report": content}:
            total.merge(Report(**content))
        case {"error": text}:
            errors.append(text)


def start_worker(command: list[str], order: Order, messages: queue.Queue[dict[str, Any]]) -> subprocess.Popen[str]:
    """Start a worker on an order, and a thread that puts the worker's messages into the queue."""
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    threading.Thread(target=listen, args=(process, order, messages), daemon=True).start()
    return process


def listen(process: subprocess.Popen[str], order: Order, messages: queue.Queue[dict[str, Any]]) -> None:
    """Give a worker its order, and pass on its messages until it ends."""
    assert process.stdin is not None
    assert process.stdout is not None
    with contextlib.suppress(BrokenPipeError):  # the worker died; its exit status, below, is reported
        process.stdin.write(json.dumps(asdict(order)))
        process.stdin.close()
    for line in process.stdout:
        if (message := read_message(line)) is not None:
            messages.put(message)
    messages.put({"end": process.wait()})


class Parent(JsonProgress):
    """A listener that reports to the process that started this one; if that is gone, this process ends."""

    def __init__(self) -> None:
        # A copy of the stream, as descriptor 1 is redirected while Blender renders, to hide its output.
        super().__init__(os.fdopen(os.dup(1), "w", buffering=1), lost=lambda: os._exit(INTERRUPTED))

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Send nothing: the parent shows one bar for all workers."""

    def finish(self) -> None:
        """Send nothing."""


def carry_out(order: Order, parent: Parent, stop: threading.Event) -> int:
    """Render a worker's share of the frames and report to the parent; return the exit status."""
    try:
        report = order.run(parent, stop).take_part(order.work, order.number)
    except InterruptedRunError:
        return INTERRUPTED
    except NoisyWorldError as error:
        parent.tell({"error": str(error)})
        return 1
    report.peak_memory_bytes = peak_memory_bytes()
    parent.tell({"report": asdict(report)})
    return 0
