# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes for one dataset: each is given the plan, and then one shard after another.

A worker's order is the preset as it was read, overrides included, rather than the arguments of a command line; then
come the names of shards (see `crew`). It reports progress in lines of JSON, each after a mark; other output, such as
Blender's, is skipped.
"""

import contextlib
import json
import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ..core.datasets.dataset import Dataset
from ..core.errors import BusyError, CannotJoinError, InterruptedRunError, NoisyWorldError
from ..core.machine import available_threads, peak_memory_bytes
from ..core.planning.plan import Plan
from ..core.planning.shards import Shard, seconds_of
from ..core.presets.preset import check_document
from ..core.progress import JsonProgress, Progress
from ..pipeline.address_run import AddressRun
from ..pipeline.report import Report
from ..pipeline.run import Made, threads_of_each
from ..pipeline.shard import ShardMaker, shard_folder
from ..planning import make_plan
from ..storage.address import is_address, open_address
from .entry import BUSY, INTERRUPTED, REFUSED
from .worker_pool import END, WorkerPool


@dataclass(frozen=True)
class WorkerOrder:
    """What a worker has to do, but for the shards, which it is told one after another.

    preset, document: the preset's file and its content, overrides included. chosen: start and stop of the frames of
    each sequence, if not all are made. out: the dataset's folder, which a run has opened, or its address. threads: of
    the renderer; 0 for all. scratch: where shards are made that go to an address; None for the system's own folder.
    """

    preset: str
    document: dict[str, Any]
    chosen: tuple[int | None, int | None] | None
    out: str
    threads: int
    scratch: str | None = None

    @classmethod
    def of(cls, plan: Plan, out: Path | str, threads: int, scratch: Path | None = None) -> "WorkerOrder":
        """Return the order for the workers of a plan. out: the dataset's folder or address."""
        chosen = None if plan.chosen is None else (plan.chosen.start, plan.chosen.stop)
        place = out if isinstance(out, str) else str(out.resolve())
        own = None if scratch is None else str(scratch.resolve())
        return cls(str(plan.preset.path), plan.preset.document, chosen, place, threads, own)

    def plan(self) -> Plan:
        """Return the plan. Raises InputError where files are missing or wrong."""
        chosen = None if self.chosen is None else slice(*self.chosen)
        return make_plan(check_document(self.document, Path(self.preset)), chosen)


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


class Workers:
    """Processes that make the shards of a plan, each one after another from one queue."""

    def __init__(self, command: list[str], plan: Plan, out: Path, *, jobs: int, stop: threading.Event) -> None:
        """Prepare. command: starts a worker. stop: when set, the workers end after their current frames."""
        self._command = command
        self._plan = plan
        self._out = out
        self._jobs = jobs
        self._stop = stop

    def make(self, shards: tuple[Shard, ...], made: Made, progress: Progress) -> Report:
        """Let the workers make shards, and merge their reports. made: is called with each shard that is finished.

        Raises NoisyWorldError with the first worker's error, InterruptedRunError where `stop` was set.
        """
        waiting = ShardQueue(self._plan, shards)
        jobs = min(self._jobs, len(shards))
        order = WorkerOrder.of(self._plan, self._out, threads_of_each(jobs))
        total, subjects = Report(), set[str]()

        def next_for(worker: int) -> str | None:
            shard = waiting.next_for(worker)
            return None if shard is None else shard.name

        crew = WorkerPool(self._command, json.dumps(asdict(order)), next_for, self._stop)

        def heard(message: dict[str, Any]) -> None:
            hear(message, progress, total, crew.errors, subjects)

        crew.work(jobs, lambda name: made(Shard.parse(name)), heard)
        return total


class ShardQueue:
    """The shards that no worker has yet. Neighbours go to one worker, so that a scene is loaded seldom."""

    def __init__(self, plan: Plan, shards: tuple[Shard, ...]) -> None:
        """Take the shards in the plan's order."""
        self._waiting: dict[str, deque[tuple[Shard, float]]] = {}
        for shard, seconds in zip(shards, seconds_of(plan, shards), strict=True):
            self._waiting.setdefault(shard.render, deque()).append((shard, seconds))
        self._scenes = {render.name: render.scene.name for render in plan.renders}
        self._held: dict[int, str] = {}  # the render that each worker is at

    def next_for(self, worker: int) -> Shard | None:
        """Return the next shard for a worker; None where there is none.

        The next of its render or, where that has none, the first of the render that has most left to do: one that
        nobody is at, of the worker's scene if possible; else the last of one that another worker is at.
        """
        at = self._held.get(worker)
        left = {name: sum(seconds for _, seconds in shards) for name, shards in self._waiting.items() if shards}
        if not left:
            return None
        if at in left:
            return self._waiting[at].popleft()[0]
        others = {held for number, held in self._held.items() if number != worker}
        scene = None if at is None else self._scenes[at]
        name = max(left, key=lambda item: (item not in others, self._scenes[item] == scene, left[item]))
        if name in others:
            self._held.pop(worker, None)  # it stays the other's
            return self._waiting[name].pop()[0]
        self._held[worker] = name
        return self._waiting[name].popleft()[0]


def hear(message: dict[str, Any], progress: Progress, total: Report, errors: list[str], subjects: set[str]) -> None:
    """Process a worker's message. subjects: those that a note has been on; another note on one is not shown.

    A note without a subject is its own: several workers say the same of a scene that each of them loads.
    """
    match message:
        case {"advance": count}:
            progress.advance(count)
        case {"note": text}:
            subject = message.get("subject", text)
            if subject not in subjects:
                subjects.add(subject)
                progress.note(text)
        case {"report": content}:
            total.merge(Report(**content))
        case {"error": text}:
            errors.append(text)


class Parent(JsonProgress):
    """A listener that reports to the process that started this one; if that is gone, this process ends."""

    def __init__(self) -> None:
        # A copy of the stream, as descriptor 1 is redirected while Blender renders, to hide its output.
        super().__init__(os.fdopen(os.dup(1), "w", buffering=1), lost=lambda: os._exit(INTERRUPTED))

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Send nothing: the parent shows one bar for all workers."""

    def finish(self) -> None:
        """Send nothing."""


class CommandReader:
    """The lines that the parent tells a worker on standard input. Where the parent is gone, this process ends."""

    def __init__(self, stop: threading.Event) -> None:
        """Listen. stop: when set, there is nothing more to do."""
        self._lines: queue.Queue[str] = queue.Queue()
        self._stop = stop
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        # Without Python's own stream: its lock, held by a thread that waits, would end the process with a message.
        rest = b""
        while data := os.read(0, 1 << 16):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._lines.put(line.decode())
                if line.decode() == END:
                    return
        os._exit(INTERRUPTED)  # what is finished stays, and another run takes it up

    def next(self) -> str | None:
        """Return the next line; None where the parent has said that there is none, and where this process stops."""
        while not self._stop.is_set():
            with contextlib.suppress(queue.Empty):
                line = self._lines.get(timeout=0.2)
                return None if line == END else line
        return None


@contextlib.contextmanager
def _maker(
    order: WorkerOrder, plan: Plan, progress: Progress, stop: threading.Event
) -> Iterator[Callable[[Shard], Report]]:
    """Return what makes a shard where an order says."""
    if is_address(order.out):
        scratch = None if order.scratch is None else Path(order.scratch)
        run = AddressRun(plan, open_address(order.out), progress=progress, stop=stop, scratch=scratch)
        yield partial(run.make_shard, threads=order.threads)
        return
    there = Dataset(Path(order.out), plan.format)
    with ShardMaker(plan, progress=progress, stop=stop, threads=order.threads) as maker:
        yield lambda shard: maker.make(shard_folder(there.out, shard), shard, there, joining=True)


def carry_out(told: CommandReader, parent: Parent, stop: threading.Event) -> int:
    """Make the shards that the parent names, and report to it; return the exit status."""
    line = told.next()
    if line is None:
        return INTERRUPTED
    order = WorkerOrder(**json.loads(line))
    total = Report()
    try:
        plan = order.plan()
    except NoisyWorldError as error:  # the parent could make it, so it is this machine that lacks something
        parent.tell({"error": str(error)})
        return REFUSED
    try:
        with _maker(order, plan, parent, stop) as make:
            while (name := told.next()) is not None:
                total.add(make(Shard.parse(name)).content())
                parent.tell({"made": name})
    except InterruptedRunError:
        return INTERRUPTED
    except NoisyWorldError as error:
        parent.tell({"error": str(error)})
        return REFUSED if isinstance(error, CannotJoinError) else BUSY if isinstance(error, BusyError) else 1
    if stop.is_set():
        return INTERRUPTED
    total.peak_memory_bytes = peak_memory_bytes()
    parent.tell({"report": asdict(total)})
    return 0
