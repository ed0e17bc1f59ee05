# SPDX-License-Identifier: GPL-3.0-or-later
"""The guard where Python has no `resource`, as on Windows: simulated by forbidding its import, and a false kernel32."""

import ctypes
import json
import os
import runpy
import struct
import subprocess
import sys

import pytest

from noisy_world.evaluate.system_isolation import GUARD, LOG_BYTES

ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
LIMITS = {"written_bytes": 10**6, "files": 100, "processes": 100, "memory_bytes": None}


@pytest.fixture
def guard(monkeypatch):
    """The names of the guard's program without `resource`."""
    monkeypatch.setitem(sys.modules, "resource", None)
    return runpy.run_path(str(GUARD))


def begun(tmp_path, program, **changes):
    """A guard at work on a program of Python; its standard input is open."""
    order = {
        "command": [sys.executable, "-S", "-c", program],
        "folder": str(tmp_path),
        "counted": [str(tmp_path)],
        "log": str(tmp_path / "log.txt"),
        "errors": "",
        "log_bytes": LOG_BYTES,
        "limit_s": 60.0,
        "grace_s": 0.0,
        "limits": LIMITS,
        **changes,
    }
    start = f"import sys, runpy; sys.modules['resource'] = None; runpy.run_path({str(GUARD)!r}, run_name='__main__')"
    words = [sys.executable, "-S", "-c", start, json.dumps(order)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def said(process):
    with process:
        told = json.loads(process.stdout.read())
        process.stdin.close()
    return told


def test_a_command_ends_by_itself(tmp_path):
    told = said(begun(tmp_path, "import sys; print('out'); print('err', file=sys.stderr); sys.exit(3)"))
    assert (told["ended"], told["status"], told["problem"]) == ("itself", 3, "")
    assert sorted((tmp_path / "log.txt").read_text().split()) == ["err", "out"]
    assert told["processor_s"] is told["peak_memory_bytes"] is None  # unknown, where there is no job


def test_a_command_that_takes_too_long_or_too_much_is_ended(tmp_path):
    for name in ("late", "much"):
        (tmp_path / name).mkdir()
    late = begun(tmp_path / "late", "import time; time.sleep(60)", limit_s=0.2)
    much = begun(tmp_path / "much", "import time; open('it', 'wb').write(bytes(2 * 10**6)); time.sleep(60)")
    assert said(late)["ended"] == "limit"
    told = said(much)
    assert told["ended"] == "over"
    assert "limits.written_gb" in told["problem"]
    assert told["seconds"] < 30


def test_it_ends_with_what_asked_for_it_and_names_what_is_missing(tmp_path):
    process = begun(tmp_path, "import time; time.sleep(60)")
    process.stdin.close()
    assert json.loads(process.stdout.read())["ended"] == "asked"
    process.wait()
    process.stdout.close()
    told = said(begun(tmp_path, "", command=[str(tmp_path / "no_such_program")]))
    assert told["ended"] == "missing"
    assert "no_such_program" in told["problem"]


def test_structures_have_the_sizes_of_winnt_h(guard):
    """On 64 bits, as Microsoft's headers give them."""
    assert guard["resource"] is None
    assert ctypes.sizeof(guard["BasicLimits"]) == 64
    assert ctypes.sizeof(guard["ExtendedLimits"]) == 144
    assert ctypes.sizeof(guard["Accounting"]) == 48


class Kernel32:
    """Knows jobs as Windows does; asked, it answers bytes at the places that winnt.h gives their fields."""

    def __init__(self, *, makes_jobs=True):
        self.makes_jobs = makes_jobs
        self.set = {}
        self.inside = []

    def __getattr__(self, name):
        def function(*given):
            return getattr(self, f"_{name}")(*given)

        setattr(self, name, function)  # ctypes' functions take a restype and argtypes
        return function

    def _CreateJobObjectW(self, *_given):
        return 7 if self.makes_jobs else None

    def _GetCurrentProcess(self):
        return 2**64 - 1

    def _SetInformationJobObject(self, job, number, structure, size):
        self.set[job, number] = ctypes.string_at(ctypes.addressof(structure._obj), size)
        return 1

    def _AssignProcessToJobObject(self, job, process):
        self.inside.append((job, process))
        return 1

    def _QueryInformationJobObject(self, job, number, structure, size, _length):
        answer = bytearray(size)
        if number == 1:
            struct.pack_into("<qq", answer, 0, 15_000_000, 5_000_000)  # TotalUserTime, TotalKernelTime: 1.5 and .5 s
            struct.pack_into("<I", answer, 40, 4)  # ActiveProcesses
        else:
            struct.pack_into("<Q", answer, 136, 123_456_789)  # PeakJobMemoryUsed
        ctypes.memmove(ctypes.addressof(structure._obj), bytes(answer), size)
        return 1


def test_all_that_a_command_starts_is_in_a_job_that_ends_with_the_guard(guard, monkeypatch):
    kernel = Kernel32()
    monkeypatch.setattr(ctypes, "WinDLL", lambda name: kernel, raising=False)
    job = guard["WindowsJob"]()
    assert kernel.inside == [(7, 2**64 - 1)]  # this process, before it starts another
    (flags,) = struct.unpack_from("<I", kernel.set[7, 9], 16)
    assert flags == 0x2000  # JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE
    assert job.taken() == (3, 123_456_789)  # without the guard itself
    assert job.spent() == (pytest.approx(2.0), 123_456_789)


def test_a_windows_without_jobs_tells_nothing_of_them(guard, monkeypatch):
    monkeypatch.setattr(ctypes, "WinDLL", lambda name: Kernel32(makes_jobs=False), raising=False)
    job = guard["WindowsJob"]()
    assert job.taken() == (0, 0)
    assert job.spent() == (None, None)


@pytest.mark.long
def test_commands_and_evaluation_can_be_imported_without_what_only_unix_has():
    """And without gtsam, which has no package for Windows."""
    program = """
import importlib, pkgutil, sys
only_unix = {"fcntl", "grp", "pwd", "resource", "syslog", "termios", "gtsam"}
class Forbids:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in only_unix:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Forbids())
for package in ("noisy_world.cli", "noisy_world.evaluate"):
    top = importlib.import_module(package)
    for found in pkgutil.walk_packages(top.__path__, package + "."):
        if not {"programs", "configurations", "__main__"} & set(found.name.split(".")):
            importlib.import_module(found.name)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, env=ENVIRONMENT)
    assert done.returncode == 0, done.stderr
