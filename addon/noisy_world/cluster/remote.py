# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node of a cluster does for a task: it runs one command in a process, and tells how that goes on.

Ray carries this module to the nodes by its content, so it works where the package is missing, and says that in a line.
Hence it imports nothing but the standard library, and Ray where Ray runs it.
"""

import contextlib
import ctypes
import hashlib
import importlib
import json
import os
import platform
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

MARK = "@noisy-world "  # as `core.progress`; a test holds the two together
DONE, USERS_ERROR, REFUSED, BUSY, INTERRUPTED = 0, 1, 3, 75, 130
"""Exit statuses of a command: REFUSED where this machine cannot make any shard as the others do, BUSY where another
process makes this one."""
GRACE_S = 60.0  # for the command to end after its current frame
TELL_EVERY_S = 1.0
BUSY_FOR_S = 120.0  # how long a task waits for another process on the same shard to end: one whose node is lost
LAST_WORDS = 5  # lines of what a command that crashed has said


@dataclass(frozen=True)
class Task:
    """A task.

    name: the shard's. words: the command, after the Python that the node has. told: what it reads on standard input,
    which stays open while it runs. then: what it reads there when it has made the shard. environment: variables that it
    gets. search_path: a folder that has the package and goes before what is installed, where the node sees it; "" for
    none. version: of the package, which has to be the same here. seen, sha256: a file that has to be visible here, with
    its hash; "" for none.
    """

    name: str
    words: tuple[str, ...]
    told: str = ""
    then: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    search_path: str = ""
    version: str = ""
    seen: str = ""
    sha256: str = ""


@dataclass
class Ended:
    """How a command ended: its exit status, its last lines on standard error, the error and the report that it told."""

    status: int = DONE
    said: list[str] = field(default_factory=list)
    error: str = ""
    report: dict[str, Any] | None = None

    @property
    def line(self) -> str:
        """Why it did not do its work; "" where it did."""
        if self.status == DONE:
            return ""
        if self.error:
            return self.error
        if self.status in (USERS_ERROR, REFUSED, BUSY, INTERRUPTED):
            return self.said[-1] if self.said else ""
        how = f"was ended by signal {-self.status}" if self.status < 0 else f"ended with status {self.status}"
        return f"{how}: {' | '.join(self.said) or 'it said nothing'}"


def in_ray(order: Task, tell: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Run a task's command on a node of Ray; see `carry_out`. The result has the node's identifier too."""
    ray: Any = importlib.import_module("ray")
    return {**carry_out(order, tell), "node_id": ray.get_runtime_context().get_node_id()}


def carry_out(order: Task, tell: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Run a task's command.

    tell: sends a message to the driver, such as {"advance": 3}. Returns the node, the exit status, the line that the
    command ended with (of one that crashed, its last words) and its report.
    """
    node = platform.node()
    environment = _environment(order)
    if problem := _problem(order, environment):
        return {"node": node, "status": REFUSED, "line": problem, "report": None}
    begun_s = time.monotonic()
    while True:
        ended = _run(order, environment, tell)
        if ended.status != BUSY or time.monotonic() - begun_s > BUSY_FOR_S:
            return {"node": node, "status": ended.status, "line": ended.line, "report": ended.report}
        time.sleep(TELL_EVERY_S)


def _environment(order: Task) -> dict[str, str]:
    environment = {**os.environ, **order.environment}
    if order.search_path and Path(order.search_path, "noisy_world").is_dir():
        kept = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = order.search_path + (os.pathsep + kept if kept else "")
    return environment


def _problem(order: Task, environment: dict[str, str]) -> str:
    """Return why this node cannot do the task, in a line, or ""."""
    if order.version:
        command = [sys.executable, "-m", "noisy_world", "--version"]
        found = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        there = found.stdout.split()[-1:] if found.returncode == 0 else []
        if there != [order.version]:
            here = f"has Noisy World {there[0]}" if there else f"has no Noisy World for {sys.executable}"
            return f"{here}; install the version of the driver there, {order.version}"
    if order.seen:
        seen = Path(order.seen)
        try:
            digest = hashlib.sha256(seen.read_bytes()).hexdigest() if seen.is_file() else ""
        except OSError:
            digest = ""
        if digest != order.sha256:
            state = "sees another file" if digest else "sees nothing"
            return f"{state} at {order.seen}, which all nodes have to share, under one path"
    return ""


def _run(order: Task, environment: dict[str, str], tell: Callable[[dict[str, Any]], object]) -> Ended:
    """Run the command once."""
    process = subprocess.Popen(
        [sys.executable, *order.words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=environment,
        preexec_fn=_dying_with_parent(),  # noqa: PLW1509 - a call in C and nothing else
    )
    assert process.stdin is not None
    heard: queue.Queue[tuple[IO[str] | None, str]] = queue.Queue()
    streams = [stream for stream in (process.stdout, process.stderr) if stream is not None]
    for stream in streams:
        threading.Thread(target=_listen, args=(stream, heard), daemon=True).start()
    ended = Ended()
    told = _Told(tell, ended)
    try:
        _say(process.stdin, order.told)
        while streams:
            told.what_is_due()
            # In turns: Ray ends a cancelled task by KeyboardInterrupt, which nothing hears that waits for long.
            with contextlib.suppress(queue.Empty):
                stream, line = heard.get(timeout=0.2)
                if not line:
                    streams = [item for item in streams if item is not stream]
                elif stream is process.stderr:
                    ended.said = [*ended.said, line.strip()][-LAST_WORDS:]
                elif told.made_by(line):
                    _say(process.stdin, order.then)
        told.rest()
        ended.status = process.wait()
    except BaseException:
        _end(process)
        raise
    return ended


def _say(stream: IO[str], text: str) -> None:
    with contextlib.suppress(BrokenPipeError):  # the command has ended already; its exit status is heard
        stream.write(text)
        stream.flush()


def _listen(stream: IO[str], heard: "queue.Queue[tuple[IO[str] | None, str]]") -> None:
    """Hand on the lines of a stream, and "" at its end."""
    for line in stream:
        if line.strip():
            heard.put((stream, line))
    heard.put((stream, ""))


class _Told:
    """What of a command's messages the driver is told: notes, and frames that are done, once in TELL_EVERY_S."""

    def __init__(self, tell: Callable[[dict[str, Any]], object], ended: Ended) -> None:
        self._tell = tell
        self._ended = ended
        self._waiting = 0
        self._told_s = time.monotonic()

    def made_by(self, line: str) -> bool:
        """Hand on a line's message, or keep what it says of the command's end; tell whether the shard is made."""
        _, mark, text = line.partition(MARK)
        try:
            message = json.loads(text) if mark else None
        except ValueError:  # cut off, as the command was ended
            return False
        match message:
            case {"note": _}:
                self._tell(message)
            case {"advance": int(count)}:
                self._waiting += count
            case {"error": str(error)}:
                self._ended.error = error
            case {"report": dict(report)}:
                self._ended.report = report
            case {"made": _}:
                return True
        return False

    def what_is_due(self) -> None:
        """Tell what has not been told for long."""
        if time.monotonic() - self._told_s >= TELL_EVERY_S:
            self.rest()

    def rest(self) -> None:
        """Tell what has not been told."""
        if self._waiting:
            self._tell({"advance": self._waiting})
        self._waiting, self._told_s = 0, time.monotonic()


def _dying_with_parent() -> Callable[[], object] | None:
    """Return what has the system end a process with its parent: else, after a worker is lost, two make a shard."""
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None).prctl  # found before the process is split, in which as little as possible may happen
    return lambda: prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _end(process: subprocess.Popen[str]) -> None:
    """Let the command end after its current frame, and kill it if it takes too long."""
    process.terminate()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
