# SPDX-License-Identifier: GPL-3.0-or-later
"""Workers for runs of tests: they make their shards in this process, one after another."""

import threading

from noisy_world.core.presets.preset import read_preset
from noisy_world.pipeline.report import Report
from noisy_world.pipeline.shard import ShardMaker, shard_folder
from noisy_world.core.datasets.dataset import Dataset
from noisy_world.planning import make_plan


def workers_here(preset, out, *, frames=None, order=list, asked=None, before=lambda: None):
    """Workers that make a plan of their own from the preset's file, as processes do.

    order: of the shards, as a function of a list. asked: a list that the shards are appended to.
    """

    def make(shards, made, progress):
        before()
        plan, total = make_plan(read_preset(preset), frames), Report()
        with ShardMaker(plan, progress=progress, stop=threading.Event()) as maker:
            for shard in order(list(shards)):
                (asked if asked is not None else []).append(shard)
                there = Dataset(out, plan.format)
                total.add(maker.make(shard_folder(out, shard), shard, there, joining=True).content())
                made(shard)
        return total

    return make
