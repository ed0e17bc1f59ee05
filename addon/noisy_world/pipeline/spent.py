# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the processor's time goes: seconds by stage, summed over threads."""

import contextlib
import threading
import time
from collections.abc import Iterator, Mapping

RENDERING = "rendering"
LOADING = "loading"


class Spent:
    """Processor seconds by stage, of what the threads do that say so, and of all else while frames are rendered."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._seconds: dict[str, float] = {}

    @contextlib.contextmanager
    def on(self, stage: str) -> Iterator[None]:
        """Add what this thread does to a stage. Threads that it starts itself are not counted."""
        start_s = time.thread_time()
        try:
            yield
        finally:
            self.add({stage: time.thread_time() - start_s})

    @contextlib.contextmanager
    def rest_on(self, stage: str) -> Iterator[None]:
        """Add what the whole process does to a stage, but for what goes to other stages meanwhile."""
        start_s = time.process_time() - sum(self.seconds.values())
        try:
            yield
        finally:
            self.add({stage: time.process_time() - sum(self.seconds.values()) - start_s})

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add seconds by stage."""
        with self._lock:
            for stage, value in seconds.items():
                self._seconds[stage] = self._seconds.get(stage, 0.0) + value

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage."""
        with self._lock:
            return dict(self._seconds)
