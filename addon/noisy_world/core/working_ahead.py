# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes items in threads, a few ahead of the consumer, and yields results in order."""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def done_ahead(
    work: Callable[[Item], Result], items: Iterable[Item], *, threads: int, ahead: int, name: str
) -> Generator[tuple[Item, Result]]:
    """Yield each item with what `work` makes of it, in their order.

    ahead: how many items are begun before the first of them is asked for, so that memory does not grow with their
    number. name: of the threads. An error of `work` is raised where its item would be yielded. When nothing more is
    asked for, items that are not begun are dropped, and those that are begun are waited for.
    """
    waiting: deque[tuple[Item, Future[Result]]] = deque()
    pool = ThreadPoolExecutor(threads, thread_name_prefix=name)
    try:
        for item in items:
            waiting.append((item, pool.submit(work, item)))
            if len(waiting) > ahead:
                done, future = waiting.popleft()
                yield done, future.result()
        while waiting:
            done, future = waiting.popleft()
            yield done, future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
