# SPDX-License-Identifier: GPL-3.0-or-later
"""The one way in which Blender reads a file that somebody gave: in a process of its own, within limits.

Its readers may end the process where a file is damaged, take hours, more memory than there is, or wait for what never
comes. Each of these is a line that names the file. The process is this Blender where there is one, else this Python
with the bpy package.
"""

import os
import signal
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import InputError
from ..core.regular_files import read_text

# Chosen: twenty times what a file of a million triangles takes.
LIMIT_S, LIMIT_FOR_EACH_MB_S = 120, 5
IDLE_S = 30.0  # chosen: a process that does nothing for so long waits for a pipe, or a disk that is gone
_LOOK_S = 2.0
DAMAGED = "the file is damaged, or takes more memory than there is: export or save it again"


def processor_limit_s(files: Iterable[Path]) -> int:
    """Return how many seconds of a processor Blender may take to read files."""
    return LIMIT_S + LIMIT_FOR_EACH_MB_S * sum(file.stat().st_size for file in files) // 10**6


def run_blender(
    command: list[str], file: Path, *, who: str, limit_s: int, order: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a command that has Blender read a file, and return how it ended.

    who: what reads it, in words. limit_s: what the command has been told of its processor's time. order: goes to its
    standard input. Raises InputError where it went over a limit, or a signal ended it.
    """
    started = subprocess.Popen(  # noqa: S603 - this program
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
    )
    with started:
        try:
            out, err = _said(started, order)
        except BaseException as error:
            started.kill()
            if not isinstance(error, TimeoutError):
                raise
            problem = f"{who} waits for what never comes, a pipe or a disk that is away"
            raise InputError(file, problem, remedy="see that all it names are files that can be read") from None
    ended_by = -started.returncode if started.returncode < 0 else started.returncode - 128  # the latter by a shell
    if ended_by > 0:
        raise _ended(file, who, ended_by, limit_s)
    return subprocess.CompletedProcess(command, started.returncode, out, err)


@contextmanager
def last_words(file: Path, doing: str) -> Iterator[None]:
    """Have a line stand on standard error where this process is ended by a signal while Blender does something here.

    file: that it does it with. A shell waits for a word that says that all went on, or for the end of this process.
    """
    if os.name != "posix":
        yield
        return
    line = InputError(file, f"Blender was ended while it {doing}", remedy=DAMAGED)
    shell = ["/bin/sh", "-c", 'read -r word || printf "%s\\n" "$1" >&2', "sh", str(line)]
    watcher = subprocess.Popen(shell, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)  # noqa: S603 - text alone
    try:
        yield
    finally:
        watcher.communicate(b"goes on\n")


def _said(started: "subprocess.Popen[str]", order: str) -> tuple[str, str]:
    """Return what a process says until it ends. Raises TimeoutError where it does nothing any more."""
    spent, since = _spent(started.pid), time.monotonic()
    asked: str | None = order
    while True:
        try:
            return started.communicate(asked, timeout=_LOOK_S)
        except subprocess.TimeoutExpired:
            asked = None  # it has been told
        if (now := _spent(started.pid)) != spent:
            spent, since = now, time.monotonic()
        elif spent is not None and time.monotonic() - since > IDLE_S:
            raise TimeoutError


def _spent(number: int) -> tuple[int, int] | None:
    """Return the time of a processor that a process has taken, in ticks; None where the system does not tell."""
    try:
        words = read_text(Path(f"/proc/{number}/stat")).rpartition(")")[2].split()
        return int(words[11]), int(words[12])
    except (OSError, ValueError, IndexError):
        return None


def _ended(file: Path, who: str, number: int, limit_s: int) -> InputError:
    if hasattr(signal, "SIGXCPU") and number == signal.SIGXCPU:
        problem = f"{who} takes more than {limit_s} s of a processor for it"
        return InputError(file, problem, remedy="its copies may be too many: export it as one mesh")
    name = signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
    problem = f"{who} was ended by {name}"
    if os.name == "posix" and number == signal.SIGKILL:
        return InputError(file, f"{problem}, perhaps for want of memory", remedy="run it where there is more memory")
    return InputError(file, problem, remedy=DAMAGED)


def as_installed(module: str) -> str:
    """Return the name under which a process finds a module of ours, whose package an extension names otherwise."""
    return ".".join([Path(__file__).resolve().parents[1].name, *module.split(".")[1:]])
