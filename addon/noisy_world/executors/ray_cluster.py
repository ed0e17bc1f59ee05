# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes of a Ray cluster as an executor: one thin remote function, which runs a worker in a process of a node.

Ray knows of no image: a worker reads and writes the dataset's folder, or its address, by itself. What comes back is
an exit status and a line.
"""

import importlib
import logging
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.atomic_files import sha256_of_file
from ..core.errors import DONE, INTERRUPTED, REFUSED, USERS_ERROR, MissingDependencyError, NoisyWorldError
from ..core.machine import thread_variables
from ..core.packages import install_command, package_version
from .jobs import Job, TaskMessage, TaskOutcome
from .worker_process import NodeTask, carried, in_ray

ANSWER_S = 10.0  # for a cluster to answer; chosen
RETRIES = 3  # of a task whose process, worker or node was lost

HERE = "local"
"""The address that starts a Ray of this machine's own, for as long as the run takes."""


@dataclass(frozen=True)
class RayCluster:
    """A Ray cluster that this process is connected to. cpus: what each task takes of a node's processors."""

    cpus: int

    goes_on = True

    @property
    def slots(self) -> int:
        """How many tasks run at once on the cluster as it is now."""
        nodes = [item for item in module("ray").nodes() if item["Alive"]]
        return max(1, sum(int(item["Resources"].get("CPU", 0) // self.cpus) for item in nodes))

    def run(
        self, job: Job, hear: Callable[[TaskMessage], None], ended: Callable[[TaskOutcome], None], stop: threading.Event
    ) -> None:
        """Let the nodes do the tasks. Raises NoisyWorldError where no node is left that could take part."""
        _Tasks(self.cpus, hear, ended, stop).run(_node_tasks(job, self.cpus))


def module(name: str) -> Any:
    """Return a module of Ray. Raises MissingDependencyError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        remedy = f"run: {install_command('cluster')}"
        raise MissingDependencyError(f"ray: missing in this Python, {sys.executable}; {remedy}") from error


@contextmanager
def ray_cluster(address: str, cpus: int) -> Iterator[RayCluster]:
    """Be connected to a cluster.

    address: "auto" for the one that runs here (or that RAY_ADDRESS names), "local", "HOST:PORT" or "ray://HOST:PORT".
    Raises MissingDependencyError without Ray, NoisyWorldError where there is none.
    """
    ray = module("ray")
    if ray.is_initialized():  # by whoever calls this from Python
        yield RayCluster(cpus)
        return
    _check_address(address)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        ray.init(
            address=address,
            log_to_driver=False,
            logging_level=logging.ERROR,
            configure_logging=False,
            **({"include_dashboard": False} if address == HERE else {}),
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _no_cluster(address, str(error).strip().split("\n")[0]) from error
    for number, handler in handlers.items():
        signal.signal(number, handler)  # Ray puts its own in their place
    try:
        yield RayCluster(cpus)
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Raise NoisyWorldError where nothing listens at HOST:PORT: Ray would try for minutes."""
    host, colon, port = address.rpartition("://")[2].rpartition(":")
    if not colon:
        return  # auto, local
    try:
        socket.create_connection((host.strip("[]"), int(port)), ANSWER_S).close()
    except (OSError, ValueError) as error:
        raise _no_cluster(address, str(error)) from error


def _no_cluster(address: str, reason: str) -> NoisyWorldError:
    remedy = "start one with 'ray start --head', name its address, or use --ray local"
    return NoisyWorldError(f"--ray {address}: no Ray cluster answers: {reason}; {remedy}")


def _node_tasks(job: Job, cpus: int) -> list[NodeTask]:
    """Return what the nodes are told of a job's tasks, each of which has a worker of its own."""
    package = Path(__file__).resolve().parents[1]
    installed = (package / "blender_manifest.toml").is_file()
    seen = job.opened
    return [
        NodeTask(
            name=task.name,
            words=("-m", "noisy_world", job.subcommand, "--worker"),
            order=job.order,
            environment=thread_variables(cpus),
            search_path="" if installed else str(package.parent),
            version=package_version(),
            seen="" if seen is None else str(seen),
            sha256="" if seen is None else sha256_of_file(seen) or "",
        )
        for task in job.tasks
    ]


class _Tasks:
    """The tasks of one job."""

    def __init__(
        self,
        cpus: int,
        hear: Callable[[TaskMessage], None],
        ended: Callable[[TaskOutcome], None],
        stop: threading.Event,
    ) -> None:
        self._ray = module("ray")
        for item in carried():
            module("ray.cloudpickle").register_pickle_by_value(item)
        self._cpus = cpus
        self._hear = hear
        self._ended = ended
        self._stop = stop
        # An actor on the driver's own machine, so it is not lost with another node; if it is, it begins anew.
        here = module("ray.util.scheduling_strategies").NodeAffinitySchedulingStrategy(
            self._ray.get_runtime_context().get_node_id(), soft=True
        )
        actor = {"num_cpus": 0, "scheduling_strategy": here, "max_restarts": -1, "max_task_retries": -1}
        self._messages = module("ray.util.queue").Queue(actor_options=actor)
        # A task's own processes and memory end with it: max_calls=1.
        self._remote = self._ray.remote(num_cpus=cpus, max_retries=RETRIES, max_calls=1)(in_ray)
        self._running: dict[Any, tuple[NodeTask, int]] = {}  # by the reference to the result: a task and its tries
        self._refused: dict[str, str] = {}  # why, by the node's identifier

    def run(self, tasks: list[NodeTask]) -> None:
        """Run the tasks."""
        self._check_nodes()
        for task in tasks:
            self._submit(task, tries=1)
        stopping = False
        try:
            while self._running:
                ready, _ = self._ray.wait(list(self._running), num_returns=1, timeout=0.5)
                for message in self._messages.get_nowait_batch(self._messages.qsize()):
                    self._hear(message)
                for reference in ready:
                    self._take(reference, stopping)
                if self._stop.is_set() and not stopping:
                    stopping = True
                    for reference in self._running:
                        self._ray.cancel(reference)
        finally:
            for reference in self._running:
                self._ray.cancel(reference)
            self._messages.shutdown(force=True)

    def _check_nodes(self) -> None:
        if not any(item["Resources"].get("CPU", 0) >= self._cpus for item in self._nodes()):
            message = f"no node has {self._cpus} processors, as each task is to have; waiting for one that does"
            self._hear({"note": message})

    def _nodes(self) -> list[dict[str, Any]]:
        return [item for item in self._ray.nodes() if item["Alive"] and item["NodeID"] not in self._refused]

    def _submit(self, task: NodeTask, tries: int) -> None:
        remote = self._remote
        if self._refused:
            labels = module("ray.util.scheduling_strategies")
            others = {"ray.io/node-id": labels.NotIn(*self._refused)}
            remote = remote.options(scheduling_strategy=labels.NodeLabelSchedulingStrategy(hard=others))
        self._running[remote.remote(task, self._messages.put)] = task, tries

    def _take(self, reference: Any, stopping: bool) -> None:
        """Take the outcome of a task that has ended, and run it again where that may help."""
        task, tries = self._running.pop(reference)
        outcome, node_id = _outcome(reference, task, stopping)
        if outcome is None or (stopping and not outcome.done):
            return
        if outcome.status == REFUSED:
            if node_id not in self._refused:
                self._refused[node_id] = outcome.line
                self._hear({"note": f"{outcome.machine} takes no part: {outcome.line}"})
            if not self._nodes():
                raise NoisyWorldError(f"no node can take part; {outcome.failure}")
            self._submit(task, tries)
        elif outcome.status not in (None, DONE, USERS_ERROR) and tries <= RETRIES:
            self._hear({"note": f"{task.name}: {outcome.failure}; it is run again"})
            self._submit(task, tries + 1)
        else:
            self._ended(outcome)


def _outcome(reference: Any, task: NodeTask, stopping: bool) -> tuple[TaskOutcome | None, str]:
    """Return how a task ended, None where it was stopped; and its node."""
    exceptions = module("ray.exceptions")
    try:
        answer = module("ray").get(reference)
    except exceptions.TaskCancelledError:
        return None, ""
    except exceptions.RayTaskError as error:
        # Ray's worker fails with a TypeError of its own where it is cancelled while it reads its arguments.
        if isinstance(error.cause, KeyboardInterrupt) or (stopping and isinstance(error.cause, TypeError)):
            return None, ""
        raise  # a bug
    except exceptions.RayError as error:
        line = str(error).strip().split("\n")[0]
        return TaskOutcome(task.name, None, line), ""
    if answer["status"] == INTERRUPTED:
        return None, ""
    outcome = TaskOutcome(task.name, answer["status"], answer["line"], answer["machine"], answer["report"])
    return outcome, answer["node_id"]
