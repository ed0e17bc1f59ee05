# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the processor's time goes: seconds by stage, summed over threads."""

import contextlib
import threading
import time
from collections.abc import Iterator, Mapping

RENDERING = "rendering"
LOADING = "loading"
DECODING = "decoding"


class StageTimer:
    """Processor seconds by stage, of what the threads do that say so, and of all else while frames are rendered."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._seconds: dict[str, float] = {}
        self._within = threading.local()  # seconds of this thread that belong to a stage inside another

    @contextlib.contextmanager
    def on(self, stage: str) -> Iterator[None]:
        """Add what this thread does to a stage, but for what goes to a stage inside.

        Threads that it starts itself are not counted.
        """
        start_s, before_s = time.thread_time(), self._inner_s
        self._within.seconds = 0.0
        try:
            yield
        finally:
            whole_s = time.thread_time() - start_s
            self.add({stage: whole_s - self._inner_s})
            self._within.seconds = before_s + whole_s

    @property
    def _inner_s(self) -> float:
        return getattr(self._within, "seconds", 0.0)

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
