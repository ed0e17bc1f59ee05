# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs one command within limits, ends all of its processes, and says what it took; a program without other modules.

    python -I -S guard.py ORDER

ORDER is JSON: command (words), folder (where it runs), counted (the folders that it writes into), log (the file for its
output), errors (the file for what it says on standard error; "" for the log), log_bytes (of the beginning of each, and
of the end, that are kept), limit_s (on the wall), grace_s (between the request to end and the end), limits (`Limits`,
below). It ends the command when its own
standard input ends: so a system never outlives the process that asked for it, however that ended. A small process also
starts the command because a child's peak memory begins with that of its parent.

On Linux it adopts the command's processes whose parents have ended, whatever session or group they are in, and ends
them too; where it may make a cgroup (version 2), they are ended by that as well, at once. On macOS it ends the
command's process group alone. On Windows, where Python has no module `resource`, it and the command are a job, which
ends as a whole when the guard does; a request to end is an end at once there.

At the end it prints JSON: status (the exit status, negative for a signal), ended ("itself", "limit", "asked",
"missing", or "over": it went over one of the limits), seconds, processor_s, peak_memory_bytes, problem.
"""

import contextlib
import ctypes
import errno
import json
import os
import signal
import stat
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, BinaryIO, Protocol

try:
    import resource
except ImportError:  # on Windows
    resource = None

POLL_S = 0.05
PIECE = 65536
LEFT_IN_PIPE_S = 2.0  # chosen: a pipe holds 1 MiB at most, and a process that is left may keep it open
MARK = "NOISY_WORLD_RUN"  # an environment variable that tells a run's processes
LEAST_FREE_BYTES = 512 * 2**20  # of the disk; chosen: what is written after a run is far less
LOOK_S = 0.5  # between two looks at all files and processes; longer where a look takes long
LOOKS_SHARE = 20  # so many times as long as a look takes is the time until the next
DEEPEST = 64  # folders in each other
SET_CHILD_SUBREAPER = 36  # <sys/prctl.h>
FIRST_FOR_MEMORY = "1000"  # where memory ends, Linux ends the process with the highest number
ENDING_S = 10.0  # how long a process may take to die


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
        self._put(head)
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
            self._put(f"\n[{self._dropped} bytes are left out here]\n".encode())
        for data in self._tail:
            self._put(data)
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, data: bytes) -> None:
        with contextlib.suppress(OSError):  # the system has filled the disk: that is told, and the log is shorter
            self._file.write(data)
            self._file.flush()


class ResourceLimits:
    """What a command may take, and how much it has taken.

    Of an order's `limits`, all whole numbers: written_bytes and files (in the folders that count), processes (at once),
    memory_bytes (of all processes together, resident; null for any).
    """

    def __init__(self, limits: dict[str, Any], folders: list[str]) -> None:
        """Take the limits. folders: what is written into them counts."""
        self._limits = limits
        self._folders = folders
        self._next_s = 0.0
        # A disk that is nearly full from the start is not the system's doing.
        self._least_free = min(LEAST_FREE_BYTES, self._free_bytes() // 2)

    def problem(self, processes: "Taking", *, now: bool = False) -> str:
        """Return which limit is passed; "" for none. now: look at all files, though it was just done."""
        if self._free_bytes() < self._least_free:
            return f"left less than {self._least_free / 1e6:.0f} MB of the disk free"
        if not now and time.monotonic() < self._next_s:
            return ""
        begun_s = time.monotonic()
        problem = self._of_files() or self._of_processes(processes)
        ended_s = time.monotonic()
        self._next_s = ended_s + max(LOOK_S, LOOKS_SHARE * (ended_s - begun_s))
        return problem

    def _free_bytes(self) -> int:
        try:
            if not hasattr(os, "statvfs"):  # on Windows
                import shutil

                return shutil.disk_usage(self._folders[0]).free
            space = os.statvfs(self._folders[0])
        except OSError:  # the system has removed its folder
            return LEAST_FREE_BYTES
        return space.f_bavail * space.f_frsize

    def _of_files(self) -> str:
        most_bytes, most_files = self._limits["written_bytes"], self._limits["files"]
        written, count = 0, 0
        for status, depth in files_below(self._folders):
            on_disk = status.st_blocks * 512 if hasattr(status, "st_blocks") else status.st_size
            written, count = written + on_disk, count + 1
            if written > most_bytes:
                return f"wrote more than the {most_bytes / 1e9:g} GB of limits.written_gb"
            if count > most_files:
                return f"wrote more files than the {most_files} of limits.files"
            if depth > DEEPEST:
                return f"made more than {DEEPEST} folders in each other"
        return ""

    def _of_processes(self, processes: "Taking") -> str:
        most, most_bytes = self._limits["processes"], self._limits["memory_bytes"]
        count, taken_bytes = processes.taken()
        if count > most:
            return f"started more processes than the {most} of limits.processes"
        if most_bytes is not None and taken_bytes > most_bytes:
            return f"took more memory than the {most_bytes / 1e9:g} GB of limits.memory_gb"
        return ""


class Taking(Protocol):
    """Processes that take something."""

    def taken(self) -> tuple[int, int]:
        """Return how many processes a command has, and how many bytes of memory they take."""
        ...


def files_below(folders: list[str]) -> Iterator[tuple[os.stat_result, int]]:
    """Yield what is in folders and in those in them, and how deep it lies; links are not followed."""
    waiting = [(folder, 1) for folder in folders]
    while waiting:
        above, depth = waiting.pop()
        try:
            with os.scandir(above) as entries:
                for entry in entries:
                    status = entry.stat(follow_symlinks=False)
                    yield status, depth
                    if stat.S_ISDIR(status.st_mode):
                        waiting.append((entry.path, depth + 1))
        except OSError as error:  # it is gone, or forbidden; or too deep for a name
            if error.errno == errno.ENAMETOOLONG:
                yield os.lstat("/"), DEEPEST + 1


class CommandProcesses:
    """The processes of a command: those below this one and, where there is one, those in its cgroup."""

    def __init__(self, largest: int) -> None:
        """Adopt the command's processes, and make a cgroup for them, where the system has these.

        largest: bytes of a file that they write.
        """
        self._largest = largest
        self._cgroup = ""
        self.popen: dict[str, Any] = {"start_new_session": True, "preexec_fn": self.enter}  # before any thread is
        if not sys.platform.startswith("linux"):
            return
        ctypes.CDLL(None, use_errno=True).prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        with contextlib.suppress(OSError):  # most users may make none
            folder = f"{own_cgroup()}/noisy-world-{os.getpid()}"
            os.mkdir(folder)  # noqa: PTH102
            self._cgroup = folder

    def enter(self) -> None:
        """Begin a command: what its process does first."""
        assert resource is not None
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (self._largest, self._largest))
        if sys.platform.startswith("linux"):
            with contextlib.suppress(OSError):
                _write("/proc/self/oom_score_adj", FIRST_FOR_MEMORY)
        if self._cgroup:
            with contextlib.suppress(OSError):
                _write(f"{self._cgroup}/cgroup.procs", "0")

    def taken(self) -> tuple[int, int]:
        """Return how many processes there are, and their resident bytes."""
        resident = self.below()
        return len(resident), sum(resident.values())

    def below(self) -> dict[int, int]:
        """Return the processes below this one, by their numbers, with their resident bytes. {} where /proc is not."""
        parents, resident = {}, {}
        page = os.sysconf("SC_PAGE_SIZE")
        for pid, fields in running():
            if fields[0] != "Z":
                resident[pid] = max(int(fields[21]), 0) * page
            parents[pid] = int(fields[1])
        reached = {os.getpid()}
        children: dict[int, list[int]] = {}
        for pid, parent in parents.items():
            children.setdefault(parent, []).append(pid)
        waiting = [os.getpid()]
        while waiting:
            of_one = [pid for pid in children.get(waiting.pop(), []) if pid not in reached]
            reached.update(of_one)
            waiting += of_one
        return {pid: resident[pid] for pid in reached if pid in resident and pid != os.getpid()}

    @staticmethod
    def has_ended(process: subprocess.Popen) -> bool:
        """Tell whether the command has ended, which is not reaped yet."""
        return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def ask(self, process: subprocess.Popen, grace_s: float) -> None:
        """Ask the command's group to end, and wait for the command."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGTERM)
        until = time.monotonic() + grace_s
        while time.monotonic() < until and not self.has_ended(process):
            time.sleep(POLL_S)

    def end(self, process: subprocess.Popen) -> tuple[int, float | None, int | None]:
        """End what is left; return the exit status, processor seconds, and the most bytes that one process took."""
        self._kill(process.pid)
        status, spent = reap(process.pid)
        scale = 1 if sys.platform == "darwin" else 1024
        processor_s = sum(one.ru_utime + one.ru_stime for one in spent)
        return status, processor_s, max(one.ru_maxrss for one in spent) * scale

    def _kill(self, leader: int) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses a group that is a zombie alone
            os.killpg(leader, signal.SIGKILL)
        until = time.monotonic() + ENDING_S
        while True:
            if self._cgroup:
                with contextlib.suppress(OSError):
                    _write(f"{self._cgroup}/cgroup.kill", "1")
            left = self.below()
            for number in (signal.SIGSTOP, signal.SIGKILL):  # stopped first, they start no others meanwhile
                for pid in left:
                    with contextlib.suppress(ProcessLookupError, PermissionError):
                        os.kill(pid, number)
            if not left or time.monotonic() > until:
                break
            time.sleep(0.005)

    def forget(self) -> None:
        """Remove the cgroup."""
        if self._cgroup:
            with contextlib.suppress(OSError):
                os.rmdir(self._cgroup)  # noqa: PTH106


class BasicLimits(ctypes.Structure):
    """JOBOBJECT_BASIC_LIMIT_INFORMATION of Windows' winnt.h."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("process_time", "job_time")),
        ("flags", ctypes.c_uint32),
        *((name, ctypes.c_size_t) for name in ("least_working_set", "most_working_set")),
        ("active_processes", ctypes.c_uint32),
        ("affinity", ctypes.c_size_t),
        *((name, ctypes.c_uint32) for name in ("priority_class", "scheduling_class")),
    )


class ExtendedLimits(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION."""

    _fields_ = (
        ("basic", BasicLimits),
        ("input_output", ctypes.c_uint64 * 6),
        *((name, ctypes.c_size_t) for name in ("process_memory", "job_memory", "peak_of_one", "peak_of_job")),
    )


class Accounting(ctypes.Structure):
    """JOBOBJECT_BASIC_ACCOUNTING_INFORMATION; times in units of 100 ns."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("user", "kernel", "period_user", "period_kernel")),
        *((name, ctypes.c_uint32) for name in ("page_faults", "processes", "active", "terminated")),
    )


_ACCOUNTING, _EXTENDED_LIMITS, _KILL_ON_JOB_CLOSE = 1, 9, 0x2000  # winnt.h


class WindowsJob:
    """This process and all that it starts, as a job of Windows, which ends as a whole when this process does.

    Where there are no jobs it knows nothing of them.
    """

    def __init__(self) -> None:
        """Make the job, and enter it: what is started from now on is in it from its first moment."""
        self._handle: int | None = None
        self.popen: dict[str, Any] = {}
        library = getattr(ctypes, "WinDLL", None)
        if library is None:
            return
        self._kernel = library("kernel32")
        handle, number, structure = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_void_p
        for name, result, arguments in (
            ("CreateJobObjectW", handle, [ctypes.c_void_p, ctypes.c_wchar_p]),
            ("GetCurrentProcess", handle, []),
            ("AssignProcessToJobObject", ctypes.c_int, [handle, handle]),
            ("SetInformationJobObject", ctypes.c_int, [handle, ctypes.c_int, structure, number]),
            ("QueryInformationJobObject", ctypes.c_int, [handle, ctypes.c_int, structure, number, ctypes.c_void_p]),
        ):
            function = getattr(self._kernel, name)
            function.restype, function.argtypes = result, arguments
        made = self._kernel.CreateJobObjectW(None, None)
        limits = ExtendedLimits()
        limits.basic.flags = _KILL_ON_JOB_CLOSE
        if (
            made
            and self._kernel.SetInformationJobObject(
                made, _EXTENDED_LIMITS, ctypes.byref(limits), ctypes.sizeof(limits)
            )
            and self._kernel.AssignProcessToJobObject(made, self._kernel.GetCurrentProcess())
        ):
            self._handle = made

    def taken(self) -> tuple[int, int]:
        """Return how many processes there are beside this one, and the most bytes of memory that all took at once."""
        if self._handle is None:
            return 0, 0
        accounting, limits = self._asked()
        return max(0, accounting.active - 1), limits.peak_of_job

    def spent(self) -> tuple[float | None, int | None]:
        """Return the processor's seconds and the most bytes of memory that the job took; None where none tells."""
        if self._handle is None:
            return None, None
        accounting, limits = self._asked()
        return (accounting.user + accounting.kernel) * 1e-7, limits.peak_of_job

    @staticmethod
    def has_ended(process: subprocess.Popen) -> bool:
        """Tell whether the command has ended."""
        return process.poll() is not None

    def ask(self, process: subprocess.Popen, grace_s: float) -> None:
        """Do nothing: a request to end is an end at once."""

    def end(self, process: subprocess.Popen) -> tuple[int, float | None, int | None]:
        """End the command; return its exit status and what the job took. What it left ends with this process."""
        process.kill()
        return process.wait(), *self.spent()

    def forget(self) -> None:
        """Do nothing: the job ends with this process."""

    def _asked(self) -> tuple[Accounting, ExtendedLimits]:
        structures = Accounting(), ExtendedLimits()
        for number, each in zip((_ACCOUNTING, _EXTENDED_LIMITS), structures, strict=True):
            self._kernel.QueryInformationJobObject(self._handle, number, ctypes.byref(each), ctypes.sizeof(each), None)
        return structures


def own_cgroup() -> str:
    """Return the folder of the cgroup, version 2, of this process. Raises OSError where there is none."""
    with open("/proc/self/mountinfo", encoding="utf-8") as file:  # noqa: PTH123
        mounts = [line.split() for line in file]
    with open("/proc/self/cgroup", encoding="utf-8") as file:  # noqa: PTH123
        own = next((line[3:].strip() for line in file if line.startswith("0::")), None)
    mounted = next((words[4] for words in mounts if words[words.index("-") + 1] == "cgroup2"), None)
    if own is None or mounted is None:
        raise FileNotFoundError("cgroup2")
    return f"{mounted}{own}".rstrip("/")


def running() -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each process, and /proc/PID/stat from the state on. Nothing where there is no /proc."""
    with contextlib.suppress(FileNotFoundError):
        for name in os.listdir("/proc"):  # noqa: PTH208
            if name.isdecimal():
                with contextlib.suppress(OSError):
                    yield int(name), _read(f"/proc/{name}/stat").rpartition(b")")[2].decode().split()


def end_marked(mark: str) -> None:
    """End the processes that were started with a mark: where the guard that had them was ended itself."""
    wanted = f"{MARK}={mark}".encode()
    until = time.monotonic() + ENDING_S
    while time.monotonic() < until:
        left = False
        for pid, fields in running():
            with contextlib.suppress(OSError):
                if fields[0] != "Z" and pid != os.getpid() and wanted in _read(f"/proc/{pid}/environ").split(b"\0"):
                    left = True
                    os.kill(pid, signal.SIGKILL)
        if not left:
            return
        time.sleep(0.005)


def _read(path: str) -> bytes:
    with open(path, "rb") as file:  # noqa: PTH123
        return file.read()


def _write(path: str, text: str) -> None:
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
        file.write(text)


def main(order: dict[str, Any]) -> dict[str, Any]:
    """Carry out an order and return what is to be said."""
    started = time.monotonic()
    logs = [Log(order[name], order["log_bytes"]) for name in ("log", "errors") if order[name]]
    limits = ResourceLimits(order["limits"], order["counted"])
    largest = order["limits"]["written_bytes"]
    processes = WindowsJob() if resource is None else CommandProcesses(largest)
    try:
        process = subprocess.Popen(  # noqa: S603 - what the user's definition says
            order["command"],
            cwd=order["folder"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE if order["errors"] else subprocess.STDOUT,
            **processes.popen,
        )
    except OSError as error:
        processes.forget()
        for log in logs:
            log.close()
        return {"ended": "missing", "problem": f"{error.filename or order['command'][0]}: {error.strerror}"}
    asked, news = threading.Event(), threading.Event()
    threading.Thread(target=wait_for_the_end_of_input, args=(asked, news), daemon=True).start()
    pipes = [pipe for pipe in (process.stdout, process.stderr) if pipe is not None]
    pairs = zip(pipes, logs, strict=True)
    copying = [threading.Thread(target=copy, args=(pipe, log, news), daemon=True) for pipe, log in pairs]
    for thread in copying:
        thread.start()
    until = started + order["limit_s"]
    ended, problem = attend(process, until, limits, processes, asked=asked, news=news)
    if ended in ("limit", "asked"):
        processes.ask(process, order["grace_s"])
    status, processor_s, peak_bytes = processes.end(process)
    for thread, log in zip(copying, logs, strict=True):
        thread.join(LEFT_IN_PIPE_S)
        log.close()
    processes.forget()
    if ended == "itself" and (problem := limits.problem(processes, now=True)):
        ended = "over"
    if ended == "itself" and resource is not None and status == -signal.SIGXFSZ:
        ended, problem = "over", f"wrote a file of more than the {largest / 1e9:g} GB of limits.written_gb"
    return {
        "status": status,
        "ended": ended,
        "seconds": time.monotonic() - started,
        "processor_s": processor_s,
        "peak_memory_bytes": peak_bytes,
        "problem": problem,
    }


def attend(
    process: subprocess.Popen,
    until: float,
    limits: ResourceLimits,
    processes: CommandProcesses | WindowsJob,
    *,
    asked: threading.Event,
    news: threading.Event,
) -> tuple[str, str]:
    """Wait until a process ends by itself or has to; return which, and which limit it went over.

    news: is set when a process says no more, so that its end is seen at once.
    """
    while True:
        news.wait(POLL_S)
        news.clear()
        if asked.is_set():
            return "asked", ""
        if processes.has_ended(process):
            return "itself", ""
        if time.monotonic() > until:
            return "limit", ""
        if problem := limits.problem(processes):
            return "over", problem


def reap(leader: int) -> tuple[int, list[Any]]:
    """Wait for a process; return its exit status, negative for a signal, and what it and all adopted ones took."""
    _, status, of_leader = os.wait4(leader, 0)
    spent = [of_leader]
    with contextlib.suppress(ChildProcessError):
        while (adopted := os.wait4(-1, os.WNOHANG))[0]:
            spent.append(adopted[2])
    return os.waitstatus_to_exitcode(status), spent


def wait_for_the_end_of_input(ended: threading.Event, news: threading.Event) -> None:
    """Set events when standard input ends; by its number, as Python's own object is locked while it is read."""
    with contextlib.suppress(OSError):
        while os.read(0, PIECE):
            pass
    ended.set()
    news.set()


def copy(output: BinaryIO, log: Log, news: threading.Event) -> None:
    """Write to a log what a pipe holds, to its end, and set an event then."""
    with contextlib.suppress(OSError, ValueError):
        while data := os.read(output.fileno(), PIECE):
            log.write(data)
    news.set()


if __name__ == "__main__":
    print(json.dumps(main(json.loads(sys.argv[1]))))  # noqa: T201 - what it says
