# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs, which are named tasks as plain data, and the interface of executors that carry them out.

A task leaves its result on the disk or at an address; an executor hears how it goes on and how it ended, no more.
"""

import contextlib
import os
import queue
import threading
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from ..core.errors import (
    BUSY,
    DONE,
    INTERRUPTED,
    REFUSED,
    USERS_ERROR,
    Action,
    BusyError,
    CannotJoinError,
    InterruptedRunError,
    Message,
    NoisyWorldError,
    memory_errors,
)
from ..core.progress import JsonProgress, Progress

TaskMessage: TypeAlias = dict[str, Any]
"""What is told of a task while it is done, such as {"advance": 3} or {"note": "a sentence"}."""

Perform: TypeAlias = Callable[[str], dict[str, Any] | None]
"""Does the task of a name, and returns a report on it, if there is something to report."""

Prepare: TypeAlias = Callable[[str, Progress], AbstractContextManager[Perform]]
"""Makes ready for the tasks of an order; what they say, the progress hears."""


@dataclass(frozen=True)
class Task:
    """A task. group, larger_group: what it has to load, such as a render and its scene. seconds: it takes, roughly."""

    name: str
    group: str
    larger_group: str = ""
    seconds: float = 1.0


@dataclass(frozen=True)
class Job:
    """What is to be done.

    what, verb: of several tasks, in words: "shards" that are "made". subcommand: of `noisy-world`, whose workers do
    them. order: what all the tasks are of, in a line. opened: a file that whoever takes part has to see as it is here.
    """

    what: str
    verb: str
    subcommand: str
    order: str
    tasks: tuple[Task, ...]
    opened: Path | None = None


@dataclass(frozen=True)
class TaskOutcome:
    """How a task ended.

    status: of its process; None where its machine was lost each time that it was tried. line: why it was not done.
    machine: its name; "" for this one, and where that is unknown. report: on what was done.
    """

    name: str
    status: int | None = DONE
    line: str = ""
    machine: str = ""
    report: dict[str, Any] | None = None

    @property
    def done(self) -> bool:
        """Whether the task was done."""
        return self.status == DONE

    @property
    def failure(self) -> str:
        """Why it was not done, and where."""
        return f"{self.machine}: {self.line}" if self.machine else self.line


class Executor(Protocol):
    """What carries out tasks."""

    goes_on: bool
    """Whether the other tasks are done where one could not be: on many machines, each may fail in its own way."""

    @property
    def slots(self) -> int:
        """How many tasks it does at once."""
        ...

    def run(
        self,
        job: Job,
        hear: Callable[[TaskMessage], None],
        ended: Callable[[TaskOutcome], None],
        stop: threading.Event,
    ) -> None:
        """Carry out a job until its tasks have ended, or one has failed, unless it goes on then.

        hear: is given messages of the tasks. ended: is told of each task that has ended. Both are called in this
        thread. stop: when set, tasks end where they can, such as after a frame, and no other is begun; it is set where
        a task was interrupted.
        """
        ...


def carry_out(
    job: Job,
    executor: Executor,
    done: Callable[[TaskOutcome], None],
    progress: Progress,
    stop: threading.Event,
) -> None:
    """Have a job carried out. done: is told of each task that is done. progress: hears a note on a subject once.

    Raises NoisyWorldError where a task could not be done, InterruptedRunError where `stop` was set.
    """
    failed: list[TaskOutcome] = []

    def ended(outcome: TaskOutcome) -> None:
        if outcome.done:
            done(outcome)
            return
        failed.append(outcome)
        if executor.goes_on:
            progress.note(Message(f"{outcome.name} failed: ", outcome.failure))

    executor.run(job, _hearing(progress), ended, stop)
    if failed and executor.goes_on:
        first = f"{len(failed)} of {len(job.tasks)} {job.what} could not be {job.verb}; {failed[0].name}: "
        remedy = Message("mend that and ", Action.RUN_AGAIN, ": the others are kept")
        raise NoisyWorldError(Message(first, failed[0].failure), remedy=remedy)
    if failed:
        raise NoisyWorldError(failed[0].failure)
    if stop.is_set():
        raise InterruptedRunError("stopped")


def _hearing(progress: Progress) -> Callable[[TaskMessage], None]:
    """Return what hands messages of tasks on to a listener, a note on a subject once."""
    subjects = set[str]()

    def hear(message: TaskMessage) -> None:
        match message:
            case {"start": {"label": label, "total": total, "done": there}}:
                progress.start(label, total, there)
            case {"advance": count}:
                progress.advance(count)
            case {"finish": True}:
                progress.finish()
            case {"note": text}:  # several workers say the same of a scene that each of them loads
                subject = message.get("subject", text)
                if subject not in subjects:
                    subjects.add(subject)
                    progress.note(text)

    return hear


class InProcess:
    """This process as an executor."""

    slots = 1

    def __init__(self, prepare: Prepare, *, goes_on: bool = False) -> None:
        """Take what makes ready for tasks, as a worker does."""
        self._prepare = prepare
        self.goes_on = goes_on

    def run(
        self, job: Job, hear: Callable[[TaskMessage], None], ended: Callable[[TaskOutcome], None], stop: threading.Event
    ) -> None:
        """Carry out the tasks, one after another. Raises what they raise, unless it goes on then."""
        with self._prepare(job.order, HeardProgress(hear)) as perform:
            for task in job.tasks:
                if stop.is_set():
                    return
                try:
                    outcome = TaskOutcome(task.name, report=perform(task.name))
                except InterruptedRunError:
                    raise
                except NoisyWorldError as error:
                    if not self.goes_on:
                        raise
                    outcome = TaskOutcome(task.name, USERS_ERROR, str(error))
                ended(outcome)


class HeardProgress(JsonProgress):
    """A listener that hands on what it hears as messages."""

    def __init__(self, hear: Callable[[TaskMessage], None]) -> None:
        self._hear = hear

    def tell(self, message: TaskMessage) -> None:
        """Hand on a message."""
        self._hear(message)


class TaskQueue:
    """The tasks that no worker has yet. Neighbours go to one worker, so that little is loaded twice."""

    def __init__(self, tasks: tuple[Task, ...]) -> None:
        """Take the tasks; those of a group are given out in this order."""
        self._waiting: dict[str, deque[Task]] = {}
        self._left: dict[str, float] = {}  # of each group that has tasks, their seconds
        for task in tasks:
            self._waiting.setdefault(task.group, deque()).append(task)
            self._left[task.group] = self._left.get(task.group, 0.0) + task.seconds
        self._larger = {task.group: task.larger_group for task in tasks}
        self._held: dict[int, str] = {}  # the group that each worker is at

    def next_for(self, worker: int) -> Task | None:
        """Return the next task for a worker, by its number; None where there is none.

        The next of its group or, where that has none, the first of the group that has most left to do: one that nobody
        is at, of the same larger group if possible; else the last of one that another worker is at.
        """
        at = self._held.get(worker)
        if at in self._left:
            return self._take(at)
        if not self._left:
            return None
        others = {held for number, held in self._held.items() if number != worker}
        near = None if at is None else self._larger[at]
        group = max(self._left, key=lambda item: (item not in others, self._larger[item] == near, self._left[item]))
        if group in others:
            self._held.pop(worker, None)  # it stays the other's
            return self._take(group, last=True)
        self._held[worker] = group
        return self._take(group)

    def _take(self, group: str, *, last: bool = False) -> Task:
        tasks = self._waiting[group]
        task = tasks.pop() if last else tasks.popleft()
        self._left[group] -= task.seconds
        if not tasks:
            del self._left[group]
        return task


# A worker: a process that does the tasks which another one names on standard input; `worker_process` is that side.


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
