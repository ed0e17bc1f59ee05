# SPDX-License-Identifier: GPL-3.0-or-later
"""The history of a run of the odometry: each frame's tracking state and pose, and the edges between keyframes."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .agreement import NONE
from .frames import FrameEntry
from .tracking import State, Tracked
from .written import FrameResult

Float64: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """What came out: every frame's state and pose, and the keyframes.

    loops: how many were closed. stopped: whether it ended before the last frame.
    """

    frames: tuple[FrameResult, ...]
    keyframes: tuple[FrameResult, ...]
    loops: int = 0
    stopped: bool = False

    @property
    def summary(self) -> str:
        """Return a line on how it went."""
        known = sum(frame.c2w is not None for frame in self.frames)
        return f"{known} of {len(self.frames)} frames tracked, {len(self.keyframes)} keyframes, {self.loops} loops"


@dataclass(frozen=True)
class Edge:
    """A measured place of a keyframe in another one: first_from_second (4, 4)."""

    first: int
    second: int
    first_from_second: Float64


class TrackingHistory:
    """What became of the frames so far, and the keyframes with their places in one another."""

    def __init__(self) -> None:
        self.frames: list[tuple[FrameEntry, Tracked]] = []
        self.keyframes: list[FrameEntry] = []
        self.edges: list[Edge] = []

    def add(self, entry: FrameEntry, tracked: Tracked) -> None:
        """Take in the next frame. A first keyframe that no frame could be aligned with is given up for a new one."""
        place = tracked.keyframe_from_camera
        if place is not None and tracked.new_keyframe:
            if tracked.begins:
                nothing = Tracked(State.NOT_INITIALISED, -1, None, NONE)
                self.frames = [(earlier, nothing) for earlier, _ in self.frames]
                self.keyframes = []
            else:
                self.edges.append(Edge(tracked.keyframe, len(self.keyframes), place))
                tracked = replace(tracked, keyframe=len(self.keyframes), keyframe_from_camera=np.eye(4))
            self.keyframes.append(entry)
        self.frames.append((entry, tracked))

    def chained(self) -> list[Float64]:
        """Return each keyframe's c2w by the edge that it was made with; the first is at the origin."""
        places = [np.eye(4)] if self.keyframes else []
        places.extend(places[edge.first] @ edge.first_from_second for edge in self.edges)
        return places

    def result(self, places: list[Float64] | None = None, *, loops: int = 0, stopped: bool = False) -> Result:
        """Return every frame's pose. places: the keyframes' c2w, by default as they were chained."""
        places = self.chained() if places is None else places
        frames: list[FrameResult] = []
        for entry, tracked in self.frames:
            place = tracked.keyframe_from_camera
            c2w = None if place is None else places[tracked.keyframe] @ place
            frames.append(
                FrameResult(entry.index, entry.stamp_s, tracked.state, tracked.keyframe, tracked.agreement, c2w)
            )
        indices = {entry.index for entry in self.keyframes}
        return Result(tuple(frames), tuple(frame for frame in frames if frame.index in indices), loops, stopped)
