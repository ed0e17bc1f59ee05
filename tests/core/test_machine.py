# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process tells of itself."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from forked import in_new_process
from worlds import ROOT

from noisy_world.core.machine import (
    available_threads,
    end_opencv_threads_before_forks,
    keep_freed_memory,
    peak_memory_bytes,
    processor_features,
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
