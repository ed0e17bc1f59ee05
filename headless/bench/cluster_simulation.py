# SPDX-License-Identifier: GPL-3.0-or-later
"""What a cluster of many nodes would do with a dataset's shards, simulated from measured figures.

    python headless/bench/cluster_simulation.py [--nodes 1 10 100 1000] [--core-hours H] [--disk GB/s] ...

Shards wait in one queue. A node makes as many at once as its processors allow; while they are made, their files go to
a disk (or an object store) that all share, and whose rates of bytes and of files limit all alike. Shards that are
finished are merged by who made them: every byte is read and hashed, and the file renamed. Or, with `--mergers N`, as
after `noisy-world shard`, they wait for processes that do nothing else. A node may be lost; its shards go back into the
queue with what they had finished.

Printed for each number of nodes: into how many shards the work is best cut, when all of them are made, when they are
merged, the share of the processors' time that went into making, and what the limit was.
"""

import argparse
import heapq
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, TypeAlias

import numpy as np

CUTS = (128, 256, 512, 1024, 2048, 4096, 8192)  # numbers of shards that are tried; the benchmark has 128 renders

Limit: TypeAlias = Literal["processors", "disk", "merging", "shards"]


@dataclass(frozen=True)
class Work:
    """A dataset in shards.

    core_s: what making all of it takes, on one core, without starting processes. files, size_bytes: what is written.
    shards: how many there are; 0 for the best of CUTS. spread: of their durations, relative (standard deviation).
    start_s: what each takes before its first frame: a process, Blender, a scene from the shared disk.
    """

    core_s: float = 35.6 * 3600.0  # docs/speed_against_error.md: Cycles, reference
    files: float = 4e6
    size_bytes: float = 1.13e12  # docs/speed_against_error.md
    shards: int = 0
    spread: float = 0.15
    start_s: float = 8.0


@dataclass(frozen=True)
class Cluster:
    """Nodes, what they share, and the process that merges.

    slots: shards that a node makes at once, with `cpus` cores each; efficiency: of a second core beside the first.
    disk_bytes_per_s, disk_files_per_s: of the shared disk, all nodes together. losses_per_hour: of a node, replaced at
    once. merge_bytes_per_s: reading and hashing, for each of merge_threads, of which three take what the disk gives.
    merge_file_s: what a file takes besides, one after another, to be renamed and recorded.
    end_s: text files and manifest. mergers: processes that merge; 0 where who makes a shard merges it.
    """

    nodes: int = 1
    slots: int = 8
    cpus: int = 2
    efficiency: float = 0.9
    disk_bytes_per_s: float = 5e9
    disk_files_per_s: float = 20_000.0
    losses_per_hour: float = 0.02
    merge_bytes_per_s: float = 1.5e9
    merge_threads: int = 3
    merge_file_s: float = 1.4e-4
    end_s: float = 60.0
    mergers: int = 0


@dataclass(frozen=True)
class Result:
    """How a simulated run went: when all shards were made and merged, and the share of processors' time in making."""

    made_s: float
    merged_s: float
    busy: float
    disk_busy: float
    lost_shards: int
    limit: Limit


def simulate(work: Work, cluster: Cluster, seed: int = 0) -> Result:
    """Return how a cluster makes a dataset. The same seed gives the same run."""
    random = np.random.Generator(np.random.Philox(seed))
    each_s = work.core_s / work.shards / _speed(cluster)
    # Gamma, as durations are positive; of the same mean and spread.
    shape = 1 / work.spread**2 if work.spread else np.inf
    made_in = random.gamma(shape, each_s / shape, work.shards) if work.spread else np.full(work.shards, each_s)
    waiting = deque((seconds, seconds) for seconds in made_in)  # what is left, and what the whole shard takes
    slots = cluster.nodes * cluster.slots
    # While n shards are made, each at full speed, they ask the disk for this share of what it gives.
    asked = max(
        work.size_bytes / work.shards / each_s / cluster.disk_bytes_per_s,
        work.files / work.shards / each_s / cluster.disk_files_per_s,
    )
    own_s = 0.0 if cluster.mergers else _own_merge_s(work, cluster)
    running: list[tuple[float, float, float]] = []  # end on the shards' own clock, what is left then, the whole
    now_s = clock = disk_s = 0.0
    lost = 0
    ended: list[float] = []
    while waiting or running:
        while waiting and len(running) < slots:
            left, whole = waiting.popleft()
            loss = random.exponential(3600 / cluster.losses_per_hour) if cluster.losses_per_hour else np.inf
            takes = work.start_s + left + own_s
            if loss < takes:
                heapq.heappush(running, (clock + loss, min(left, takes - loss), whole))
            else:
                heapq.heappush(running, (clock + takes, 0.0, whole))
        pace = min(1.0, 1 / (len(running) * asked)) if asked else 1.0
        end, left, whole = heapq.heappop(running)
        step_s = (end - clock) / pace
        disk_s += step_s if pace < 1 else 0.0
        now_s, clock = now_s + step_s, end
        if left > 0:
            lost += 1
            waiting.append((left, whole))
        else:
            ended.append(now_s)
    merged_s = (_merged_s(ended, work, cluster) if cluster.mergers else now_s) + cluster.end_s
    useful = float(made_in.sum()) / (slots * merged_s)
    result = Result(now_s, merged_s, useful, disk_s / now_s, lost, "processors")
    return replace(result, limit=_limit(result, work, cluster))


def _speed(cluster: Cluster) -> float:
    """Return how much faster than one core a shard is made."""
    return 1 + (cluster.cpus - 1) * cluster.efficiency


def merge_seconds(work: Work, cluster: Cluster) -> float:
    """Return what merging all takes, for one process of several that share the work and do nothing else."""
    hashing_s = work.size_bytes / (cluster.merge_bytes_per_s * cluster.merge_threads)
    each = hashing_s + work.files * cluster.merge_file_s
    return each / cluster.mergers


def _own_merge_s(work: Work, cluster: Cluster) -> float:
    """Return what who has made a shard takes to merge it, on its own processors."""
    threads = min(cluster.cpus, cluster.merge_threads)
    hashing_s = work.size_bytes / (cluster.merge_bytes_per_s * threads)
    return (hashing_s + work.files * cluster.merge_file_s) / work.shards


def _merged_s(ended: Sequence[float], work: Work, cluster: Cluster) -> float:
    """Return when the last shard is merged, one after another, as they come."""
    each_s = merge_seconds(work, cluster) / work.shards
    free_s = 0.0
    for end_s in ended:
        free_s = max(free_s, end_s) + each_s
    return free_s


def _limit(result: Result, work: Work, cluster: Cluster) -> Limit:
    """Return what kept the run from being faster."""
    if cluster.mergers and merge_seconds(work, cluster) > 0.5 * (result.merged_s - cluster.end_s):
        return "merging"
    if result.disk_busy > 0.5:
        return "disk"
    return "shards" if cluster.nodes * cluster.slots > work.shards / 2 else "processors"


def best_cut(work: Work, cluster: Cluster) -> Work:
    """Return the work in the number of shards that is merged first; the smallest of those that are as good."""
    if work.shards:
        return work
    cut = [replace(work, shards=count) for count in CUTS]
    merged_s = [simulate(item, cluster).merged_s for item in cut]
    return next(item for item, found_s in zip(cut, merged_s, strict=True) if found_s < 1.03 * min(merged_s))


def rows(work: Work, cluster: Cluster, nodes: Sequence[int]) -> Iterator[str]:
    """Yield a table in Markdown: a row for each number of nodes."""
    yield "| nodes | cores | shards | made after | merged after | in use | lost | limit |"
    yield "|---|---|---|---|---|---|---|---|"
    for count in nodes:
        here = replace(cluster, nodes=count)
        cut = best_cut(work, here)
        found = simulate(cut, here)
        cores = count * cluster.slots * cluster.cpus
        times = f"{_time(found.made_s)} | {_time(found.merged_s)}"
        rest = f"{found.busy:.0%} | {found.lost_shards} | {found.limit} |"
        yield f"| {count:,} | {cores:,} | {cut.shards} | {times} | {rest}"


def _time(seconds: float) -> str:
    if seconds < 5400:
        return f"{seconds / 60:.1f} min"
    return f"{seconds / 3600:.1f} h"


def main(arguments: Sequence[str]) -> int:
    """Print the table, for the figures that the command line gives."""
    parser = argparse.ArgumentParser(prog="cluster_simulation.py", description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=[1, 10, 100, 1000], metavar="N")
    for kind in (Work, Cluster):
        for item in fields(kind):
            if item.name != "nodes":
                parser.add_argument(f"--{item.name.replace('_', '-')}", type=type(item.default), default=item.default)
    options = vars(parser.parse_args(arguments))
    work = Work(**{item.name: options[item.name] for item in fields(Work)})
    cluster = Cluster(**{item.name: options[item.name] for item in fields(Cluster) if item.name != "nodes"})
    for row in rows(work, cluster, options["nodes"]):
        print(row)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
