# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs one command, ends all of its processes, and says what it took; a program of its own, without other modules.

    python -I -S guard.py ORDER

ORDER is JSON: command (words), folder (where it runs), log (the file for its output), log_bytes (of its beginning, and
of its end, that are kept), limit_s (on the wall), grace_s (between the request to end and the end). It ends the command
when its own standard input ends: so a system never outlives the process that asked for it, however that ended. A small
process also starts the command because a child's peak memory begins with that of its parent. At the end it prints JSON:
status (the exit status, negative for a signal), ended ("itself", "limit", "asked", "missing"), seconds, processor_s,
peak_memory_bytes, problem.
"""

import contextlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import time
from collections import deque
from typing import BinaryIO

POLL_S = 0.05
PIECE = 65536


class Log:
    """The beginning and the end of what is written to it, in a file."""

    def __init__(self, path: str, most: int) -> None:
        """Open the file. most: bytes of the beginning, and of the end, that are kept."""
        self._file: BinaryIO = open(path, "wb")  # noqa: PTH123, SIM115 - starts fast, without pathlib; closed below
        self._left = most
        self._most = most
        self._tail: deque[bytes] = deque()
        self._held = 0
        self._dropped = 0

    def write(self, data: bytes) -> None:
        """Take more output."""
        head, rest = data[: self._left], data[self._left :]
        self._left -= len(head)
        self._file.write(head)
        self._file.flush()
        if rest:
            self._tail.append(rest)
            self._held += len(rest)
        while self._held - len(self._tail[0] if self._tail else b"") >= self._most:
            lost = self._tail.popleft()
            self._held -= len(lost)
            self._dropped += len(lost)

    def close(self) -> None:
        """Write the end."""
        if self._dropped:
            self._file.write(f"\n[{self._dropped} bytes are left out here]\n".encode())
        for data in self._tail:
            self._file.write(data)
        self._file.close()


def main(order: dict) -> dict:
    """Carry out an order and return what is to be said."""
    started = time.monotonic()
    log = Log(order["log"], order["log_bytes"])
    try:
        process = subprocess.Popen(  # noqa: S603 - what the user's definition says
            order["command"],
            cwd=order["folder"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except OSError as error:
        log.close()
        return {"ended": "missing", "problem": f"{error.filename or order['command'][0]}: {error.strerror}"}
    assert process.stdout is not None
    ended = attend(process, process.stdout.fileno(), log, started + order["limit_s"])
    end_group(process.pid, order["grace_s"] if ended != "itself" else 0.0)
    status, spent = reap(process.pid)
    drain(process.stdout.fileno(), log)
    log.close()
    scale = 1 if sys.platform == "darwin" else 1024
    return {
        "status": status,
        "ended": ended,
        "seconds": time.monotonic() - started,
        "processor_s": spent.ru_utime + spent.ru_stime,
        "peak_memory_bytes": spent.ru_maxrss * scale,
        "problem": "",
    }


def attend(process: subprocess.Popen, output: int, log: Log, until: float) -> str:
    """Write the output of a process to the log until it ends or has to; return which."""
    watched = [output, sys.stdin.fileno()]
    while True:
        ready, _, _ = select.select(watched, [], [], POLL_S)
        if output in ready:
            data = os.read(output, PIECE)
            log.write(data)
            if not data:
                watched.remove(output)
        if sys.stdin.fileno() in ready and not os.read(sys.stdin.fileno(), PIECE):
            return "asked"
        if os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
            return "itself"
        if time.monotonic() > until:
            return "limit"
        if output not in watched and not ready:
            time.sleep(POLL_S)


def end_group(leader: int, grace_s: float) -> None:
    """End the processes of a group whose leader is not reaped yet: ask them, wait for the leader, end what is left."""
    if grace_s:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, signal.SIGTERM)
        until = time.monotonic() + grace_s
        while time.monotonic() < until:
            if os.waitid(os.P_PID, leader, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
                break
            time.sleep(POLL_S)
    with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses a group that is a zombie alone
        os.killpg(leader, signal.SIGKILL)


def reap(leader: int) -> tuple[int, resource.struct_rusage]:
    """Wait for a process; return its exit status, negative for a signal, and what it and its children took."""
    _, status, spent = os.wait4(leader, 0)
    return os.waitstatus_to_exitcode(status), spent


def drain(output: int, log: Log) -> None:
    """Write what the output still holds; a process that left the group may keep it open."""
    while select.select([output], [], [], 0.0)[0]:
        data = os.read(output, PIECE)
        if not data:
            break
        log.write(data)


if __name__ == "__main__":
    print(json.dumps(main(json.loads(sys.argv[1]))))  # noqa: T201 - what it says
