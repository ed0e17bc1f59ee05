# SPDX-License-Identifier: GPL-3.0-or-later
"""A command of a system within its limits: under its guard (`guard.py`), and isolated by bubblewrap."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

from .guard import MARK, end_marked
from .systems import Limits

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


def _parsed(output: bytes | None) -> CommandOutcome | None:
    """Return what a guard said; None where that is not what a guard says."""
    try:
        content: Any = json.loads(output or b"")
        return CommandOutcome(**content)
    except (ValueError, TypeError, RecursionError):
        return None


# Isolation by bubblewrap: a system sees its input and its programs, and can write only its own folder.
#
# bubblewrap (https://github.com/containers/bubblewrap) makes the namespaces; here it is only told what is in them.


PROGRAM = "bwrap"
TRIED_S = 20.0
SYSTEM_FOLDERS = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/etc", "/opt", "/nix/store", "/gnu/store")
"""Of the machine, where they are: programs and libraries, to be read."""
GPU_DEVICES = ("/dev/nvidiactl", "/dev/nvidia-uvm", "/dev/nvidia-uvm-tools", "/dev/nvidia-modeset", "/dev/dxg")
VARIABLES = ("PATH", "LANG", "LANGUAGE", "TZ", "LD_LIBRARY_PATH", "PYTHONPATH", "PYTHONUNBUFFERED", "TERM")
VARIABLES_LIKE = ("LC_", "CUDA_", "NVIDIA_")
"""Environment variables that an isolated system still has, beside those of its definition."""
TEMPORARY = "/tmp"  # noqa: S108 - inside the isolation: a folder of the run's own


@cache
def isolation_problem() -> str:
    """Return why bubblewrap cannot isolate a program here; "" where it can."""
    if shutil.which(PROGRAM) is None:
        return f"there is no program {PROGRAM}; install it, on Debian and Ubuntu with: apt-get install bubblewrap"
    try:
        done = subprocess.run(  # noqa: S603
            [*_namespaces(), *_read_only(existing(SYSTEM_FOLDERS)), "--", "true"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=TRIED_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{PROGRAM} cannot be run: {error}"
    if done.returncode == 0:
        return ""
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    why = lines[-1] if lines else f"it ended with {done.returncode}"
    return f"this machine does not permit it ({why}); permit user namespaces, or run inside a container without it"


def isolated(command: list[str], *, reads: Iterable[Path], out: Path, temporary: Path, gpu: bool) -> list[str]:
    """Return a command that runs another, isolated: without network, and with processes of its own alone.

    reads: files and folders that it may read beside the machine's programs. out: the folder that it may write into, and
    runs in. temporary: the folder that is its /tmp.
    """
    words = [*_namespaces(), *_read_only(existing(SYSTEM_FOLDERS)), "--bind", os.fspath(temporary), TEMPORARY]
    words += _read_only(path for path in outermost(existing(reads)) if not _inside(path, existing(SYSTEM_FOLDERS)))
    if gpu:
        for device in (*existing(GPU_DEVICES), *sorted(map(str, Path("/dev").glob("nvidia[0-9]*"))), "/dev/dri"):
            words += ["--dev-bind-try", device, device]
        words += ["--ro-bind-try", "/sys", "/sys"]
    words += ["--bind", os.fspath(out), os.fspath(out), "--setenv", "HOME", TEMPORARY]
    return [*words, "--chdir", os.fspath(out), "--", *command]


def isolated_variables(variables: Mapping[str, str], own: Iterable[str]) -> dict[str, str]:
    """Return the environment variables of an isolated system: no others of the user's. own: names of its definition."""
    named = {*VARIABLES, *own}
    return {name: value for name, value in variables.items() if name in named or name.startswith(VARIABLES_LIKE)}


def program_folders(program: str) -> list[Path]:
    """Return what has to be read so that a program can start: its file, and for a Python its installation."""
    program_file = Path(shutil.which(program) or program)
    needed = [program_file, program_file.resolve()]
    for file in needed.copy():
        prefix = file.parent.parent
        if file.name.startswith("python") and ((prefix / "pyvenv.cfg").is_file() or list(prefix.glob("lib/python3*"))):
            needed.append(prefix)
    return needed


def own_folders() -> list[Path]:
    """Return the folders of the Python that runs this."""
    return [Path(name) for name in dict.fromkeys((sys.prefix, sys.base_prefix, sys.exec_prefix))]


def existing(paths: Iterable[str | Path]) -> list[Path]:
    """Return those of some paths that are there."""
    return [Path(path) for path in paths if os.path.exists(path)]  # noqa: PTH110 - of a text too


def outermost(paths: Iterable[Path]) -> list[Path]:
    """Return the paths that lie in none of the others, each once."""
    distinct = list(dict.fromkeys(paths))
    return [path for path in distinct if not _inside(path.parent, distinct)]


def _inside(path: Path, folders: list[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def _namespaces() -> list[str]:
    apart = ["--unshare-user-try", "--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts"]
    return [PROGRAM, *apart, "--die-with-parent", "--new-session", "--proc", "/proc", "--dev", "/dev"]


def _read_only(paths: Iterable[Path]) -> list[str]:
    return [word for path in paths for word in ("--ro-bind", os.fspath(path), os.fspath(path))]
