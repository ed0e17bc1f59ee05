# SPDX-License-Identifier: GPL-3.0-or-later
"""Starts a worker process and talks to it; `worker` is the other side.

It reads lines from standard input: an order, then names of tasks, each when the last is done; the end of that stream
ends it. On standard output it tells messages: {"made": NAME, "report": ...} says that a task is done, {"error": TEXT}
why it could not be. Ray carries this module to the nodes by its content: see `node`.
"""

import contextlib
import queue
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any, Protocol, TypeAlias

from ..core.progress import read_message

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
