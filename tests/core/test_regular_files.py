# SPDX-License-Identifier: GPL-3.0-or-later
"""Files are read through one door, which lets regular files in and nothing that is waited for or never ends."""

import os
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from noisy_world.core import file_access
from noisy_world.images.image_files import read_header
from noisy_world.layouts.asl import read_sensor_yaml
from noisy_world.layouts.stored_recording import recorded_text
from noisy_world.images.video_files import read_video
from noisy_world.core.errors import InputError
from noisy_world.preset.keys import read_preset
from noisy_world.core.file_access import NotRegularError, TooLargeError
from noisy_world.scenes.mesh_files import imported_format
from noisy_world.scenes.textures import read_picture
from noisy_world.trajectories.formats import read_trajectory
from noisy_world.evaluate.system_input import read_index
from noisy_world.evaluate.systems import read_system
from noisy_world.evaluate.cases import read_estimate_file
from noisy_world.trajectories.pose_arrays import load_arrays

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pipes with names")
FORMATS = (
    file_access.read_bytes,
    file_access.read_text,
    file_access.open_regular,
    file_access.open_text,
    file_access.check_regular,
)


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """What is no regular file, by what is said of it."""
    folder = tmp_path_factory.mktemp("s")
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to("pipe")
    bound = socket.socket(socket.AF_UNIX)
    bound.bind(str(folder / "socket"))
    yield {
        folder / "pipe": "it is a pipe, not a file; save what comes out of it as a file, and name that",
        folder / "link": "it is a pipe, not a file; save what comes out of it as a file, and name that",
        folder / "socket": "it is a socket, not a file; name a file",
        "/dev/zero": "it is a device, not a file; name a file",
        folder: "it is a folder, not a file",
    }
    bound.close()


def test_what_is_no_regular_file_is_refused_at_once(others):
    for path, told in others.items():
        for read in FORMATS:
            with pytest.raises((NotRegularError, IsADirectoryError)) as refused:
                read(path)
            assert refused.value.strerror == told, (path, read)


def test_a_refused_file_is_closed(others, tmp_path):
    (tmp_path / "large").write_bytes(b"12345")
    before = os.dup(0)
    os.close(before)
    for path in others:
        with pytest.raises(OSError, match="not a file"):
            file_access.open_regular(path)
    with pytest.raises(TooLargeError):
        file_access.open_regular(tmp_path / "large", largest_bytes=4)
    after = os.dup(0)  # the system gives the lowest number that is free
    os.close(after)
    assert before == after


def test_a_file_is_read_as_it_is(tmp_path):
    data = bytes(np.random.default_rng(3).integers(0, 256, 200_000, dtype=np.uint8))
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_bytes(data)
    link.symlink_to("file")
    assert file_access.read_bytes(path) == file_access.read_bytes(link) == data
    with file_access.open_regular(str(path)) as file:
        assert file.read() == data
    path.write_bytes("\ufeffä 1\r\nb\rc\n".encode())
    assert file_access.read_text(path, encoding="utf-8-sig") == "ä 1\nb\nc\n"
    with file_access.open_text(path) as lines:
        assert list(lines) == ["\ufeffä 1\n", "b\n", "c\n"]
    path.write_bytes(b"a\xff")
    assert file_access.read_text(path, errors="replace") == "a\ufffd"
    with pytest.raises(UnicodeDecodeError):
        file_access.read_text(path)


def test_no_more_is_read_than_the_reader_takes(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert file_access.read_bytes(path, largest_bytes=5) == b"12345"
    with pytest.raises(TooLargeError) as refused:
        file_access.read_bytes(path, largest_bytes=4)
    assert refused.value.strerror == "it has 5 bytes or more; at most 4 are read"
    with path.open("r+b") as sparse:
        sparse.truncate(2**40)  # a terabyte, nothing of which lies on the disk
    for read in (file_access.read_bytes, file_access.read_text):
        with pytest.raises(TooLargeError):
            read(path)
    if sys.platform == "linux":  # a size of 0, and more in it
        with pytest.raises(TooLargeError):
            file_access.read_bytes("/proc/self/status", largest_bytes=10)


def test_a_missing_file_is_what_the_system_says(tmp_path):
    for read in FORMATS:
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "none")


def refusals(path):
    """Yield for each reader of a user's files the line that it refuses this one with."""
    for read in (
        read_preset,
        read_trajectory,
        read_system,
        read_sensor_yaml,
        read_estimate_file,
        read_header,
        recorded_text,
        imported_format,
        read_picture,
        load_arrays,
        read_index,
        read_video,
    ):
        with pytest.raises(InputError) as refused:
            read(path)
        yield str(refused.value)


def test_no_reader_waits_for_a_pipe_or_reads_a_device_for_ever(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for line in refusals(tmp_path / "pipe"):
        assert "is a pipe, not a file; save what comes out of it as a file, and name that" in line
    for line in refusals(Path("/dev/zero")):
        assert "is a device, not a file; name a file" in line
