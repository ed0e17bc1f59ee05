# SPDX-License-Identifier: GPL-3.0-or-later
"""A plan cut into shards: every source frame in one of them, equally long, the same each time."""

import random

import pytest
from refusals import refused
from cases import cases
from many_settings import SETTINGS
from worlds import write_world

from noisy_world.dataset.shards import Shard, render_of, seconds_of, shards_of
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan


@pytest.fixture
def plan(tmp_path):
    return make_plan(read_preset(write_world(tmp_path, frames=23, size=(40, 32), settings=SETTINGS)))


@cases("count", [1, 2, 3, 7, 10, 46, 1000])
def test_each_source_frame_is_in_one_shard(plan, count):
    shards = shards_of(plan, count)
    frames = [(shard.render, frame) for shard in shards for frame in range(shard.start, shard.stop)]
    assert sorted(frames) == sorted((render.name, frame) for render in plan.renders for frame in render.frames)
    assert len(shards) == min(max(count, 2), 46), "at least one for each render, at most one for each frame"
    assert shards == shards_of(plan, count)
    assert [Shard.parse(shard.name) for shard in shards] == list(shards)


def test_only_what_is_to_be_made_is_cut(plan):
    work = {"box": [2, 3, 5, 17, 18], "box@shaky": []}
    for count in range(1, 8):
        shards = shards_of(plan, count, work)
        assert {shard.render for shard in shards} == {"box"}
        assert [frame for shard in shards for frame in shard.frames_of(work["box"])] == work["box"]
        assert all(shard.frames_of(work["box"])[0] == shard.start for shard in shards)
        assert len(shards) == min(count, 5)


def test_shards_take_equally_long(plan):
    shards = shards_of(plan, 12)
    seconds = seconds_of(plan, shards)
    longest_frame = max(seconds_of(plan, [Shard("box", k, k + 1) for k in range(23)]))
    assert sum(seconds) == pytest.approx(sum(seconds_of(plan, shards_of(plan, 1))))
    box = [value for shard, value in zip(shards, seconds, strict=True) if shard.render == "box"]
    assert len(box) > 8, "the render with eleven settings takes longer than that with one"
    assert max(box) - min(box) <= longest_frame + 1e-12


def test_any_costs_are_cut_into_pieces_that_are_not_empty(plan, monkeypatch):
    import numpy as np

    from noisy_world.dataset import estimate as module

    rng = random.Random(4)
    for _ in range(200):
        costs = [rng.choice([0.0, 1e-9, 1.0, 1e6]) for _ in range(23)]
        monkeypatch.setattr(module, "frame_seconds", lambda _plan, _render, frames, c=costs: np.array(c)[list(frames)])
        shards = shards_of(plan, rng.randint(1, 50))
        frames = [(shard.render, frame) for shard in shards for frame in range(shard.start, shard.stop)]
        assert sorted(frames) == sorted((render.name, frame) for render in plan.renders for frame in render.frames)


@cases(
    "name", ["", "box", "box.0-1", "box.000001-000001", "box.000002-000001", "box.0000001-000002", "box.00000a-000001"]
)
def test_what_is_no_name_of_a_shard(name):
    refused(Shard.parse, name, names="is no shard", error=ValueError)


@cases("shard", [Shard("a.b", 0, 1), Shard("room0@fast.2", 999_999, 1_000_000), Shard("box", 0, 12_345_678)])
def test_names_are_read_back(shard):
    assert Shard.parse(shard.name) == shard


def test_long_names_of_scenes_and_settings_make_folders_that_disks_hold():
    long = [Shard(f"{'s' * 200}@{'t' * 200}", start, start + 1) for start in range(3)]
    assert len({shard.folder_name for shard in long}) == 3
    assert max(len(shard.folder_name) for shard in long) <= 200


def test_a_shard_of_another_plan_is_one_line(plan):
    refused(
        render_of,
        plan,
        Shard("bix", 0, 1),
        names=("bix.000000-000001", "'box'"),
    )
    refused(
        render_of,
        plan,
        Shard("box", 23, 30),
        names=("0 to 22", "box.000023-000030"),
    )
