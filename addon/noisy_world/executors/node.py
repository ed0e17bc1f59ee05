# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a worker for a task on a node of a cluster, and reports its progress.

Ray carries this module to the nodes by its content, with those that `carried` names, so it works where the package is
missing, and says that in a line. Hence they import nothing else but the standard library, and Ray where Ray runs them.
"""

import contextlib
import ctypes
import hashlib
import importlib
import os
import platform
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from ..core.exit_statuses import BUSY, DONE, INTERRUPTED, REFUSED, USERS_ERROR, how_it_ended
from ..core.messages import Message
from ..core.progress import read_message
from .worker_process import Heard, WorkerProcess, started

GRACE_S = 60.0  # for a worker to end after its current frame
TELL_EVERY_S = 1.0
BUSY_FOR_S = 120.0  # how long a task waits for another process on the same one to end: one whose node is lost
LAST_WORDS = 5  # lines of what a worker that crashed has said


@dataclass(frozen=True)
class NodeTask:
    """A task, as a node is told it.

    words: the command of a worker, after the Python that the node has. environment: variables that it gets.
    search_path: a folder that has the package and goes before what is installed, where the node sees it; "" for none.
    version: of the package, which has to be the same here. seen, sha256: a file that has to be visible here, with its
    hash; "" for none.
    """

    name: str
    words: tuple[str, ...]
    order: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    search_path: str = ""
    version: str = ""
    seen: str = ""
    sha256: str = ""


@dataclass
class Ended:
    """How a worker ended: its exit status, its last lines on standard error, the error and the report that it told."""

    status: int | None = None
    said: list[str] = field(default_factory=list)
    error: str = ""
    report: dict[str, Any] | None = None

    @property
    def line(self) -> str:
        """Why it did not do its task; "" where it did."""
        if self.status == DONE:
            return ""
        if self.error:
            return self.error
        if self.status in (USERS_ERROR, REFUSED, BUSY, INTERRUPTED):
            return self.said[-1] if self.said else ""
        assert self.status is not None, "it has ended"
        return f"{how_it_ended(self.status)}: {' | '.join(self.said) or 'it said nothing'}"


def carried() -> set[ModuleType]:
    """Return the modules that go to the nodes: of this one and of what it imports of the package."""
    return {sys.modules[item.__module__] for item in (carried, WorkerProcess, how_it_ended, Message, read_message)}


def in_ray(task: NodeTask, tell: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Carry out a task on a node of Ray; see `carry_out`. The result has the node's identifier too."""
    ray: Any = importlib.import_module("ray")
    return {**carry_out(task, tell), "node_id": ray.get_runtime_context().get_node_id()}


def carry_out(task: NodeTask, tell: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Let a worker do a task.

    tell: sends a message to the driver, such as {"advance": 3}. Returns the machine, the exit status, the line that the
    worker ended with (of one that crashed, its last words) and its report.
    """
    machine = platform.node()
    environment = _environment(task)
    if problem := _problem(task, environment):
        return {"machine": machine, "status": REFUSED, "line": problem, "report": None}
    begun_s = time.monotonic()
    while True:
        ended = _run(task, environment, tell)
        if ended.status != BUSY or time.monotonic() - begun_s > BUSY_FOR_S:
            return {"machine": machine, "status": ended.status, "line": ended.line, "report": ended.report}
        time.sleep(TELL_EVERY_S)


def _environment(task: NodeTask) -> dict[str, str]:
    environment = {**os.environ, **task.environment}
    if task.search_path and Path(task.search_path, "noisy_world").is_dir():
        kept = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = task.search_path + (os.pathsep + kept if kept else "")
    return environment


def _problem(task: NodeTask, environment: dict[str, str]) -> str:
    """Return why this node cannot do the task, in a line, or ""."""
    if task.version:
        command = [sys.executable, "-m", "noisy_world", "--version"]
        found = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        there = found.stdout.split()[-1:] if found.returncode == 0 else []
        if there != [task.version]:
            here = f"has Noisy World {there[0]}" if there else f"has no Noisy World for {sys.executable}"
            return f"{here}; install the version of the driver there, {task.version}"
    if task.seen:
        seen = Path(task.seen)
        try:
            digest = hashlib.sha256(seen.read_bytes()).hexdigest() if seen.is_file() else ""
        except OSError:
            digest = ""
        if digest != task.sha256:
            state = "sees another file" if digest else "sees nothing"
            return f"{state} at {task.seen}, which all nodes have to share, under one path"
    return ""


def _run(task: NodeTask, environment: dict[str, str], tell: Callable[[dict[str, Any]], object]) -> Ended:
    """Start a worker, and let it do the task."""
    heard, ended = Heard(), Ended()
    command = [sys.executable, *task.words]
    process = started(command, environment, listening=True, begins=_dying_with_parent())
    worker = WorkerProcess(process, heard)
    advanced, told_s = 0, time.monotonic()
    try:
        worker.tell(task.order)
        worker.tell(task.name)
        while ended.status is None:
            # In turns: Ray ends a cancelled task by KeyboardInterrupt, which nothing hears that waits for long.
            with contextlib.suppress(queue.Empty):
                _, message = heard.get(timeout=0.2)
                match message:
                    case {"note": text}:
                        tell({**message, "note": str(text)})  # plain text: what crosses Ray is known to both sides
                    case {"advance": int(count)}:
                        advanced += count
                    case {"error": str(error)}:
                        ended.error = str(error)
                    case {"said": str(line)}:
                        ended.said = [*ended.said, line][-LAST_WORDS:]
                    case {"made": _, "report": report}:
                        ended.report = report
                        worker.finish()
                    case {"end": int(status)}:
                        ended.status = status
            if advanced and (ended.status is not None or time.monotonic() - told_s >= TELL_EVERY_S):
                tell({"advance": advanced})  # of many frames at once
                advanced, told_s = 0, time.monotonic()
    except BaseException:
        worker.end(GRACE_S)
        raise
    return ended


def _dying_with_parent() -> Callable[[], object] | None:
    """Return what has the system end a process with its parent: else, after a worker is lost, two do a task."""
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None).prctl  # found before the process is split, in which as little as possible may happen
    return lambda: prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
