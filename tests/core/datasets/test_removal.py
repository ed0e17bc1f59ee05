# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished files of runs that ended."""

from noisy_world.core.datasets.removal import remove_unfinished


def test_of_unfinished_files_only_those_of_runs_are_removed(tmp_path):
    scratch = tmp_path / "unfinished"
    scratch.mkdir()
    for name in ("412-0-frame000000.png", "7-31-manifest.json", "mine.txt", "my-own-notes", "12-x-1"):
        (scratch / name).write_text(name)
    (scratch / "5-5-folder").mkdir()
    remove_unfinished(scratch)
    assert sorted(path.name for path in scratch.iterdir()) == ["12-x-1", "5-5-folder", "mine.txt", "my-own-notes"]
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours/1-2-depth.png").write_text("half")
    remove_unfinished(tmp_path / "ours")
    assert not (tmp_path / "ours").exists()
    remove_unfinished(tmp_path / "ours")
