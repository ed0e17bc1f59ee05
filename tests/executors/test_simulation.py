# SPDX-License-Identifier: GPL-3.0-or-later
"""The simulation of a cluster against closed forms: where processors, the disk or merging alone decides."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "headless"))

from bench.cluster_simulation import Cluster, Work, main, merge_seconds, simulate

WORK = Work(core_s=1000.0, files=1000.0, size_bytes=1e9, shards=100, spread=0.0, start_s=0.0)
FREE = Cluster(
    nodes=2, slots=4, cpus=1, disk_bytes_per_s=1e99, disk_files_per_s=1e99, losses_per_hour=0.0,
    merge_bytes_per_s=1e99, merge_file_s=0.0, end_s=0.0,
)  # fmt: skip


def test_processors():
    found = simulate(WORK, FREE)  # 100 shards of 10 s on 8 slots: 13 rounds
    assert found.made_s == found.merged_s == pytest.approx(130)
    assert found.busy == pytest.approx(1000 / (8 * 130))
    assert found.limit == "processors"
    assert simulate(replace(WORK, start_s=5.0), FREE).made_s == pytest.approx(13 * 15)
    assert simulate(WORK, replace(FREE, cpus=2, efficiency=0.5)).made_s == pytest.approx(130 / 1.5)
    assert simulate(WORK, replace(FREE, nodes=100)).made_s == pytest.approx(10)
    assert simulate(WORK, replace(FREE, nodes=100)).limit == "shards"


def test_the_disk():
    found = simulate(WORK, replace(FREE, disk_bytes_per_s=1e6))
    assert found.made_s == pytest.approx(1e9 / 1e6)
    assert (found.limit, found.disk_busy) == ("disk", pytest.approx(1))
    assert simulate(WORK, replace(FREE, disk_files_per_s=2.0)).made_s == pytest.approx(500)


def test_merging():
    slow = replace(FREE, merge_bytes_per_s=1e6, merge_threads=1, merge_file_s=1.0, end_s=7.0, mergers=1)
    found = simulate(WORK, slow)  # from the first shards on, after 10 s, one after another
    assert merge_seconds(WORK, slow) == pytest.approx(1e9 / 1e6 + 1000)
    assert merge_seconds(WORK, replace(slow, merge_threads=4)) == pytest.approx(1e9 / 4e6 + 1000)
    assert found.merged_s == pytest.approx(10 + 2000 + 7)
    assert found.limit == "merging"
    assert simulate(WORK, replace(slow, mergers=20)).merged_s < 240
    # By who makes a shard: 10 s, and 10 s for 1e7 bytes, and 10 s for 10 files; 13 rounds.
    assert simulate(WORK, replace(slow, mergers=0)).merged_s == pytest.approx(13 * (10 + 10 + 10) + 7)


def test_lost_nodes():
    # A slot loses 3600 / 100 = once in 36 s, over 100 shards of 10 s: some 28 times, and what was done is kept.
    found = simulate(WORK, replace(FREE, losses_per_hour=100.0), seed=4)
    assert 15 < found.lost_shards < 45
    assert 125 < found.made_s < 150
    again = simulate(replace(WORK, start_s=5.0), replace(FREE, losses_per_hour=100.0), seed=4)
    assert again.made_s > 13 * 15  # each time it starts anew


def test_the_table(capsys):
    assert main(["--nodes", "1", "1000", "--mergers", "8"]) == 0
    head, line, *rows = capsys.readouterr().out.splitlines()
    assert head.count("|") == line.count("|") == rows[0].count("|") == 9
    assert [row.split(" | ")[0] for row in rows] == ["| 1", "| 1,000"]
