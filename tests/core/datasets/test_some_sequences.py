# SPDX-License-Identifier: GPL-3.0-or-later
"""What a task looks at of a dataset with many sequences: its own, and no others."""

import pytest

from noisy_world.core.errors import StorageError
from noisy_world.core.frame_table import has_journal
from noisy_world.dataset.folder_state import check_no_links

OWN, OTHER = "clean/hall", "clean/attic"


def test_journals_of_some_sequences(tmp_path):
    (tmp_path / "journal-0.hall.jsonl").write_text('{"sequence": "clean/hall", "frame": 1}\n')
    (tmp_path / "journal-0.attic.jsonl").write_text("")
    assert has_journal(tmp_path)
    assert has_journal(tmp_path, [OWN, "clean/cellar"])
    assert not has_journal(tmp_path, [OTHER])
    assert not has_journal(tmp_path, ())


@pytest.mark.parametrize(
    ("place", "refused"), [("shards/own", True), ("journal-0.hall.jsonl", True), ("shards/other", False)]
)
def test_links_that_matter_to_a_shard(tmp_path, place, refused):
    work = tmp_path / "out/.noisy_world"
    (work / "shards").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    (work / place).parent.mkdir(parents=True, exist_ok=True)
    (work / place).symlink_to(tmp_path / "elsewhere")
    if not refused:
        check_no_links(tmp_path / "out", [OWN], shard=work / "shards/own")
        return
    with pytest.raises(StorageError, match="is a link"):
        check_no_links(tmp_path / "out", [OWN], shard=work / "shards/own")
