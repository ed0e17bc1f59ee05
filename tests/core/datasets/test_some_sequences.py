# SPDX-License-Identifier: GPL-3.0-or-later
"""What a task looks at of a dataset with many sequences: its own, and no others."""

import pytest

from noisy_world.dataset.folder_state import journal_folders
from noisy_world.dataset.folder_state import check_no_links
from noisy_world.core.errors import StorageError

OWN, OTHER = "clean/hall", "clean/attic"


def test_journals_of_some_sequences(tmp_path):
    for folder in (OWN, OTHER):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "journal-0.jsonl").write_text("{}\n")
    assert journal_folders(tmp_path) == {OWN, OTHER}
    assert journal_folders(tmp_path, [OWN, "clean/cellar"]) == {OWN}
    assert journal_folders(tmp_path, ()) == frozenset()


@pytest.mark.parametrize(("place", "refused"), [("shards/own", True), (OWN, True), ("shards/other", False)])
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
