# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process tells of itself."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from forked import in_new_process
from worlds import ROOT

from noisy_world.core import machine
from noisy_world.core.machine import (
    allow_processor,
    available_threads,
    end_opencv_threads_before_forks,
    free_memory_bytes,
    held_memory_bytes,
    keep_freed_memory,
    limit_process,
    limit_threads,
    peak_memory_bytes,
    processor_features,
    thread_variables,
)

TELL = """
import sys
sys.path.insert(0, sys.argv[1])
from noisy_world.core.machine import available_threads, keep_freed_memory, peak_memory_bytes, processor_features
print(peak_memory_bytes())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="not told on Windows")
def test_the_peak_is_this_process_s_own_and_stays():
    before = peak_memory_bytes()
    block = np.ones(40_000_000)  # 320 MB
    during = peak_memory_bytes()
    del block
    assert during - before > 200e6 or before > 320e6
    assert peak_memory_bytes() > during - 5e6  # the system counts in batches
    told = subprocess.run([sys.executable, "-c", TELL, str(ROOT / "addon")], capture_output=True, text=True, check=True)
    assert 5e6 < int(told.stdout) < 100e6  # though the process that started it has used more


@pytest.mark.skipif(sys.platform == "win32", reason="no resource module on Windows")
def test_each_system_tells_its_peak_in_its_own_unit(monkeypatch):
    import resource

    usage = SimpleNamespace(ru_maxrss=5000)
    monkeypatch.setattr(resource, "getrusage", lambda _: usage)
    monkeypatch.setattr(Path, "exists", lambda _: False)  # no /proc
    for platform, expected in (("darwin", 5000), ("freebsd14", 5000 * 1024), ("win32", None)):
        monkeypatch.setattr(sys, "platform", platform)
        assert peak_memory_bytes() == expected, platform


def test_threads_and_features_are_there_and_keeping_memory_changes_no_result():
    assert 1 <= available_threads() <= (os.cpu_count() or 1)
    assert processor_features() == sorted(set(processor_features()))
    keep_freed_memory()
    assert np.ones(1_000_000).sum() == 1_000_000


def threads_at_a_fork():
    """How many threads there are when OpenCV works, and at a fork; how many it may have after that, here and there."""
    import cv2

    def count():
        return len(list(Path("/proc/self/task").iterdir()))

    seen, image = [], np.zeros((1000, 1000, 3), np.float32)
    os.register_at_fork(before=lambda: seen.append(count()))  # such functions are called last first
    end_opencv_threads_before_forks()
    cv2.setNumThreads(4)
    cv2.warpAffine(image, np.eye(2, 3), (1000, 1000))
    seen.append(count())
    child = os.fork()
    if child == 0:
        cv2.warpAffine(image, np.eye(2, 3), (1000, 1000))
        os._exit(cv2.getNumThreads())
    return *seen, cv2.getNumThreads(), os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc, which tells how many threads there are")
def test_opencv_s_threads_have_ended_when_a_process_forks():
    busy, forking, here, child = in_new_process(threads_at_a_fork)
    assert (forking, here, child) == (busy - 3, 4, 4)


GB = 10**9


def written(folder, files):
    """Write files of /proc and /sys into a folder; return it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


MACHINE = {"proc/meminfo": f"MemTotal: 32000000 kB\nMemAvailable: {20 * GB // 1024} kB\nSwapFree: 0 kB\nHugePages: 0\n"}
# Documentation/admin-guide/cgroup-v2.rst and cgroup-v1/memory.rst of Linux.
GROUPS = {
    "none": ({}, 20),
    "version 2": (
        {
            "proc/self/cgroup": "0::/job/step\n",
            "sys/fs/cgroup/job/step/memory.max": "max\n",
            "sys/fs/cgroup/job/step/memory.current": f"{GB}\n",
            "sys/fs/cgroup/job/memory.max": f"{8 * GB}\n",
            "sys/fs/cgroup/job/memory.current": f"{5 * GB}\n",
            "sys/fs/cgroup/job/memory.stat": f"anon {2 * GB}\nactive_file {GB}\ninactive_file {GB}\n",
        },
        4,  # 8 GB, of which 5 are used, one of them by a cache that is dropped where memory is needed
    ),
    "version 2, the group's own root": (
        {
            "proc/self/cgroup": "0::/\n",
            "sys/fs/cgroup/memory.max": f"{3 * GB}\n",
            "sys/fs/cgroup/memory.current": f"{GB}\n",
        },
        2,
    ),
    "version 1": (
        {
            "proc/self/cgroup": "5:cpu,cpuacct:/docker/a\n4:memory:/docker/a\n",
            "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{6 * GB}\n",  # what a container sees
            "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{3 * GB}\n",
            "sys/fs/cgroup/memory/memory.stat": f"inactive_file 0\ntotal_inactive_file {2 * GB}\n",
        },
        5,
    ),
    "more than there is": (
        {
            "proc/self/cgroup": "4:memory:/\n",
            "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
            "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{3 * GB}\n",
        },
        20,
    ),
    "over its limit": (
        {
            "proc/self/cgroup": "0::/\n",
            "sys/fs/cgroup/memory.max": f"{GB}\n",
            "sys/fs/cgroup/memory.current": f"{2 * GB}\n",
        },
        0,
    ),
}


@pytest.mark.skipif(sys.platform != "linux", reason="the files are Linux's")
@pytest.mark.parametrize("name", GROUPS)
def test_free_memory_is_the_least_of_the_machines_and_of_its_groups(name, tmp_path):
    files, free_gb = GROUPS[name]
    assert free_memory_bytes(written(tmp_path, MACHINE | files)) == pytest.approx(free_gb * GB, abs=1024)


@pytest.mark.skipif(sys.platform != "linux", reason="the files are Linux's")
def test_free_memory_is_within_the_limit_of_address_space(tmp_path, monkeypatch):
    import resource

    monkeypatch.setattr(resource, "getrlimit", lambda which: (9 * GB if which == resource.RLIMIT_AS else 1, -1))
    root = written(tmp_path, MACHINE | {"proc/self/status": f"Name: python\nVmSize: {2 * GB // 1024} kB\n"})
    assert 9 * GB - 2 * GB - 2 * GB < free_memory_bytes(root) <= 9 * GB - 2 * GB  # less what threads only map


@pytest.mark.skipif(sys.platform != "linux", reason="the files are Linux's")
@pytest.mark.skipif(shutil.which("free") is None, reason="the program free is not here")
def test_free_memory_is_as_free_tells():
    told = subprocess.run(["free", "-b"], capture_output=True, text=True, check=False)
    available = int(told.stdout.splitlines()[1].split()[6])
    assert 0 < free_memory_bytes() <= available + 2 * GB  # others take and give back meanwhile


@pytest.fixture
def limits(monkeypatch):
    """Limits of a process that are set nowhere: soft and hard by what they limit."""
    resource = pytest.importorskip("resource")
    infinite = resource.RLIM_INFINITY
    held = {resource.RLIMIT_CPU: (infinite, infinite), resource.RLIMIT_AS: (infinite, infinite)}
    monkeypatch.setattr(resource, "getrlimit", held.__getitem__)
    monkeypatch.setattr(resource, "setrlimit", held.__setitem__)
    return held


def test_a_limit_of_a_process_is_only_lowered_and_raised_within_what_it_may(limits):
    from resource import RLIM_INFINITY, RLIMIT_AS, RLIMIT_CPU

    allow_processor(7)
    assert limits[RLIMIT_CPU] == (RLIM_INFINITY, RLIM_INFINITY)  # no limit, and none comes of it
    limit_process(5)
    assert limits[RLIMIT_CPU] == (5, RLIM_INFINITY)
    if sys.platform == "linux":
        assert held_memory_bytes() < limits[RLIMIT_AS][0] < 2**60
        assert limits[RLIMIT_AS][1] == RLIM_INFINITY
    limit_process(60)
    assert limits[RLIMIT_CPU] == (5, RLIM_INFINITY)
    allow_processor(7)
    assert limits[RLIMIT_CPU] == (12, RLIM_INFINITY)
    limits[RLIMIT_CPU] = (12, 15)
    allow_processor(7)
    assert limits[RLIMIT_CPU] == (15, 15)


def test_without_the_module_of_limits_none_changes(limits, monkeypatch):
    before = dict(limits)
    monkeypatch.setitem(sys.modules, "resource", None)
    limit_process(5)
    allow_processor(5)
    assert limits == before


def test_a_process_that_was_split_off_runs_the_threads_it_was_given(monkeypatch):
    monkeypatch.setattr(machine, "_LIMIT", [])
    whole = available_threads()
    limit_threads(1)
    assert available_threads() == 1
    limit_threads(10**6)
    assert available_threads() == whole  # the system's limit stays
    assert set(thread_variables(3).values()) == {"3"}
    assert {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} < set(thread_variables(3))


def test_an_older_python_counts_the_processors_of_its_process_where_the_system_tells_them(monkeypatch):
    monkeypatch.setattr(machine, "_LIMIT", [])
    monkeypatch.setattr(sys, "version_info", (3, 11, 0))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 3, 5}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 11)
    for platform, count in (("linux", 3), ("darwin", 11)):
        monkeypatch.setattr(sys, "platform", platform)
        assert available_threads() == count
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert available_threads() == 1


def test_opencv_has_one_thread_at_a_fork_and_its_own_number_after_it(monkeypatch):
    hooks, threads = {}, [4]
    opencv = SimpleNamespace(getNumThreads=lambda: threads[-1], setNumThreads=threads.append)
    monkeypatch.setitem(sys.modules, "cv2", opencv)
    monkeypatch.setattr(os, "register_at_fork", lambda **given: hooks.update(given), raising=False)
    end_opencv_threads_before_forks.__wrapped__()
    hooks["before"]()
    assert threads[-1] == 1
    hooks["after_in_parent"]()
    assert threads == [4, 1, 4]
    hooks["after_in_child"]()  # nothing is left to put back
    assert threads == [4, 1, 4]
    monkeypatch.delitem(sys.modules, "cv2")
    hooks["before"]()
    hooks["after_in_parent"]()
    assert threads == [4, 1, 4]


@pytest.mark.skipif(sys.platform == "win32", reason="no sysconf on Windows")
def test_free_memory_where_the_system_has_no_such_files(limits, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sysconf", {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}.__getitem__)
    for platform, free in (("darwin", 4_096_000), ("freebsd14", None), ("win32", None)):
        monkeypatch.setattr(sys, "platform", platform)
        assert free_memory_bytes(tmp_path) == free, platform
