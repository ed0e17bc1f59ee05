# SPDX-License-Identifier: GPL-3.0-or-later
"""Scratch folders: a living process keeps its own, whatever another one sweeps; a killed one leaves none for long."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from refusals import refused

from noisy_world.core import file_access
from noisy_world.core.errors import StorageError
from noisy_world.core.file_access import SCRATCH_PREFIX, ScratchFolder, sweep

HOLD = """
import sys
from pathlib import Path
from noisy_world.core import file_access
file_access.SHARED_MEMORY = Path(sys.argv[1])
folder = file_access.ScratchFolder(1)
(folder.path / "frame.exr").write_bytes(b"pixels")
print(folder.path, flush=True)
sys.stdin.read()
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no locks on folders")


@pytest.fixture
def memory(tmp_path, monkeypatch):
    """A folder in the place of shared memory, and one in that of the disk."""
    memory, disk = tmp_path / "memory", tmp_path / "disk"
    memory.mkdir()
    disk.mkdir()
    monkeypatch.setattr(file_access, "SHARED_MEMORY", memory)
    monkeypatch.setenv("TMPDIR", str(disk))
    monkeypatch.setattr("tempfile.tempdir", None)
    return memory


def holder(memory):
    """Start a process that holds a scratch folder; return it and the folder."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(memory)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    return process, Path(process.stdout.readline().strip())


def end(process):
    process.stdin.close()
    process.stdout.close()
    process.wait(300)


@pytest.mark.parametrize("place", ["memory", "disk"])
def test_the_next_sweeps_what_a_killed_process_left(memory, place):
    parent = memory if place == "memory" else memory.parent / "disk"
    killed, left = holder(memory if place == "memory" else memory / "none")
    living, kept = holder(memory if place == "memory" else memory / "none")
    try:
        assert left.parent == kept.parent == parent
        killed.send_signal(signal.SIGKILL)
        killed.wait(300)
        assert (left / "frame.exr").exists(), "nothing could remove it"
        with_own = ScratchFolder(1)
        assert not left.exists()
        assert (kept / "frame.exr").read_bytes() == b"pixels"
        assert with_own.path.is_dir()
        with_own.remove()
        assert not with_own.path.exists()
        assert kept.is_dir()
    finally:
        end(killed)
        end(living)
    assert list(parent.iterdir()) == [], "a process that ends removes its own"


def test_own_folders_stay(memory):
    first, second = ScratchFolder(1), ScratchFolder(1)
    sweep(memory)
    assert first.path.is_dir()
    assert second.path.is_dir()
    first.remove()
    first.remove()
    second.remove()
    assert list(memory.iterdir()) == []


def test_only_our_folders_are_swept(memory, tmp_path):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "picture").touch()
    (memory / "another").mkdir()
    (memory / f"{SCRATCH_PREFIX}file").touch()
    (memory / f"{SCRATCH_PREFIX}link").symlink_to(theirs)
    (memory / f"{SCRATCH_PREFIX}left").mkdir()
    sweep(memory)
    names = {path.name.removeprefix(SCRATCH_PREFIX) for path in memory.iterdir()}
    assert names == {"another", "file", "link"}
    assert (theirs / "picture").exists()


def test_another_users_folder_stays(memory, monkeypatch):
    (memory / f"{SCRATCH_PREFIX}theirs").mkdir()
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    sweep(memory)
    assert (memory / f"{SCRATCH_PREFIX}theirs").is_dir()


def test_making_and_sweeping_at_the_same_time(memory):
    """A folder that is swept between its making and its locking is made again, so a holder always has its own."""
    done = threading.Event()

    def sweep_on():
        while not done.is_set():
            sweep(memory)

    sweepers = [threading.Thread(target=sweep_on) for _ in range(3)]
    for thread in sweepers:
        thread.start()
    try:
        for _ in range(200):
            folder = ScratchFolder(1)
            (folder.path / "frame.exr").write_bytes(b"pixels")
            assert (folder.path / "frame.exr").read_bytes() == b"pixels"
            folder.remove()
    finally:
        done.set()
        for thread in sweepers:
            thread.join()


def test_without_room_in_memory_it_is_on_the_disk(memory):
    folder = ScratchFolder(1 << 60)
    assert folder.path.parent == memory.parent / "disk"
    folder.remove()


def test_without_locks_there_is_a_folder_and_no_sweeping(memory, monkeypatch):
    def none_here(*_args, **_kwargs):
        raise OSError(37, "No locks available")

    (memory / f"{SCRATCH_PREFIX}left").mkdir()
    monkeypatch.setattr("fcntl.flock", none_here)
    folder = ScratchFolder(1)
    assert folder.path.is_dir()
    assert (memory / f"{SCRATCH_PREFIX}left").is_dir()
    folder.remove()
    assert not folder.path.exists()


def test_nowhere_to_make_one_is_one_line(memory, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.mkdtemp", full)
    refused(ScratchFolder, 1, names=("No space left on device", "TMPDIR"), error=StorageError)


def test_where_no_folder_has_locks_nothing_is_swept_and_one_is_made(memory, monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    (memory / f"{SCRATCH_PREFIX}left").mkdir()
    sweep(memory)
    assert (memory / f"{SCRATCH_PREFIX}left").is_dir()
    folder = ScratchFolder(1)
    assert folder.path.is_dir()
    with file_access.alone_in(memory):
        folder.remove()
    assert not folder.path.exists()


def test_a_scratch_folder_is_in_none_whose_name_is_not_utf8(memory, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(memory / "\udcff"))
    refused(ScratchFolder, 1, names=("not UTF-8", "TMPDIR"), error=StorageError)


@pytest.mark.parametrize(
    ("platform", "inside"),
    [("win32", "local/noisy-world"), ("darwin", "home/Library/Caches/noisy-world"), ("linux", "xdg/noisy-world")],
)
def test_each_system_has_its_place_of_caches(platform, inside, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    found = file_access.private_cache_folder()
    assert found == tmp_path / inside
    assert found.is_dir()


def test_a_name_that_is_not_utf8_is_refused_where_it_stands(tmp_path):
    odd = "room\udcff"
    for text in (odd, f"~/{odd}"):
        refused(file_access.with_home, text, names=("not UTF-8", "rename it"), error=LookupError)
    refused(file_access.utf8_name, tmp_path / odd, names=("not UTF-8", "rename it"))
    document = {"scenes": [{"mesh": "hall.ply"}, {"mesh": odd}]}
    refused(file_access.check_utf8_values, document, "preset.yaml", names=("scenes.1.mesh: ", "rename it"))
    refused(file_access.check_utf8_values, (1, odd), "list.json", names=("list.json: 1: ", "rename it"))
