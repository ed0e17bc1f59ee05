# SPDX-License-Identifier: GPL-3.0-or-later
"""A command of a system under its guard (`guard.py`): within limits, and with all of its processes ended."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from .definition import Limits
from .guard import MARK, end_marked

GUARD = Path(__file__).with_name("guard.py")
LOG_BYTES = 256 * 1024  # of the beginning, and of the end
POLL_S = 0.05
OVERDUE_S = 60.0  # after the time limit and the grace: then the guard itself was stopped
LONGEST_TOLD = 2**16  # bytes of what the guard says

Ended: TypeAlias = Literal["itself", "limit", "asked", "missing", "over", "unwatched"]


@dataclass(frozen=True)
class CommandOutcome:
    """How a command ended: by itself, at its time limit, as it was asked to, over another limit; its program was
    missing; or it ended the guard, or stopped it.

    status: negative for a signal, None where it is not known. problem: a sentence, "" for none.
    """

    ended: Ended
    problem: str = ""
    status: int | None = None
    seconds: float = 0.0
    processor_s: float | None = None
    peak_memory_bytes: int | None = None


def watched(
    command: Sequence[str],
    variables: Mapping[str, str],
    folders: Sequence[Path],
    log: Path,
    limits: Limits,
    *,
    limit_s: float,
    grace_s: float,
    errors: Path | None = None,
    stop: threading.Event | None = None,
) -> CommandOutcome:
    """Run a command in a session of its own, and end all that it started.

    folders: the first is that in which it runs; what is written into all of them counts. log: a file for what it says.
    errors: one for what it says on standard error, if not the log. limit_s: on the wall. grace_s: from being asked to
    end until it is ended. stop: ends it when set.
    """
    order = {
        "command": list(command),
        "folder": os.fspath(folders[0]),
        "counted": [os.fspath(folder) for folder in folders],
        "log": os.fspath(log),
        "errors": "" if errors is None else os.fspath(errors),
        "log_bytes": LOG_BYTES,
        "limit_s": limit_s,
        "grace_s": grace_s,
        "limits": limits.of_guard,
    }
    mark, begun_s = uuid.uuid4().hex, time.monotonic()
    process = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-I", "-S", str(GUARD), json.dumps(order)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**variables, MARK: mark},
        # Ctrl-C is for us: the guard ends when its input does.
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
    )
    assert process.stdin is not None
    assert process.stdout is not None
    ended: CommandOutcome | None = None
    try:
        _wait(process, begun_s + limit_s + grace_s + OVERDUE_S, stop)
    finally:
        process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(grace_s + OVERDUE_S)
        if process.poll() == 0:
            if sys.platform != "win32":
                os.set_blocking(process.stdout.fileno(), False)  # a process that could not be ended may hold it
            ended = _parsed(process.stdout.read(LONGEST_TOLD))
        process.stdout.close()
        if ended is None:
            process.kill()
            process.wait()
            end_marked(mark)
    problem = "it ended, stopped or disturbed the process that watches over it"
    return ended or CommandOutcome("unwatched", problem, seconds=time.monotonic() - begun_s)


def _wait(process: subprocess.Popen[bytes], until_s: float, stop: threading.Event | None) -> None:
    """Wait until a guard ends, it is stopped or it is overdue."""
    while process.poll() is None and time.monotonic() < until_s:
        if stop is not None and stop.wait(POLL_S):
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(POLL_S if stop is not None else until_s - time.monotonic())


def _parsed(said: bytes | None) -> CommandOutcome | None:
    """Return what a guard said; None where that is not what a guard says."""
    try:
        content: Any = json.loads(said or b"")
        return CommandOutcome(**content)
    except (ValueError, TypeError, RecursionError):
        return None
