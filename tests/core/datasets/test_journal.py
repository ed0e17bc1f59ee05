# SPDX-License-Identifier: GPL-3.0-or-later
from pathlib import Path

import pytest

from noisy_world.core.frame_table import MOST_OPEN, Journal

OPEN_FILES = Path("/proc/self/fd")


@pytest.mark.skipif(not OPEN_FILES.exists(), reason="needs /proc, which tells how many files are open")
def test_more_journals_than_a_process_may_have_open_files_keep_every_line(tmp_path):
    count, before = 3 * MOST_OPEN, len(list(OPEN_FILES.iterdir()))
    journals = [Journal(tmp_path / f"{k}" / "frames") for k in range(count)]
    for frame in range(3):
        for k, journal in enumerate(journals):
            journal.append_line(f"{k} {frame}\n")
        assert len(list(OPEN_FILES.iterdir())) <= before + MOST_OPEN
    for journal in journals:
        journal.close()
    assert len(list(OPEN_FILES.iterdir())) == before
    found = [(tmp_path / f"{k}" / "frames").read_text() for k in range(count)]
    assert found == [f"{k} 0\n{k} 1\n{k} 2\n" for k in range(count)]
