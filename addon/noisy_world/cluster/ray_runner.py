# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands carried out by a Ray cluster: one thin remote function, which runs each in a process of a node.

Ray knows of no image: a command reads and writes the dataset's folder, or its address, by itself. What comes back is
an exit status and a line.
"""

import logging
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..core.errors import MissingDependencyError, NoisyWorldError
from . import remote
from .remote import DONE, INTERRUPTED, USERS_ERROR, Order

HERE = "local"
"""The address that starts a Ray of this machine's own, for as long as the run takes."""


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    node: the name of the machine; "" where that is unknown. line: why it was not done. crashed: whether that was
    anything but a user's error.
    """

    name: str
    done: bool
    node: str = ""
    line: str = ""
    crashed: bool = False

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


@contextmanager
def connected(options: RayOptions) -> Iterator[None]:
    """Be connected to a cluster. Raises MissingDependencyError without Ray, NoisyWorldError where there is none."""
    try:
        import ray
    except ImportError as error:
        raise MissingDependencyError(
            "ray is not installed; install it with pip install 'noisy-world[cluster]'"
        ) from error
    if ray.is_initialized():  # by whoever calls this from Python
        yield
        return
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
        reason = str(error).strip().split("\n")[0]
        remedy = "start one with 'ray start --head', name its address, or use --ray local"
        raise NoisyWorldError(f"--ray {options.address}: no Ray cluster answers: {reason}; {remedy}") from error
    for number, handler in handlers.items():
        signal.signal(number, handler)  # Ray puts its own in their place
    try:
        yield
    finally:
        ray.shutdown()


def run_tasks(
    orders: Iterable[Order],
    options: RayOptions,
    hear: Callable[[dict[str, Any]], None],
    ended: Callable[[Outcome], None],
    stop: threading.Event,
) -> bool:
    """Run tasks on the cluster that this process is connected to, until all have ended or `stop` is set.

    hear: is given the messages of the commands. ended: is told of each task that has ended. Both are called in this
    thread. Returns whether it was stopped.
    """
    import ray
    from ray.util.queue import Queue
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    ray.cloudpickle.register_pickle_by_value(remote)
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=True)
    messages = Queue(actor_options={"num_cpus": 0, "scheduling_strategy": here})
    task = ray.remote(num_cpus=options.cpus, max_retries=options.retries, max_calls=1)(remote.carry_out)
    running = {task.remote(order, messages.put): (order, 1) for order in orders}
    stopping = False
    try:
        while running:
            ready, _ = ray.wait(list(running), num_returns=1, timeout=0.5)
            for message in messages.get_nowait_batch(messages.qsize()):
                hear(message)
            for reference in ready:
                order, tries = running.pop(reference)
                outcome = _outcome(reference, order)
                if outcome is None:
                    continue
                if outcome.crashed and tries <= options.retries and not stopping:
                    hear({"note": f"{order.name}: {outcome.told}; it is run again"})
                    running[task.remote(order, messages.put)] = (order, tries + 1)
                    continue
                ended(outcome)
            if stop.is_set() and not stopping:
                stopping = True
                for reference in running:
                    ray.cancel(reference)
    finally:
        messages.shutdown(force=True)
    return stopping


def _outcome(reference: Any, order: Order) -> Outcome | None:
    """Return how a task ended; None where it was stopped."""
    import ray
    from ray.exceptions import RayError, RayTaskError, TaskCancelledError

    try:
        told = ray.get(reference)
    except TaskCancelledError:
        return None
    except RayTaskError as error:
        if isinstance(error.cause, KeyboardInterrupt):
            return None
        raise  # a bug
    except RayError as error:  # its worker or its node was lost, each time that it was tried
        return Outcome(order.name, done=False, line=str(error).strip().split("\n")[0])
    if told["status"] == INTERRUPTED:
        return None
    done, crashed = told["status"] == DONE, told["status"] not in (DONE, USERS_ERROR)
    return Outcome(order.name, done, told["node"], told["line"], crashed)
