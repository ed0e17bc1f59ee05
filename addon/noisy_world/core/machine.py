# SPDX-License-Identifier: GPL-3.0-or-later
"""The machine's processors and memory, work spread over threads, and where the processor's time goes."""

import contextlib
import ctypes
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TypeVar

from .file_access import read_text

_MAPPED_ONLY_BYTES = 10**9  # measured: stacks and arenas of threads, which count as address space and take no memory
_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3  # malloc.h of glibc


def processor_features() -> list[str]:
    """Return the instruction sets by which numpy chooses its loops; float32 exp, log and sin differ between them."""
    from numpy._core._multiarray_umath import __cpu_features__  # as numpy.show_runtime does

    return sorted(name for name, there in __cpu_features__.items() if there)


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of this process so far; None where the system does not report it."""
    if sys.platform == "win32":
        return None
    status = Path("/proc/self/status")
    if status.exists():  # on Linux, getrusage includes the process that started this one
        (line,) = [line for line in read_text(status).splitlines() if line.startswith("VmHWM:")]
        return int(line.split()[1]) * 1024
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


_LIMIT: list[int] = []  # the threads of a process that was split from another


def limit_threads(count: int) -> None:
    """Let this process, whatever the system allows, run so many threads at once."""
    _LIMIT[:] = [count]


def available_threads() -> int:
    """Return how many threads this process may run at once."""
    return min([_system_threads(), *_LIMIT])


def _system_threads() -> int:
    if sys.version_info >= (3, 13):
        return os.process_cpu_count() or 1
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_variables(count: int) -> dict[str, str]:
    """Return the variables of a process's environment that let it and its libraries run so many threads at once."""
    return dict.fromkeys(("PYTHON_CPU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(count))


@cache
def keep_freed_memory() -> None:
    """Let the C library, where it is glibc, keep the memory of freed images for the next ones.

    Otherwise each image's memory goes back to the system, which clears new pages for the next: a fifth of the time of
    Blender's compositor, and up to half that of perturbing an array. Peak memory does not change.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is not None:
        for option, value in ((_M_MMAP_THRESHOLD, 2**30), (_M_TRIM_THRESHOLD, 2**31 - 1), (_M_TOP_PAD, 2**28)):
            mallopt(option, value)


@cache
def end_opencv_threads_before_forks() -> None:
    """Let OpenCV's threads end before this process forks; they begin again in both processes when they are needed.

    Otherwise a child waits for ever for a lock that one of them held at that moment.
    """
    threads: list[int] = []

    def before() -> None:
        if (cv2 := sys.modules.get("cv2")) is not None:
            threads.append(cv2.getNumThreads())
            cv2.setNumThreads(1)  # of all numbers this one alone ends those that there are

    def after() -> None:
        if threads:
            sys.modules["cv2"].setNumThreads(threads.pop())

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=before, after_in_parent=after, after_in_child=after)


def limit_process(processor_s: int) -> None:
    """End this process after so many seconds of a processor, or where it takes more memory than there is.

    It is for a process that reads what somebody gave: a few lines of USD may mean millions of copies. It does nothing
    where the system has no such limits.
    """
    try:
        import resource  # not on Windows
    except ImportError:
        return
    _lower_limit(resource.RLIMIT_CPU, processor_s)
    if (free := free_memory_bytes()) is not None:
        mapped = _fields_kb(Path("/proc/self/status")).get("VmSize", 0) * 1024
        _lower_limit(resource.RLIMIT_AS, mapped + free + _MAPPED_ONLY_BYTES)


def allow_processor(further_s: int) -> None:
    """Allow this process so many more seconds of a processor, where it has a limit that it may raise."""
    try:
        import resource  # not on Windows
    except ImportError:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_CPU)
    if soft != resource.RLIM_INFINITY:
        more = soft + further_s
        resource.setrlimit(resource.RLIMIT_CPU, (more if hard == resource.RLIM_INFINITY else min(more, hard), hard))


def _lower_limit(which: int, limit: int) -> None:
    if sys.platform != "win32":
        import resource  # not on Windows

        soft, hard = resource.getrlimit(which)
        known = [value for value in (soft, hard) if value != resource.RLIM_INFINITY]
        resource.setrlimit(which, (min([limit, *known]), hard))


def free_memory_bytes(system: Path = Path("/")) -> int | None:
    """Return how many bytes of memory this process may still take; None where the system does not report it.

    It is the least of what the machine has free, what its control groups leave it (those of containers and of batch
    systems, versions 1 and 2), and what its limit of address space (`ulimit -v`) does. system: the root of /proc and
    /sys.
    """
    found = [_machine_free_bytes(system), *_groups_free_bytes(system), _address_space_free_bytes(system)]
    known = [value for value in found if value is not None]
    return max(0, min(known)) if known else None


def held_memory_bytes() -> int:
    """Return the resident memory of this process; 0 where the system does not report it."""
    return _fields_kb(Path("/proc/self/status")).get("VmRSS", 0) * 1024


def _machine_free_bytes(system: Path) -> int | None:
    counted = _fields_kb(system / "proc/meminfo")
    if "MemAvailable" in counted:
        return (counted["MemAvailable"] + counted.get("SwapFree", 0)) * 1024
    if sys.platform == "darwin":  # which does not tell what is free in a way that Python knows
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def _address_space_free_bytes(system: Path) -> int | None:
    if sys.platform == "win32":
        return None
    import resource  # not on Windows

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return None
    return limit - _fields_kb(system / "proc/self/status").get("VmSize", 0) * 1024 - _MAPPED_ONLY_BYTES


def _groups_free_bytes(system: Path) -> list[int]:
    """Return what each control group that this process is in, and each above it, leaves its processes."""
    found: list[int] = []
    for line in _lines(system / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        mount = system / "sys/fs/cgroup"
        if "memory" in controllers.split(","):
            mount, names = mount / "memory", ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        elif not controllers:
            names = ("memory.max", "memory.current", "inactive_file")
        else:
            continue
        inside = mount / path.lstrip("/")
        # A container may see its own group where the whole tree would be mounted.
        for folder in (inside, *inside.parents[: len(inside.parts) - len(mount.parts)]):
            free = _group_free_bytes(folder, *names)
            found += [] if free is None else [free]
    return found


def _group_free_bytes(folder: Path, limit: str, usage: str, cached: str) -> int | None:
    """Return what a control group leaves its processes, the files' content that it could drop too; None for any."""
    limits, used = _lines(folder / limit), _lines(folder / usage)
    if not (limits and used and limits[0].isdecimal() and used[0].isdecimal()):  # "max" is no limit
        return None
    words = (line.split() for line in _lines(folder / "memory.stat"))
    dropped = sum(int(value) for name, value in words if name == cached)
    return int(limits[0]) - int(used[0]) + dropped


def _fields_kb(path: Path) -> dict[str, int]:
    """Return the fields of a file of /proc that are in kB, by name."""
    rows = (line.split() for line in _lines(path))
    return {row[0].rstrip(":"): int(row[1]) for row in rows if len(row) == 3 and row[2] == "kB"}


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path).splitlines()
    except (OSError, UnicodeError):
        return []


# Processes items in threads, a few ahead of the consumer, and yields results in order.


Item = TypeVar("Item")
Result = TypeVar("Result")


def done_ahead(
    work: Callable[[Item], Result], items: Iterable[Item], *, threads: int, ahead: int, name: str
) -> Generator[tuple[Item, Result]]:
    """Yield each item with what `work` makes of it, in their order.

    ahead: how many items are begun before the first of them is asked for, so that memory does not grow with their
    number. name: of the threads. An error of `work` is raised where its item would be yielded. When nothing more is
    asked for, items that are not begun are dropped, and those that are begun are waited for.
    """
    waiting: deque[tuple[Item, Future[Result]]] = deque()
    pool = ThreadPoolExecutor(threads, thread_name_prefix=name)
    try:
        for item in items:
            waiting.append((item, pool.submit(work, item)))
            if len(waiting) > ahead:
                done, future = waiting.popleft()
                yield done, future.result()
        while waiting:
            done, future = waiting.popleft()
            yield done, future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


# Batches of an iterable, which Python's itertools has from 3.12.


T = TypeVar("T")


def batched(values: Iterable[T], size: int) -> Iterator[tuple[T, ...]]:
    """Yield the values, in their order, `size` at a time; the last time those that are left."""
    left = iter(values)
    while batch := tuple(islice(left, size)):
        yield batch


# Where the processor's time goes: seconds by stage, summed over threads.


RENDERING = "rendering"
LOADING = "loading"
DECODING = "decoding"
COMPOSITING = "compositing"  # by Blender, in its own threads


class StageTimer:
    """Processor seconds by stage, of what the threads do that say so, and of all else while frames are rendered."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._seconds: dict[str, float] = {}
        self._within = threading.local()  # seconds of this thread that belong to a stage inside another

    @contextlib.contextmanager
    def on(self, stage: str) -> Iterator[None]:
        """Add what this thread does to a stage, but for what goes to a stage inside.

        Threads that it starts itself are not counted.
        """
        start_s, before_s = time.thread_time(), self._inner_s
        self._within.seconds = 0.0
        try:
            yield
        finally:
            whole_s = time.thread_time() - start_s
            self.add({stage: whole_s - self._inner_s})
            self._within.seconds = before_s + whole_s

    @property
    def _inner_s(self) -> float:
        return getattr(self._within, "seconds", 0.0)

    @contextlib.contextmanager
    def rest_on(self, stage: str) -> Iterator[None]:
        """Add what the whole process does to a stage, but for what goes to other stages meanwhile."""
        start_s = time.process_time() - sum(self.seconds.values())
        try:
            yield
        finally:
            self.add({stage: time.process_time() - sum(self.seconds.values()) - start_s})

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add seconds by stage."""
        with self._lock:
            for stage, value in seconds.items():
                self._seconds[stage] = self._seconds.get(stage, 0.0) + value

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage."""
        with self._lock:
            return dict(self._seconds)
