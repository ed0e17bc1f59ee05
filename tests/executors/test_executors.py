# SPDX-License-Identifier: GPL-3.0-or-later
"""One job by every executor of this machine: what is heard of it, and how it ends where a task cannot be done."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from noisy_world.core.errors import InterruptedRunError, NoisyWorldError
from noisy_world.core.errors import INTERRUPTED, REFUSED
from noisy_world.executors.jobs import InProcess, Job, TaskOutcome, Task, TaskQueue, carry_out
from noisy_world.executors.processes import WorkerProcesses

ADDON = str(Path(__file__).resolve().parents[2] / "addon")
WORKER = """
import contextlib, os, signal, sys, threading, time
sys.path.insert(0, {addon!r})
from noisy_world.core.errors import NoisyWorldError
from noisy_world.executors.jobs import work

@contextlib.contextmanager
def ready(order, progress):
    if order == "nothing":
        raise NoisyWorldError("no such scene")

    def perform(name):
        progress.start(name, 2)
        progress.advance(2)
        progress.note(f"{{name}} loads", "hall")
        progress.note("of all")
        if name == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if name == "wrong":
            raise NoisyWorldError("wrong: is not right")
        if name == "waits":
            stop.wait(600)
        return {{"order": order}}

    yield perform

stop = threading.Event()
if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    sys.exit(work(ready, stop))
"""


@pytest.fixture
def executors(tmp_path):
    """Executors, whose tasks are the same: one in this process, and two of two processes, started and split off."""
    path = tmp_path / "program.py"
    path.write_text(WORKER.format(addon=ADDON))
    names = {"__name__": "program"}
    exec(path.read_text(), names)

    def work():
        signal.signal(signal.SIGTERM, lambda *_: names["stop"].set())
        return names["work"](names["ready"], names["stop"], lambda: {"pid": os.getpid()})

    command = [sys.executable, str(path)]
    with WorkerProcesses(command, 2, work) as split:
        yield InProcess(names["ready"]), WorkerProcesses(command, 2), split


class Heard:
    """What a listener hears."""

    def __init__(self):
        self.frames, self.notes = 0, []

    def start(self, label, total, done=0):
        pass

    def advance(self, count):
        self.frames += count

    def note(self, text, subject=""):
        self.notes.append(text)


def job(*names, order="order"):
    return Job("shards", "made", "generate", order, tuple(Task(name, "group") for name in names))


def outcomes(executor, wanted, stop=None):
    done, heard = [], Heard()
    carry_out(wanted, executor, done.append, heard, stop or threading.Event())
    return sorted(done, key=lambda outcome: outcome.name), heard


def test_all_that_is_told_arrives_and_a_note_on_a_subject_once(executors):
    for executor in executors:
        done, heard = outcomes(executor, job("a", "b", "c"))
        assert done == [TaskOutcome(name, report={"order": "order"}) for name in "abc"]
        assert heard.frames == 6
        assert sorted(heard.notes)[1:] == ["of all"]
        assert heard.notes[0] in ("a loads", "b loads", "c loads")


def test_what_cannot_be_done_ends_the_job_with_its_line(executors):
    for executor in executors:
        with pytest.raises(NoisyWorldError, match=r"^wrong: is not right$"):
            outcomes(executor, job("a", "wrong", "waits" if executor.slots > 1 else "b"))
        with pytest.raises(NoisyWorldError, match=r"^no such scene$"):
            outcomes(executor, job("a", order="nothing"))
    ended = []
    executors[1].run(job("a", order="nothing"), print, ended.append, threading.Event())
    assert ended == [TaskOutcome("a", REFUSED, "no such scene")]


# In a process of its own, as one that tests may hold Blender or threads, and such a one is not split.
SPLITTING = """
import os, signal, sys, threading
sys.path.insert(0, {addon!r})
sys.path.insert(0, {folder!r})
import program
from noisy_world.executors.jobs import Job, Task, carry_out
from noisy_world.executors.processes import WorkerProcesses

class Silent:
    def __getattr__(self, _):
        return lambda *_, **__: None

def work():
    signal.signal(signal.SIGTERM, lambda *_: program.stop.set())
    return program.work(program.ready, program.stop, lambda: {{"pid": os.getpid()}})

with WorkerProcesses(["false"], 2, work) as split:
    assert split.kept
    pid = split.ask()["pid"]
    assert pid != os.getpid()
    done = []
    job = Job("shards", "made", "generate", "order", (Task("a", "group"), Task("b", "group")))
    carry_out(job, split, done.append, Silent(), threading.Event())
    assert sorted(outcome.name for outcome in done) == ["a", "b"]
    try:
        os.waitpid(pid, os.WNOHANG)
    except ChildProcessError:
        print("it has ended, and was waited for")
sys.modules["bpy"] = None
with WorkerProcesses(["false"], 2, lambda: 0) as whole:
    assert not whole.kept, "Blender's threads would be missing in the other process"
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are split on Linux alone")
def test_a_worker_that_is_split_off_answers_before_it_has_an_order(tmp_path):
    (tmp_path / "program.py").write_text(WORKER.format(addon=ADDON))
    program = SPLITTING.format(addon=ADDON, folder=str(tmp_path))
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    assert told.returncode == 0, told.stderr
    assert told.stdout == "it has ended, and was waited for\n"


def test_a_worker_that_dies_is_named_by_its_task(executors):
    said = r"^dies: its worker was ended by signal 9, perhaps for want of memory; .* goes on$"
    for executor in executors[1:]:
        with pytest.raises(NoisyWorldError, match=said):
            outcomes(executor, job("waits", "dies"))


def test_stopped(executors):
    for executor in executors:
        stop = threading.Event()
        stop.set()
        with pytest.raises(InterruptedRunError):
            outcomes(executor, job("waits", "a"), stop)


def test_a_worker_whose_parent_is_gone_ends(executors, tmp_path):
    worker = subprocess.Popen(
        [sys.executable, str(tmp_path / "program.py")], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    worker.stdin.write("order\nwaits\n")
    worker.stdin.flush()
    assert "advance" in worker.stdout.readline()
    worker.stdin.close()
    assert worker.wait(300) == INTERRUPTED


def test_neighbours_go_to_one_worker():
    tasks = [Task(f"{group}{k}", group, group[0], 1.0) for group in ("a1", "a2", "b1") for k in range(3)]
    queue = TaskQueue(tuple(tasks))
    given = {0: [], 1: []}
    for turn in (0, 1, 0, 0, 1, 0, 0, 0, 0):
        given[turn].append(queue.next_for(turn).name)
    assert given[0] == ["a10", "a11", "a12", "b10", "b11", "b12", "a22"]  # what is left of the other's, from its end
    assert given[1] == ["a20", "a21"]
    assert queue.next_for(0) is None
    many = TaskQueue(tuple(Task(str(k), "one") for k in range(100_000)))  # in a moment, whoever asks
    assert [many.next_for(k % 2).name for k in range(100_000)][-1] == "50000"
