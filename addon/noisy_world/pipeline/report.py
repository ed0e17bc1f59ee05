# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run did, and how fast."""

from dataclasses import dataclass, field


@dataclass
class Report:
    """What a run did: what goes to run.json and to the user."""

    frames_rendered: int = 0
    frames_kept: int = 0
    loading_s: float = 0.0
    first_frame_s: float | None = None
    rendering_s: float = 0.0
    total_s: float = 0.0
    peak_memory_bytes: int | None = None
    jobs: int = 1
    notes: list[str] = field(default_factory=list)

    @property
    def frames_per_s(self) -> float | None:
        """Frames a second from the first frame on, loading not counted."""
        return self.frames_rendered / self.rendering_s if self.frames_rendered and self.rendering_s > 0 else None

    def merge(self, other: "Report") -> None:
        """Add what another process did at the same time."""
        self.frames_rendered += other.frames_rendered
        self.loading_s = max(self.loading_s, other.loading_s)
        self.rendering_s = max(self.rendering_s, other.rendering_s)
        first = [value for value in (self.first_frame_s, other.first_frame_s) if value is not None]
        self.first_frame_s = min(first) if first else None
        self.peak_memory_bytes = (self.peak_memory_bytes or 0) + (other.peak_memory_bytes or 0) or None
        self.notes += [note for note in other.notes if note not in self.notes]

    def content(self) -> dict[str, object]:
        """Return what run.json says."""
        rate = self.frames_per_s
        return {
            "frames_rendered": self.frames_rendered,
            "frames_kept": self.frames_kept,
            "frames_per_s": None if rate is None else round(rate, 3),
            "loading_s": round(self.loading_s, 3),
            "first_frame_s": None if self.first_frame_s is None else round(self.first_frame_s, 3),
            "rendering_s": round(self.rendering_s, 3),
            "total_s": round(self.total_s, 3),
            "peak_memory_bytes": self.peak_memory_bytes,
            "jobs": self.jobs,
            "notes": self.notes,
        }
