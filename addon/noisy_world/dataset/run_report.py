# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run: what it did, and how fast."""

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

# Where the processor's time goes: seconds by stage, summed over threads.


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


@dataclass
class Report:
    """What a run did, for run.json and for the user. refused: why sequences were left out, by their folders.

    processor_s: seconds of processors by stage, over all threads and processes. processors: those that shards were made
    on, where they are unlike, each with its shards. colour_rays, colour_pixels: of frames whose renderer chose by what
    it saw how many rays each pixel of colour took: all their rays and pixels.
    """

    frames_rendered: int = 0
    frames_kept: int = 0
    loading_s: float = 0.0
    first_frame_s: float | None = None
    rendering_s: float = 0.0
    total_s: float = 0.0
    peak_memory_bytes: int | None = None
    jobs: int = 1
    notes: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    processor_s: dict[str, float] = field(default_factory=dict)
    processors: list[dict[str, Any]] = field(default_factory=list)
    colour_rays: int = 0
    colour_pixels: int = 0

    @property
    def frames_per_s(self) -> float | None:
        """Frames per second from the first frame on, without loading."""
        return self.frames_rendered / self.rendering_s if self.frames_rendered and self.rendering_s > 0 else None

    @property
    def decoding_share(self) -> float | None:
        """The share of the processor's time in which images of recordings were decoded; None where none was."""
        decoding_s = self.processor_s.get(DECODING)
        return None if decoding_s is None else decoding_s / sum(self.processor_s.values())

    @property
    def rays_per_px(self) -> float | None:
        """The mean number of rays that a pixel of colour took; None where it was not the renderer that chose it."""
        return self.colour_rays / self.colour_pixels if self.colour_pixels else None

    def merge(self, other: "Report") -> None:
        """Add what another process did at the same time."""
        self.frames_rendered += other.frames_rendered
        self.loading_s = max(self.loading_s, other.loading_s)
        self.rendering_s = max(self.rendering_s, other.rendering_s)
        first = [value for value in (self.first_frame_s, other.first_frame_s) if value is not None]
        self.first_frame_s = min(first) if first else None
        self.peak_memory_bytes = (self.peak_memory_bytes or 0) + (other.peak_memory_bytes or 0) or None
        self.colour_rays += other.colour_rays
        self.colour_pixels += other.colour_pixels
        self.notes += [note for note in other.notes if note not in self.notes]
        self.add_processor_s(other.processor_s)

    def add(self, content: Mapping[str, Any]) -> None:
        """Add what was done at another time, by the content of its report."""
        self.frames_rendered += content["frames_rendered"]
        self.loading_s += content["loading_s"]
        self.rendering_s += content["rendering_s"]
        self.first_frame_s = content["first_frame_s"] if self.first_frame_s is None else self.first_frame_s
        peaks = [peak for peak in (self.peak_memory_bytes, content["peak_memory_bytes"]) if peak is not None]
        self.peak_memory_bytes = max(peaks, default=None)
        self.colour_rays += content.get("colour_rays", 0)
        self.colour_pixels += content.get("colour_pixels", 0)
        self.notes += [note for note in content["notes"] if note not in self.notes]
        self.add_processor_s(content["processor_s"])

    def add_processor_s(self, seconds: Mapping[str, float]) -> None:
        """Add seconds of processors by stage."""
        for stage, value in seconds.items():
            self.processor_s[stage] = self.processor_s.get(stage, 0.0) + value

    def content(self) -> dict[str, object]:
        """Return the content of run.json."""
        rate, rays_per_px = self.frames_per_s, self.rays_per_px
        rays = {"colour_rays": self.colour_rays, "colour_pixels": self.colour_pixels}
        return {
            "frames_rendered": self.frames_rendered,
            "frames_kept": self.frames_kept,
            "frames_per_s": None if rate is None else round(rate, 3),
            "loading_s": round(self.loading_s, 3),
            "first_frame_s": None if self.first_frame_s is None else round(self.first_frame_s, 3),
            "rendering_s": round(self.rendering_s, 3),
            "total_s": round(self.total_s, 3),
            "processor_s": {stage: round(value, 3) for stage, value in sorted(self.processor_s.items())},
            "peak_memory_bytes": self.peak_memory_bytes,
            "jobs": self.jobs,
            "notes": self.notes,
            **({"refused": self.refused} if self.refused else {}),
            **({} if rays_per_px is None else {"rays_per_px": round(rays_per_px, 3), **rays}),
            **({"processors": self.processors} if self.processors else {}),
        }


def processors_of(shards: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the processors that shards were made on, each with the names of its shards; none where all are alike."""
    found: list[dict[str, Any]] = []
    for shard in shards:
        same = [item for item in found if item["processor"] == shard["processor"]]
        if not same:
            found.append({"processor": shard["processor"], "shards": []})
        (same[0] if same else found[-1])["shards"].append(shard["shard"])
    return found if len(found) > 1 else []
