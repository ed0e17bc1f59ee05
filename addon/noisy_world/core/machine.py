# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts about the machine and this process."""

import ctypes
import os
import sys
from functools import cache
from pathlib import Path

from .regular_files import read_text

_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3  # malloc.h of glibc


def processor_features() -> list[str]:
    """Return the instruction sets by which numpy chooses its loops; float32 exp, log and sin differ between them."""
    from numpy._core._multiarray_umath import __cpu_features__  # noqa: PLC0415 - as numpy.show_runtime does

    return sorted(name for name, there in __cpu_features__.items() if there)


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of this process so far; None where the system does not report it."""
    if sys.platform == "win32":
        return None
    status = Path("/proc/self/status")
    if status.exists():  # on Linux, getrusage includes the process that started this one
        (line,) = [line for line in read_text(status).splitlines() if line.startswith("VmHWM:")]
        return int(line.split()[1]) * 1024
    import resource  # noqa: PLC0415 - not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def available_threads() -> int:
    """Return how many threads this process may run at once."""
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
