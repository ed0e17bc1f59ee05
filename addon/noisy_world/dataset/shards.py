# SPDX-License-Identifier: GPL-3.0-or-later
"""Shards: the pieces of a plan that are made apart, in other processes or on other machines, and then merged."""

from __future__ import annotations

import hashlib
import heapq
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, did_you_mean

if TYPE_CHECKING:  # a shard's name is read without a plan
    from .plan import Plan, Render

LONGEST_FOLDER = 200  # characters; file systems hold 255 bytes, and names of scenes and settings may fill them


@dataclass(frozen=True)
class Shard:
    """The source frames start to stop-1 of one render, by the render's name.

    What is made of them are the images that show one of these source frames, in every sequence of the render.
    """

    render: str
    start: int
    stop: int

    @property
    def name(self) -> str:
        """The shard in words, such as "room0.000000-000100"."""
        return f"{self.render}.{self.start:06d}-{self.stop:06d}"

    @property
    def scene(self) -> str:
        """The name of its scene. A render along a path of its own is named "scene@setting"."""
        return self.render.partition("@")[0]

    @property
    def folder_name(self) -> str:
        """The name of its folder: its own or, where that is too long for one, as much as fits and a hash."""
        if len(self.name) <= LONGEST_FOLDER:
            return self.name
        return f"{self.name[: LONGEST_FOLDER - 17]}-{hashlib.sha256(self.name.encode()).hexdigest()[:16]}"

    @classmethod
    def parse(cls, name: str) -> Shard:
        """Return the shard of a name. Raises ValueError where it names none."""
        found = re.fullmatch(r"(.+)\.(\d{6,9})-(\d{6,9})", name, re.ASCII)
        shard = cls(found[1], int(found[2]), int(found[3])) if found else None
        if shard is None or shard.name != name or shard.start >= shard.stop:
            raise ValueError(f"{name!r} is no shard: RENDER.START-STOP, such as room0.000000-000100")
        return shard

    def frames_of(self, frames: Sequence[int]) -> list[int]:
        """Return those of some source frames that are the shard's."""
        return [frame for frame in frames if frame in self]

    def __contains__(self, source: int) -> bool:
        """Tell whether a source frame of the render is the shard's."""
        return self.start <= source < self.stop


def render_of(plan: Plan, shard: Shard) -> Render:
    """Return the render of a shard. Raises InputError where the plan has none of its source frames."""
    renders = {render.name: render for render in plan.renders}
    if shard.render not in renders:
        remedy = did_you_mean(shard.render, renders) or f"there are {', '.join(list(renders)[:8])}"
        raise InputError(plan.preset.path, f"has no render {shard.render} for the shard {shard.name}", remedy=remedy)
    frames = renders[shard.render].frames
    if not shard.frames_of(frames):
        there = f"has the source frames {frames[0]} to {frames[-1]}" if frames else "has no frames, by --frames"
        raise InputError(plan.preset.path, f"{shard.render} {there}, and none of the shard {shard.name}")
    return renders[shard.render]


def shards_of(plan: Plan, count: int, work: Mapping[str, Sequence[int]] | None = None) -> tuple[Shard, ...]:
    """Divide a plan into about `count` shards that take equally long; at least one for each render.

    work: the source frames that are to be made, by the render's name; by default all. Each of them is in one shard.
    The same plan, count and work give the same shards.
    """
    from .estimate import frame_seconds

    wanted = {render.name: render.frames for render in plan.renders} if work is None else work
    renders = [render for render in plan.renders if wanted.get(render.name, ())]
    # Of one render at a time: a plan may have hundreds, with a million frames each.
    seconds = [float(frame_seconds(plan, render, wanted[render.name]).sum()) for render in renders]
    counts = _counts(seconds, [len(wanted[render.name]) for render in renders], count)
    shards: list[Shard] = []
    for render, pieces in zip(renders, counts, strict=True):
        frames = wanted[render.name]
        shards += _cut(render, frames, frame_seconds(plan, render, frames).cumsum(), pieces)
    return tuple(shards)


def seconds_of(plan: Plan, shards: Sequence[Shard]) -> tuple[float, ...]:
    """Estimate what each of several shards of a plan takes on two cores, without loading the scene, in seconds."""
    from .estimate import frame_seconds
    from .sequence import array_of

    named = {shard.render for shard in shards}
    until_s = {
        render.name: np.concatenate([[0.0], frame_seconds(plan, render, render.frames).cumsum()])
        for render in plan.renders
        if render.name in named
    }
    frames = {render.name: array_of(render.frames) for render in plan.renders if render.name in named}

    def seconds(shard: Shard) -> float:
        first, last = np.searchsorted(frames[shard.render], (shard.start, shard.stop))
        return float(until_s[shard.render][last] - until_s[shard.render][first])

    return tuple(map(seconds, shards))


def _counts(seconds: list[float], most: list[int], count: int) -> list[int]:
    """Return how many shards each render is cut into: one, and then whichever has the longest shards one more.

    most: how many frames each has.
    """
    counts = [1] * len(seconds)
    longest = [(-value, number) for number, value in enumerate(seconds) if most[number] > 1]
    heapq.heapify(longest)
    for _ in range(count - len(counts)):
        if not longest:
            break
        _, number = heapq.heappop(longest)
        counts[number] += 1
        if counts[number] < most[number]:
            heapq.heappush(longest, (-seconds[number] / counts[number], number))
    return counts


def _cut(render: Render, frames: Sequence[int], until_s: NDArray[np.float64], pieces: int) -> list[Shard]:
    """Cut a render's frames where the time until each is nearest to equal parts; no piece is empty.

    until_s: (N,) the seconds of the frames up to each, with it.
    """
    wanted_s = until_s[-1] * np.arange(1, pieces) / pieces
    ends = np.searchsorted(until_s, wanted_s - 1e-9 * until_s[-1]) + 1
    least = np.arange(1, pieces)  # as many frames before the end of each piece as there are pieces
    ends = np.maximum.accumulate(np.maximum(ends, least) - least) + least
    ends = np.minimum(ends, len(frames) - pieces + least)
    bounds = [0, *(int(end) for end in ends), len(frames)]
    return [Shard(render.name, frames[first], frames[last - 1] + 1) for first, last in pairwise(bounds)]
