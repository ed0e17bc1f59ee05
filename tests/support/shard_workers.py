# SPDX-License-Identifier: GPL-3.0-or-later
"""Workers for runs of tests: they make their shards in this process, one after another."""

import threading
from functools import partial

from noisy_world.cli.shard_workers import ShardWorkers, ready_for_shards
from noisy_world.preset.keys import read_preset
from noisy_world.executors.jobs import InProcess
from noisy_world.dataset.plan import make_plan


def workers_here(preset, out, *, frames=None, order=list, asked=None, before=lambda: None):
    """Workers that make a plan of their own from the preset's file, as processes do.

    order: of the shards, as a function of a list. asked: a list that the shards are appended to.
    """

    def make(shards, made, progress):
        before()
        wanted, stop = order(list(shards)), threading.Event()
        (asked if asked is not None else []).extend(wanted)
        here = InProcess(partial(ready_for_shards, stop=stop))
        workers = ShardWorkers(make_plan(read_preset(preset), frames), out, here, stop, merging=True)
        return workers.make(wanted, made, progress)

    return make
