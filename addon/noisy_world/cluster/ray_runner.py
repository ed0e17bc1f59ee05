# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands carried out by a Ray cluster: one thin remote function, which runs each in a process of a node.

Ray knows of no image: a command reads and writes the dataset's folder, or its address, by itself. What comes back is
an exit status and a line.
"""

import importlib
import logging
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..core.errors import MissingDependencyError, NoisyWorldError
from ..core.extras import install_command
from . import remote
from .remote import DONE, INTERRUPTED, REFUSED, USERS_ERROR, Task

ANSWER_S = 10.0  # for a cluster to answer; chosen

HERE = "local"
"""The address that starts a Ray of this machine's own, for as long as the run takes."""


@dataclass(frozen=True)
class TaskOutcome:
    """How a task ended.

    node: the name of the machine; "" where that is unknown. status: the command's; None where its worker or its node
    was lost each time that it was tried. line: why it was not done. report: of what it did.
    """

    name: str
    node: str
    status: int | None
    line: str
    report: dict[str, Any] | None = None

    @property
    def done(self) -> bool:
        """Whether the command did its work."""
        return self.status == DONE

    @property
    def crashed(self) -> bool:
        """Whether the command ended in another way than well or with a user's error."""
        return self.status not in (None, DONE, USERS_ERROR, REFUSED)

    @property
    def told(self) -> str:
        """Why it was not done, and where."""
        return f"{self.node}: {self.line}" if self.node else self.line


@dataclass(frozen=True)
class RayOptions:
    """How tasks are run.

    address: of the cluster: "auto" for the one that runs here (or that RAY_ADDRESS names), "local", "HOST:PORT" or
    "ray://HOST:PORT". cpus: what each task takes of a node's processors. retries: how often it is run again
    after its process, its worker or its node was lost.
    """

    address: str = "auto"
    cpus: int = 2
    retries: int = 3


def module(name: str) -> Any:
    """Return a module of Ray. Raises MissingDependencyError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        remedy = f"run: {install_command('cluster')}"
        raise MissingDependencyError(f"ray: missing in this Python, {sys.executable}; {remedy}") from error


@contextmanager
def connected(options: RayOptions) -> Iterator[None]:
    """Be connected to a cluster. Raises MissingDependencyError without Ray, NoisyWorldError where there is none."""
    ray = module("ray")
    if ray.is_initialized():  # by whoever calls this from Python
        yield
        return
    _check_address(options.address)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    local = options.address == HERE
    try:
        ray.init(
            address=options.address,
            log_to_driver=False,
            logging_level=logging.ERROR,
            configure_logging=False,
            **({"include_dashboard": False} if local else {}),
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _no_cluster(options.address, str(error).strip().split("\n")[0]) from error
    for number, handler in handlers.items():
        signal.signal(number, handler)  # Ray puts its own in their place
    try:
        yield
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


def slots(options: RayOptions) -> int:
    """Return how many tasks run at once on the cluster that this process is connected to, as it is now."""
    nodes = [node for node in module("ray").nodes() if node["Alive"]]
    return sum(int(node["Resources"].get("CPU", 0) // options.cpus) for node in nodes)


def run_tasks(
    orders: Iterable[Task],
    options: RayOptions,
    hear: Callable[[dict[str, Any]], None],
    ended: Callable[[TaskOutcome], None],
    stop: threading.Event,
) -> None:
    """Run tasks on the cluster that this process is connected to, until all have ended or `stop` is set.

    hear: is given the messages of the commands. ended: is told of each task that has ended. Both are called in this
    thread.

    Raises NoisyWorldError where no node is left that could take part.
    """
    _Tasks(options, hear, ended, stop).run(orders)


class _Tasks:
    """The tasks of one call of `run_tasks`."""

    def __init__(
        self,
        options: RayOptions,
        hear: Callable[[dict[str, Any]], None],
        ended: Callable[[TaskOutcome], None],
        stop: threading.Event,
    ) -> None:
        self._ray = module("ray")
        module("ray.cloudpickle").register_pickle_by_value(remote)
        self._options = options
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
        self._task = self._ray.remote(num_cpus=options.cpus, max_retries=options.retries, max_calls=1)(remote.in_ray)
        self._running: dict[Any, tuple[Task, int]] = {}  # by the reference to the result: a task and its tries
        self._refused: dict[str, str] = {}  # why, by the node's identifier

    def run(self, orders: Iterable[Task]) -> None:
        """Run the tasks."""
        self._check_nodes()
        for order in orders:
            self._submit(order, tries=1)
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
        wanted = self._options.cpus
        if not any(node["Resources"].get("CPU", 0) >= wanted for node in self._nodes()):
            self._hear(
                {"note": f"no node has {wanted} processors, as each shard is to have; waiting for one that does"}
            )

    def _nodes(self) -> list[dict[str, Any]]:
        return [node for node in self._ray.nodes() if node["Alive"] and node["NodeID"] not in self._refused]

    def _submit(self, order: Task, tries: int) -> None:
        task = self._task
        if self._refused:
            labels = module("ray.util.scheduling_strategies")
            others = {"ray.io/node-id": labels.NotIn(*self._refused)}
            task = task.options(scheduling_strategy=labels.NodeLabelSchedulingStrategy(hard=others))
        self._running[task.remote(order, self._messages.put)] = order, tries

    def _take(self, reference: Any, stopping: bool) -> None:
        """Hear of a task that has ended, and run it again where that may help."""
        order, tries = self._running.pop(reference)
        outcome, node_id = _outcome(reference, order, stopping)
        if outcome is None or (stopping and not outcome.done):
            return
        if outcome.status == REFUSED:
            if node_id not in self._refused:
                self._refused[node_id] = outcome.line
                self._hear({"note": f"{outcome.node} takes no part: {outcome.line}"})
            if not self._nodes():
                raise NoisyWorldError(f"no node can take part; {outcome.node}: {outcome.line}")
            self._submit(order, tries)
        elif outcome.crashed and tries <= self._options.retries:
            self._hear({"note": f"{order.name}: {outcome.node}: {outcome.line}; it is run again"})
            self._submit(order, tries + 1)
        else:
            self._ended(outcome)


def _outcome(reference: Any, order: Task, stopping: bool) -> tuple[TaskOutcome | None, str]:
    """Return how a task ended, None where it was stopped; and its node."""
    exceptions = module("ray.exceptions")
    try:
        told = module("ray").get(reference)
    except exceptions.TaskCancelledError:
        return None, ""
    except exceptions.RayTaskError as error:
        # Ray's worker fails with a TypeError of its own where it is cancelled while it reads its arguments.
        if isinstance(error.cause, KeyboardInterrupt) or (stopping and isinstance(error.cause, TypeError)):
            return None, ""
        raise  # a bug
    except exceptions.RayError as error:
        return TaskOutcome(order.name, "", None, str(error).strip().split("\n")[0]), ""
    if told["status"] == INTERRUPTED:
        return None, ""
    return TaskOutcome(order.name, told["node"], told["status"], told["line"], told["report"]), told["node_id"]
