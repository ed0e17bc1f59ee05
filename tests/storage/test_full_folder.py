# SPDX-License-Identifier: GPL-3.0-or-later
"""Publishing into a folder on a disk that is full, and into one that another process writes."""

import contextlib
import errno
import os

import pytest
from refusals import refused
from packed import pack_to, write_preset
from runs import run

from noisy_world.core import atomic_files
from noisy_world.core.errors import BusyError, StorageError
from noisy_world.dataset.store import open_store

pytest.importorskip("pyarrow", reason="pyarrow comes with the extra cloud")
resource = pytest.importorskip("resource", reason="Windows has no such limit")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full")
    run(write_preset(folder, frames=4, scenes=("hall",)), folder / "out")
    return folder / "out"


def files_in(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("limit_bytes", [100, 9_000, 20_000])
def test_a_full_disk_is_a_line_and_it_goes_on_once_there_is_room(dataset, tmp_path, limit_bytes):
    """A write beyond the limit fails, and the end of the file that is flushed then fails again, as on a full disk."""
    pack_to(dataset, tmp_path / "whole/out")
    assert max(map(len, files_in(tmp_path / "whole/out").values())) > limit_bytes
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, before[1]))
    try:
        named = (str(tmp_path / "out"), "no space", "make room")
        refused(pack_to, dataset, tmp_path / "out", names=named, error=StorageError)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    pack_to(dataset, tmp_path / "out")
    assert files_in(tmp_path / "out") == files_in(tmp_path / "whole/out")


class FullDisk:
    """A file that takes nothing, and whose end cannot be written either: buffers are flushed again."""

    def write(self, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self):
        self.write(b"")


def test_a_file_whose_end_cannot_be_written_either_is_one_error(tmp_path, monkeypatch):
    store = open_store(tmp_path)
    monkeypatch.setattr(store, "_opened", lambda name: contextlib.closing(FullDisk()))
    refused(store.write, "a.tar", b"x", names=(f"{tmp_path}/a.tar: ", "no space"), error=StorageError)
    with pytest.raises(KeyError), store.writing("a.tar"):
        raise KeyError  # what ended the writing is what is told


def test_one_process_writes_into_a_folder(dataset, tmp_path):
    with open_store(tmp_path / "out").locked():
        refused(pack_to, dataset, tmp_path / "out", names=(str(tmp_path / "out"), "another run"), error=BusyError)
    assert not (tmp_path / "out").exists()
    assert pack_to(dataset, tmp_path / "out").new
    assert not pack_to(dataset, tmp_path / "out").new
    assert not (tmp_path / "out/.noisy_world").exists()


def test_a_lock_on_a_file_that_was_removed_meanwhile_locks_nothing(tmp_path, monkeypatch):
    path, take, old = tmp_path / "out/lock", atomic_files._try_lock, []

    def taken(descriptor):
        if not old:  # another run has just ended, and one more begun
            old.append(path.rename(tmp_path / "removed"))
            path.touch()
        return take(descriptor)

    monkeypatch.setattr(atomic_files, "_try_lock", taken)
    held = atomic_files.FolderLock(path)
    refused(atomic_files.FolderLock, path, names="another run", error=BusyError)
    held.release()


def test_a_folder_of_somebody_elses_stays_as_it_is(dataset, tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    refused(pack_to, dataset, tmp_path, names=(str(tmp_path), "holds no dataset"), error=StorageError)
    assert list(files_in(tmp_path)) == ["thesis.tex"]
