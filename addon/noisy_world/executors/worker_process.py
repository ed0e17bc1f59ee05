# SPDX-License-Identifier: GPL-3.0-or-later
"""Workers that are processes: started and told their tasks; and a node of a cluster, which runs one for a task.

Runs a worker for a task on a node of a cluster, and reports its progress.

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
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import IO, Any, Protocol, TypeAlias

from ..core.errors import BUSY, DONE, INTERRUPTED, REFUSED, USERS_ERROR, Message, how_it_ended
from ..core.progress import read_message

# Starts a worker process and talks to it; `worker` is the other side.
#
# It reads lines from standard input: an order, then names of tasks, each when the last is done; the end of that stream
# ends it. On standard output it tells messages: {"made": NAME, "report": ...} says that a task is done, {"error": TEXT}
# why it could not be. Ray carries this module to the nodes by its content: see `node`.


Heard: TypeAlias = queue.Queue[tuple[int, dict[str, Any]]]
"""What workers tell, each with the worker's number; {"end": status} is the last, {"said": line} of standard error."""


class Started(Protocol):
    """A process with pipes to its standard input and from its standard output, as subprocess.Popen has them."""

    stdin: IO[str] | None
    stdout: IO[str] | None
    stderr: IO[str] | None

    def poll(self) -> int | None:
        """Return its exit status, negative where a signal ended it; None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int:
        """Return its exit status when it has ended. Raises subprocess.TimeoutExpired."""
        ...

    def terminate(self) -> None:
        """Ask it to end."""
        ...

    def kill(self) -> None:
        """End it."""
        ...


def started(
    command: Sequence[str],
    environment: Mapping[str, str],
    *,
    listening: bool = False,
    begins: Callable[[], object] | None = None,
) -> "subprocess.Popen[str]":
    """Start the process of a worker. listening: to standard error too, which is this process's otherwise.

    begins: is called in it.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE if listening else None,
        text=True,
        errors="replace",
        env=environment,
        preexec_fn=begins,  # noqa: PLW1509 - a call in C and nothing else
    )


class WorkerProcess:
    """A process that does one task after another."""

    def __init__(self, process: Started, heard: Heard, *, number: int = 0) -> None:
        """Listen to a process that was started."""
        self._number = number
        self._heard = heard
        self._process = process
        errors = threading.Thread(target=self._hear_errors, args=(process.stderr,), daemon=True)
        errors.start()
        threading.Thread(target=self._hear, args=(process.stdout, errors), daemon=True).start()

    def tell(self, line: str) -> None:
        """Tell it a line: its order, or the name of a task."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended; its exit status is heard
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()

    def finish(self) -> None:
        """Let it end: there is no task left."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()

    def stop(self) -> None:
        """Let it end where its task can be taken up again, such as after the current frame."""
        self._process.terminate()

    def end(self, grace_s: float = 0.0) -> None:
        """End it, in which it has some time to stop. Returns when it has ended."""
        if self._process.poll() is None and grace_s:
            self.stop()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self.finish()  # which lets go of what it was not told any more

    def _hear_errors(self, stream: IO[str] | None) -> None:
        for line in stream or ():
            if line.strip():
                self._heard.put((self._number, {"said": line.strip()}))

    def _hear(self, stream: IO[str] | None, errors: threading.Thread) -> None:
        """Pass on messages until it ends."""
        for line in stream or ():
            if (message := read_message(line)) is not None:
                self._heard.put((self._number, message))
        errors.join()
        self._heard.put((self._number, {"end": self._process.wait()}))


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
