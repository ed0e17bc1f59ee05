# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate --ray`: the cases of a study, evaluated by the nodes of a Ray cluster that share the folder of results."""

import argparse
import threading
from collections.abc import Callable
from typing import Any

from ..cluster.ray_runner import RayOptions, TaskOutcome, connected, run_tasks
from ..cluster.remote import Task
from ..core.datasets.provenance import package_version
from ..core.datasets.storage import sha256_of_file
from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.progress import Progress
from ..evaluation.study.cases import Case
from ..evaluation.study.results import STUDY
from ..evaluation.study.study import Study
from .ray_workers import checkout
from .worker_pool import END


def evaluate_on_ray(
    study: Study,
    cases: list[Case],
    options: argparse.Namespace,
    done: Callable[[Case], None],
    progress: Progress,
    *,
    stop: threading.Event,
) -> None:
    """Let a cluster do cases. done: is told of each.

    Raises MissingDependencyError without Ray, NoisyWorldError where no cluster answers or cases cannot be done, after
    the others were, and InterruptedRunError where `stop` was set.
    """
    failed: list[TaskOutcome] = []

    def hear(message: dict[str, Any]) -> None:
        match message:
            case {"advance": count}:
                progress.advance(count)
            case {"note": text}:
                progress.note(text, message.get("subject", ""))

    def ended(outcome: TaskOutcome) -> None:
        if outcome.done:
            done(Case.parse(outcome.name))
        else:
            failed.append(outcome)
            progress.note(f"{outcome.name} failed: {outcome.told}")

    on_ray = RayOptions(options.ray, options.cpus)
    with connected(on_ray):
        run_tasks(_tasks(study, cases, options.cpus), on_ray, hear, ended, stop)
    if failed:
        told = f"{len(failed)} of {len(cases)} sequences could not be evaluated; {failed[0].name}: {failed[0].told}"
        raise NoisyWorldError(f"{told}; mend that and run the same command again: the others are kept")
    if stop.is_set():
        raise InterruptedRunError("stopped")


def _tasks(study: Study, cases: list[Case], cpus: int) -> list[Task]:
    """Return a task for each case: a worker's, as `--jobs` starts it."""
    opened = study.results.folder / STUDY
    variables = ("PYTHON_CPU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    return [
        Task(
            name=case.name,
            words=("-m", "noisy_world", "evaluate", "--worker"),
            told=f"{study.order.text()}\n{case.name}\n",
            then=f"{END}\n",
            environment=dict.fromkeys(variables, str(cpus)),
            search_path=checkout(),
            version=package_version(),
            seen=str(opened),
            sha256=sha256_of_file(opened) or "",
        )
        for case in cases
    ]
