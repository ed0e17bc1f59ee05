# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node of a cluster does for a task: it runs one command in a process, and tells how that goes on.

Ray carries this module to the nodes by its content, so it works where the package is missing, and says that in a line.
Hence it imports nothing but the standard library.
"""

import contextlib
import ctypes
import hashlib
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
DONE, USERS_ERROR, INTERRUPTED, BUSY = 0, 1, 130, 75  # exit statuses of a command
GRACE_S = 60.0  # for the command to end after its current frame
TELL_EVERY_S = 1.0
BUSY_FOR_S = 120.0  # how long a task waits for another process on the same shard to end: one whose node is lost
LAST_WORDS = 5  # lines of what a command that crashed has said


@dataclass(frozen=True)
class Order:
    """A task.

    name: the shard's. words: the command, after the Python that the node has. environment: variables that it gets.
    search_path: a folder that has the package and goes before what is installed, where the node sees it; "" for none.
    version: of the package, which has to be the same here. seen, sha256: a file that has to be visible here, with its
    hash; "" for none.
    """

    name: str
    words: tuple[str, ...]
    environment: dict[str, str] = field(default_factory=dict)
    search_path: str = ""
    version: str = ""
    seen: str = ""
    sha256: str = ""


def carry_out(order: Order, tell: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Run a task's command.

    tell: sends a message to the driver, such as {"advance": 3}. Returns the node, the exit status and the line that the
    command ended with; of a command that crashed, its last words.
    """
    node = platform.node()
    environment = _environment(order)
    if problem := _problem(order, environment):
        return {"node": node, "status": USERS_ERROR, "line": problem}
    begun_s = time.monotonic()
    while True:
        status, said, line = _run(order, environment, tell)
        if status != BUSY or time.monotonic() - begun_s > BUSY_FOR_S:
            break
        time.sleep(TELL_EVERY_S)
    if status in (DONE, USERS_ERROR, INTERRUPTED, BUSY):
        return {"node": node, "status": status, "line": line or (said[-1] if status and said else "")}
    how = f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"
    return {"node": node, "status": status, "line": f"{how}: {' | '.join(said) or 'it said nothing'}"}


def _environment(order: Order) -> dict[str, str]:
    environment = {**os.environ, **order.environment}
    if order.search_path and Path(order.search_path, "noisy_world").is_dir():
        kept = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = order.search_path + (os.pathsep + kept if kept else "")
    return environment


def _problem(order: Order, environment: dict[str, str]) -> str:
    """Return why this node cannot do the task, in a line, or ""."""
    if order.version:
        command = [sys.executable, "-m", "noisy_world", "--version"]
        found = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        there = found.stdout.split()[-1:] if found.returncode == 0 else []
        if there != [order.version]:
            here = f"has Noisy World {there[0]}" if there else f"has no Noisy World for {sys.executable}"
            return f"{here}; install the version of the driver there, {order.version}"
    if order.seen:
        try:
            digest = hashlib.sha256(Path(order.seen).read_bytes()).hexdigest()
        except OSError:
            digest = ""
        if digest != order.sha256:
            state = "sees another file" if digest else "sees nothing"
            return f"{state} at {order.seen}; the dataset's folder has to be shared by all nodes, under one path"
    return ""


def _run(
    order: Order, environment: dict[str, str], tell: Callable[[dict[str, Any]], object]
) -> tuple[int, list[str], str]:
    """Run the command once; return its exit status, its last lines on standard error, and the error that it told."""
    process = subprocess.Popen(
        [sys.executable, *order.words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=environment,
        preexec_fn=_dying_with_parent(),  # noqa: PLW1509 - a call in C and nothing else
    )
    heard: queue.Queue[tuple[IO[str] | None, str]] = queue.Queue()
    streams = [stream for stream in (process.stdout, process.stderr) if stream is not None]
    for stream in streams:
        threading.Thread(target=_listen, args=(stream, heard), daemon=True).start()
    said: list[str] = []
    error = ""
    told = _Told(tell)
    try:
        while streams:
            # In turns: Ray ends a cancelled task by KeyboardInterrupt, which nothing hears that waits for long.
            told.what_is_due()
            with contextlib.suppress(queue.Empty):
                stream, line = heard.get(timeout=0.2)
                if not line:
                    streams = [item for item in streams if item is not stream]
                elif stream is process.stderr:
                    said = [*said, line.strip()][-LAST_WORDS:]
                else:
                    error = told.error_in(line) or error
        told.rest()
        return process.wait(), said, error
    except BaseException:
        _end(process)
        raise


def _listen(stream: IO[str], heard: "queue.Queue[tuple[IO[str] | None, str]]") -> None:
    """Hand on the lines of a stream, and "" at its end."""
    for line in stream:
        if line.strip():
            heard.put((stream, line))
    heard.put((stream, ""))


class _Told:
    """What of a command's messages the driver is told: notes, and frames that are done, once in TELL_EVERY_S."""

    def __init__(self, tell: Callable[[dict[str, Any]], object]) -> None:
        self._tell = tell
        self._waiting = 0
        self._told_s = time.monotonic()

    def error_in(self, line: str) -> str:
        """Hand on a line's message; return the error that it tells, or ""."""
        _, mark, text = line.partition(MARK)
        try:
            message = json.loads(text) if mark else None
        except ValueError:  # cut off, as the command was ended
            message = None
        if not isinstance(message, dict):
            return ""
        if "note" in message:
            self._tell(message)
        self._waiting += message.get("advance", 0)
        return message.get("error", "")

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
