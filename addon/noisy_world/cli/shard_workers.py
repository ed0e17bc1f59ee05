# SPDX-License-Identifier: GPL-3.0-or-later
"""Shards of a plan as tasks for an executor: their messages, and what a worker does for one.

A worker's order is the preset as it was read, overrides included, rather than the arguments of a command line.
"""

import argparse
import contextlib
import json
import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.machine import available_threads, peak_memory_bytes
from ..core.progress import Progress, counted
from ..dataset.estimate import check_memory, estimate
from ..dataset.folder_state import IDENTITY, WORK_FOLDER
from ..dataset.identity import base_versions, versions_of
from ..dataset.making import Report
from ..dataset.plan import Plan, make_plan
from ..dataset.run import Destination, Made, Run, threads_of_each
from ..dataset.shards import Shard, seconds_of
from ..dataset.store import is_address, open_store
from ..preset.keys import check_document
from .arguments import destination_of, out_address
from .entry import Entry, executor_of, work_on

if TYPE_CHECKING:  # one process takes none of them
    from ..executors.jobs import Executor, Job, Perform, Task, TaskOutcome

SHARD_S = 120.0  # of work on two cores in a shard on a cluster: loading a scene is a small part of it then


@dataclass(frozen=True)
class ShardOrder:
    """What a worker has to do, but for the shards, which it is told one after another.

    preset, document: the preset's file and its content, overrides included. chosen: start and stop of the frames of
    each sequence, if not all are made. out: the dataset's folder, which a run has opened, or its address. threads: of
    the renderer; 0 for all. scratch: where shards are made that go to an address; None for the system's own folder.
    merging: whether each is merged by who makes it.
    """

    preset: str
    document: dict[str, Any]
    chosen: tuple[int | None, int | None] | None
    out: str
    threads: int
    scratch: str | None = None
    merging: bool = False

    @classmethod
    def of(
        cls, plan: Plan, out: Path | str, threads: int, scratch: Path | None = None, *, merging: bool
    ) -> "ShardOrder":
        """Return the order for the workers of a plan. out: the dataset's folder or address."""
        chosen = None if plan.chosen is None else (plan.chosen.start, plan.chosen.stop)
        place = out if isinstance(out, str) else str(out.resolve())
        own = None if scratch is None else str(scratch.resolve())
        return cls(str(plan.preset.path), plan.preset.document, chosen, place, threads, own, merging)

    def text(self) -> str:
        """Return it as a line of JSON."""
        return json.dumps(asdict(self))

    def plan(self) -> Plan:
        """Return the plan. Raises InputError where files are missing or wrong."""
        chosen = None if self.chosen is None else slice(*self.chosen)
        return make_plan(check_document(self.document, Path(self.preset)), chosen)


@contextlib.contextmanager
def ready_for_shards(
    text: str, progress: Progress, *, stop: threading.Event, plan: Plan | None = None
) -> "Iterator[Perform]":
    """Be ready to make the shards of an order, given as its text; see `executors.jobs.Prepare`.

    plan: of the order, where this process was split from one that has made it.
    """
    order = ShardOrder(**json.loads(text))
    plan = plan or order.plan()
    if is_address(order.out):
        from ..dataset.address_run import AddressDestination

        place = AddressDestination(plan, open_store(order.out), None if order.scratch is None else Path(order.scratch))
    else:
        place = Destination(plan, Path(order.out))
    with place.making(progress, stop, threads=order.threads, joining=True, merging=order.merging) as make:

        def perform(name: str) -> dict[str, Any]:
            return replace(make(Shard.parse(name)), peak_memory_bytes=peak_memory_bytes()).content()

        yield perform


def tasks_of(plan: Plan, shards: tuple[Shard, ...]) -> "tuple[Task, ...]":
    """Return shards of a plan as tasks; each loads its scene."""
    from ..executors.jobs import Task

    scenes = {render.name: render.scene.name for render in plan.renders}
    seconds = seconds_of(plan, shards)
    named = zip(shards, seconds, strict=True)
    return tuple(Task(shard.name, shard.render, scenes[shard.render], took_s) for shard, took_s in named)


@dataclass(frozen=True)
class ShardWorkers:
    """Workers that make the shards of a plan.

    out: the dataset's folder or address. threads: of the renderer in each; 0 for a share of this machine's. merging:
    whether each merges what it has made.
    """

    plan: Plan
    out: Path | str
    executor: "Executor"
    stop: threading.Event
    threads: int = 0
    scratch: Path | None = None
    merging: bool = False

    def make(self, shards: tuple[Shard, ...], made: Made, progress: Progress) -> Report:
        """Have shards made; return what was done in all. made: is called with each shard that is finished.

        Raises NoisyWorldError where shards cannot be made, InterruptedRunError where `stop` was set.
        """
        from ..executors.jobs import carry_out

        total, at_once = Report(), min(self.executor.slots, len(shards))

        def done(outcome: "TaskOutcome") -> None:
            total.add(outcome.report or {})
            made(Shard.parse(outcome.name))

        carry_out(self._job(shards, at_once), self.executor, done, progress, self.stop)
        # As if what was done at the same time took place in one process: frames a second are those of all.
        total.rendering_s /= at_once
        total.loading_s /= at_once
        total.peak_memory_bytes = (total.peak_memory_bytes or 0) * at_once or None
        return total

    def _job(self, shards: tuple[Shard, ...], at_once: int) -> "Job":
        from ..executors.jobs import Job

        threads = self.threads or threads_of_each(at_once)
        order = ShardOrder.of(self.plan, self.out, threads, self.scratch, merging=self.merging)
        opened = None if isinstance(self.out, str) else self.out.resolve() / WORK_FOLDER / IDENTITY
        return Job("shards", "made", "generate", order.text(), tasks_of(self.plan, shards), opened)


def useful_jobs(asked: int, frames: int) -> tuple[int, str]:
    """Return how many of the processes asked for are of use, and a sentence where that is fewer, else "".

    More than the processors that this process may use only take memory, and each needs a frame to render.
    """
    threads = available_threads()
    jobs = max(1, min(asked, threads, frames))
    if jobs == asked:
        return jobs, ""
    count, what = (threads, "processor") if threads <= frames else (frames, "frame")
    return jobs, f"--jobs {asked} is more than is of use with {counted(count, what)}, so it is taken as {jobs}"


def make_dataset(  # noqa: PLR0917 - what every command that makes one has
    plan: Plan,
    options: argparse.Namespace,
    entry: Entry,
    progress: Progress,
    stop: threading.Event,
    need: Callable[[], None],
    *,
    folder: Path | None = None,
) -> Report:
    """Make the dataset of a plan by what the options name. folder: where, if not where they say.

    need: raises MissingDependencyError where its frames cannot be made here; it loads what makes them.

    Raises MissingDependencyError without Ray where that is to make it, NoisyWorldError where it cannot be made.
    """
    jobs, note = useful_jobs(options.jobs, plan.frame_count)
    if options.ray is None:
        if note:
            progress.note(note)
        check_memory(plan, jobs)
        if jobs == 1:
            place = destination_of(plan, options, folder=folder)
            need()
            return Run(plan, place, progress=progress, stop=stop, overwrite=options.overwrite).make_dataset()
        _load_shared(plan)
    from ..executors.processes import WorkerProcesses

    with executor_of(options, entry, jobs, lambda: _work_split(plan, need)) as executor:
        if options.ray is not None:
            jobs, count = executor.slots, options.shards or math.ceil(estimate(plan).seconds / SHARD_S)
            place = destination_of(plan, options, put_by_workers=True)
            out, merging = out_address(options) or place.folder, place.merged_by_workers
            workers = ShardWorkers(plan, out, executor, stop, options.cpus, options.scratch, merging)
        else:
            place, count = destination_of(plan, options, folder=folder), None
            workers = ShardWorkers(plan, place.folder, executor, stop, merging=place.merged_by_workers)
        kept = executor if isinstance(executor, WorkerProcesses) and executor.kept else None
        if kept is None:
            need()
        run = Run(
            plan,
            place,
            progress=progress,
            stop=stop,
            overwrite=options.overwrite,
            jobs=jobs,
            workers=workers.make,
            shards=count,
            versions=None if kept is None else kept.ask,
        )
        return run.make_dataset()


def _load_shared(plan: Plan) -> None:
    """Load what every worker of a plan needs, before they are split off: paths, the meshes of made ones, libraries."""
    base_versions()
    for scene in plan.scenes:
        _ = scene.path
    if "embree" in plan.engines:
        from ..render.ray_session import load_packets

        sizes = [render.camera.width_px * render.camera.height_px * len(render.frames) for render in plan.renders]
        load_packets(max(sizes, default=0))


def _work_split(plan: Plan, need: Callable[[], None]) -> int:
    """Be a worker that was split from the process that has made the plan."""

    def versions() -> dict[str, str]:
        need()
        return versions_of(plan)

    return work_on(partial(ready_for_shards, plan=plan), versions)
