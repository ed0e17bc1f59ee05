# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished files: of runs that ended, and of files that were given a second name."""

from noisy_world.dataset.folder_state import remove_unfinished
from noisy_world.core.atomic_files import Mover, link_or_copy


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


def test_a_name_given_or_moved_twice_leaves_nothing_behind(tmp_path):
    # POSIX: renaming one name of a file to another name of the same file does nothing, so both would stay.
    scratch = tmp_path / "unfinished"
    scratch.mkdir()
    source, target = tmp_path / "source.png", tmp_path / "target.png"
    source.write_bytes(b"image")
    for _ in range(2):
        link_or_copy(source, target, scratch)
        assert target.samefile(source)
        assert list(scratch.iterdir()) == []
    Mover(scratch).move(source, target)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["target.png", "unfinished"]
    assert target.read_bytes() == b"image"
