# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands whose standard streams are closed, as a daemon's are, or cannot be written."""

import os
import sys
from pathlib import Path

import pytest
from forked import in_new_process

from noisy_world.cli.entry import exit_status


def with_streams_closed(numbers, folder):
    """Run a command without some streams; return its status, and what stands in a file that it has written."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if number in numbers:
            os.close(number)
            setattr(sys, name, None)  # as Python begins where they are closed

    def work():
        print("the result")
        print("a note", file=sys.stderr)
        assert sys.stdin.read() == "" or 0 not in numbers
        with (folder / "written").open("w") as file:
            file.write("its own content")
            assert file.fileno() > 2
        return 0

    return exit_status(work), (folder / "written").read_text()


@pytest.mark.parametrize("numbers", [(0,), (1,), (2,), (0, 1, 2)])
def test_what_goes_to_a_closed_stream_is_dropped(numbers, tmp_path):
    assert in_new_process(with_streams_closed, numbers, tmp_path) == (0, "its own content")


def with_a_full_disk(said):
    """Run a command whose output goes to a full disk; return its status and what it says."""
    os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT), 2)
    sys.stderr = os.fdopen(2, "w", closefd=False)
    return exit_status(lambda: print("the result") or 0), said.read_text()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_cannot_be_written_is_a_line(tmp_path):
    status, said = in_new_process(with_a_full_disk, tmp_path / "said")
    assert status == 1
    assert said.count("\n") == 1
    assert "standard output" in said


def in_ascii(said):
    """Print what ASCII has no letters for into a file; return its status and content."""
    sys.stdout = said.open("w", encoding="ascii")
    return exit_status(lambda: print("± 5 µm, m\udcff.ply") or 0), said.read_text()


def test_what_an_encoding_lacks_is_escaped(tmp_path):
    status, said = in_new_process(in_ascii, tmp_path / "said")
    assert status == 0
    assert said.encode().decode("unicode_escape").strip() == "± 5 µm, m\udcff.ply"
