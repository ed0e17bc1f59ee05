# SPDX-License-Identifier: GPL-3.0-or-later
"""Journals of scenes: what is read of them while they are written, and when they are written again."""

import sys

import pytest
from refusals import refused

from noisy_world.core.errors import StorageError
from noisy_world.core.frame_table import FrameRecord, Journal, Journals, journal_line, journal_path

ONE, TWO, OTHER = "clean/box", "fog/box", "clean/hall"


def record(frame, digest="a"):
    return FrameRecord(frame, 0.5, {f"results/frame{frame}.png": digest * 64})


@pytest.fixture
def work(tmp_path):
    """A working folder with what two processes have written, one of which was killed within a line."""
    first, second = (Journal(journal_path(tmp_path, name, "box")) for name in ("0", "merged-1"))
    first.append_all([(ONE, record(0))])
    first.append_all((TWO, record(frame)) for frame in range(3))
    second.append_all([(ONE, record(1))])
    second.append_line(journal_line(ONE, record(2))[:-20])
    hall = Journal(journal_path(tmp_path, "0", "hall"))
    hall.append_all([(OTHER, record(7))])
    for journal in (first, second, hall):
        journal.close()
    return tmp_path


def frames(journals):
    return {name: sorted(item.frame for item in journals.records(name)) for name in sorted(journals.sequences)}


def test_lines_are_read_once_and_a_torn_one_never(work):
    journals = Journals(work)
    journals.read_on()
    assert frames(journals) == {ONE: [0, 1], OTHER: [7], TWO: [0, 1, 2]}
    again = Journal(journal_path(work, "merged-1", "box"))  # cuts what was torn
    again.append_all([(ONE, record(2, "b"))])
    again.close()
    journals.read_on()
    assert frames(journals)[ONE] == [0, 1, 2]
    assert [item.files for item in journals.records(ONE) if item.frame == 2] == [record(2, "b").files]
    own = Journals(work)
    own.read_on()
    assert frames(own) == frames(journals)


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of files")
def test_a_line_of_which_a_part_is_written_is_an_error(work):
    import resource

    path = journal_path(work, "0", "box")
    journal, limits = Journal(path), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 10, limits[1]))
    try:
        refused(journal.append_all, [(ONE, record(3))], names="no space left", error=StorageError)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        journal.close()


def test_what_is_left_of_a_sequence_counts_instead_of_its_frames(work):
    journals, of_another_process = Journals(work), Journals(work)
    journals.read_on()
    of_another_process.read_on()
    journals.rewrite({ONE: [record(1)], TWO: None}, work)
    for read in (journals, of_another_process, Journals(work)):
        read.read_on()
        assert frames(read) == {ONE: [1], OTHER: [7]}
        assert [name for name in (ONE, TWO, OTHER) if read.instead(name)] == [ONE]
    journals.rewrite({ONE: None, OTHER: None}, work)
    assert list(work.iterdir()) == []


def test_journals_of_earlier_versions_one_for_each_sequence(tmp_path):
    for name in (ONE, TWO):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "journal-0.jsonl").write_text(record(4).line())
    journals = Journals(tmp_path)
    journals.read_on()
    assert frames(journals) == {ONE: [4], TWO: [4]}
    journals.rewrite({ONE: None, TWO: None}, tmp_path)
    assert list(tmp_path.iterdir()) == []
