# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate --ray`: the shards of a plan, made by the nodes of a Ray cluster and merged by this process as they end."""

import argparse
import json
import math
import threading
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..cluster.ray_runner import RayOptions, TaskOutcome, connected, run_tasks, slots
from ..cluster.remote import Task
from ..core.datasets.dataset_state import IDENTITY, WORK_FOLDER
from ..core.datasets.provenance import package_version
from ..core.datasets.storage import sha256_of_file
from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.planning.estimate import estimate
from ..core.planning.plan import Plan
from ..core.planning.shards import Shard
from ..core.progress import Progress
from ..pipeline.report import Report
from ..pipeline.run import Made, Run
from .arguments import out_address, out_folder
from .at_address import run_at
from .workers import END, WorkerOrder, hear

SHARD_S = (
    120.0  # of work on two cores in a shard, unless its number is given: loading a scene is a small part of it then
)


def make_on_ray(plan: Plan, options: argparse.Namespace, progress: Progress, stop: threading.Event) -> Report:
    """Make a dataset on a cluster.

    Raises MissingDependencyError without Ray, NoisyWorldError where no cluster answers and where shards cannot be made.
    """
    address = out_address(options)
    out = out_folder(options) if address is None else address
    on_ray = RayOptions(options.ray, options.cpus)
    with connected(on_ray):
        workers = RayWorkers(plan, out, on_ray, stop, scratch=options.scratch)
        count = options.shards or math.ceil(estimate(plan).seconds / SHARD_S)
        if isinstance(out, str):
            return run_at(plan, options, progress, stop, max(1, slots(on_ray))).make_apart(workers.make, count)
        run = Run(
            plan,
            out,
            progress=progress,
            stop=stop,
            overwrite=options.overwrite,
            jobs=max(1, slots(on_ray)),
            workers=workers.make,
            shards=count,
        )
        return run.make_dataset()


class RayWorkers:
    """The nodes of a cluster as makers of shards."""

    def __init__(
        self, plan: Plan, out: Path | str, options: RayOptions, stop: threading.Event, scratch: Path | None = None
    ) -> None:
        """Prepare. out: the dataset's folder or address. stop: when set, commands end after their current frames."""
        self._plan = plan
        self._out = out if isinstance(out, str) else out.resolve()
        self._scratch = scratch
        self._options = options
        self._stop = stop
        self._total = Report()
        self._failed: list[TaskOutcome] = []
        self._subjects: set[str] = set()

    def make(self, shards: tuple[Shard, ...], made: Made, progress: Progress) -> Report:
        """Let the cluster make shards. made: is called with each that is finished.

        Raises NoisyWorldError with the first error where shards cannot be made, after the others were;
        InterruptedRunError where `stop` was set.
        """

        def heard(message: dict[str, Any]) -> None:
            hear(message, progress, self._total, [], self._subjects)

        def ended(outcome: TaskOutcome) -> None:
            if outcome.done:
                self._total.add(outcome.report or {})
                made(Shard.parse(outcome.name))
            else:
                self._failed.append(outcome)
                progress.note(f"{outcome.name} failed on {outcome.node or 'a node that was lost'}: {outcome.line}")

        run_tasks(self._tasks(shards), self._options, heard, ended, self._stop)
        if self._failed:
            first = self._failed[0]
            where = f"{first.node}: " if first.node else ""
            told = f"{len(self._failed)} of {len(shards)} shards could not be made; {first.name}: {where}{first.line}"
            raise NoisyWorldError(f"{told}; mend that and run the same command again: the others are kept")
        if self._stop.is_set():
            raise InterruptedRunError("stopped")
        # As if what was done at the same time took place in one process: frames a second are those of all nodes.
        at_once = max(1, min(slots(self._options), len(shards)))
        self._total.rendering_s /= at_once
        self._total.loading_s /= at_once
        return self._total

    def _tasks(self, shards: tuple[Shard, ...]) -> list[Task]:
        """Return a task for each shard: a worker's, as `generate --jobs` starts it."""
        order = json.dumps(asdict(WorkerOrder.of(self._plan, self._out, self._options.cpus, self._scratch)))
        opened = None if isinstance(self._out, str) else self._out / WORK_FOLDER / IDENTITY
        count = str(self._options.cpus)
        return [
            Task(
                name=shard.name,
                words=("-m", "noisy_world", "generate", "--worker"),
                told=f"{order}\n{shard.name}\n",
                then=f"{END}\n",
                environment={"PYTHON_CPU_COUNT": count, "OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count},
                search_path=checkout(),
                version=package_version(),
                seen="" if opened is None else str(opened),
                sha256="" if opened is None else sha256_of_file(opened) or "",
            )
            for shard in shards
        ]


def checkout() -> str:
    """Return the folder that holds this package, if it is a checkout's; "" where it is installed."""
    package = Path(__file__).resolve().parents[1]
    return "" if (package / "blender_manifest.toml").is_file() else str(package.parent)
