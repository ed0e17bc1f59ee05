# SPDX-License-Identifier: GPL-3.0-or-later
"""Grow the ice that lens_frost puts on the glass: ferns from an edge inwards, from seeded random numbers.

    python headless/pictures/draw_frost.py

Writes two grey PNG files of each of two habits into the add-on: how thick the ice gets, and when it comes. All tips
grow at the same time, each along the axis of its crystal, and put out branches at some 60 degrees to both sides, as
ice does (Libbrecht, The physics of snow crystals, 2005). A tip that comes near other ice stops, as the vapour there is
used up, which is what shapes aggregates where diffusion is the limit (Witten and Sander, 1981; for frost on panes: Kim
and Lin, 2003). So plumes compete for room: most starve at the edge, and the ferns of those that win fill what lies
between them.
"""

import heapq
import math
import sys
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))

from noisy_world.core.streams import stream
from noisy_world.perturbations.shipped.lens_frost import HEIGHT_PX, TIME_SHRUNK, WIDTH_PX, map_file

Field: TypeAlias = NDArray[Any]  # (H, W) of floats; pyright takes three times as long where their type is named

# All chosen by eye, after photographs of frost on windows. Lengths in pixels of the map; the unit of time is what a
# plume of mean speed takes for a pixel.
REST_PX, REST_STD_PX = 255.0, 25.0  # depth at which growth comes to rest, before the map ends
LATEST = 900.0  # when all growth ends
MISSING = 0.06  # share of branches that do not begin
FINER = 4  # strokes are drawn so many times as large
GREYS = 42  # of thickness: with fewer of them the file is a third smaller


@dataclass(frozen=True)
class Kind:
    """A kind of branch.

    speed: of its parent's. apart_px: between its own branches. clear_px: how near it comes to other ice. half_px,
    peak: half width and height of its ridge. longest_px: its length where nothing is in its way.
    """

    speed: float
    apart_px: float
    clear_px: float
    half_px: float
    peak: float
    longest_px: float


@dataclass(frozen=True)
class Habit:
    """How ice grows. kinds: the stem of a plume first, then its branches, theirs, and so on.

    apart_px: between seeds. wander_rad: standard deviation of a tip's turn in a pixel. swirl_rad: of plumes side by
    side alike, as the film of water on the pane had flowed. bend_rad: standard deviation of a stem's bend, a pixel.
    forward_rad: how far branches of a stem bend towards its tip, a pixel. opening_rad: range of the angle between a
    branch and those of its own. stems: share of branches of a stem that become a stem themselves. drawn_by: the stream.
    """

    kinds: tuple[Kind, ...]
    apart_px: float
    wander_rad: float
    swirl_rad: float
    bend_rad: float
    forward_rad: float
    opening_rad: tuple[float, float]
    stems: float
    drawn_by: tuple[str, ...]


FERN = Habit(
    (
        Kind(1.0, 7.0, 7.0, 1.7, 1.0, 420.0),
        Kind(0.45, 3.8, 3.2, 1.2, 0.85, 150.0),
        Kind(0.5, 3.5, 1.9, 0.8, 0.6, 16.0),
        Kind(0.5, 99.0, 1.5, 0.5, 0.45, 3.0),
    ),
    *(13.0, 0.012, 0.005, 0.004, 0.003, (0.85, 1.1), 0.02),
    ("frost on a lens",),
)
# Curled plumes, as where water had flowed on the pane before it froze: stems bend far, and barbs towards their tips.
FEATHER = Habit(
    (
        Kind(1.0, 3.4, 6.0, 1.5, 1.0, 460.0),
        Kind(0.42, 4.4, 2.4, 0.85, 0.75, 46.0),
        Kind(0.5, 5.0, 1.7, 0.6, 0.5, 9.0),
        Kind(0.5, 99.0, 1.5, 0.5, 0.4, 3.0),
    ),
    *(19.0, 0.02, 0.016, 0.009, 0.016, (0.75, 1.0), 0.045),
    ("frost on a lens", "feathers"),
)
HABITS = {"fern": FERN, "feather": FEATHER}


@dataclass
class Tip:
    """The growing end of a branch, and where it has been: x, y and time at each pixel of its way.

    bend: radians a pixel. opening: radians between a branch and those of its own. strength: of its ridge, 1 at most.
    """

    number: int
    parent: int
    kind: int
    x: float
    y: float
    heading: float
    bend: float
    speed: float
    longest_px: float
    opening: float
    until_branch_px: float
    strength: float
    path: list[tuple[float, float, float]] = field(default_factory=list)


class Growth:
    """Tips that grow side by side on a strip whose ends are joined."""

    def __init__(self, generator: np.random.Generator, width_px: int, habit: Habit = FERN) -> None:
        self.generator = generator
        self.habit = habit
        self.width_px = width_px
        self.owner = np.zeros((HEIGHT_PX, width_px), np.int32)
        self.tips: list[Tip] = []
        self.queue: list[tuple[float, int, Tip]] = []
        self.turns = count()
        self.swirl = habit.swirl_rad * _clouds(generator, width_px, 260.0)
        self.rest_px = REST_PX + REST_STD_PX * np.clip(_clouds(generator, width_px, 150.0), -2, 2)

    def add(self, time: float, tip: Tip) -> None:
        """Let a tip begin at a time."""
        self.tips.append(tip)
        heapq.heappush(self.queue, (time, next(self.turns), tip))

    def grow(self) -> None:
        """Let all tips grow until none can."""
        while self.queue:
            time, _, tip = heapq.heappop(self.queue)
            if len(tip.path) < tip.longest_px and self._free(tip):
                later = time + 1 / (tip.speed * self._step(tip, time))
                if later < LATEST:
                    heapq.heappush(self.queue, (later, next(self.turns), tip))

    def _step(self, tip: Tip, time: float) -> float:
        """Move a tip on by a pixel; return how fast ice grows there, of its full speed."""
        column, row = int(tip.x) % self.width_px, int(tip.y)
        tip.path.append((tip.x, tip.y, time))
        self.owner[row, column] = tip.number
        swirl = float(self.swirl[row, column]) if tip.kind == 0 else 0.0
        tip.heading += tip.bend + swirl + self.habit.wander_rad * float(self.generator.standard_normal())
        tip.x += math.cos(tip.heading)
        tip.y += math.sin(tip.heading)
        tip.until_branch_px -= 1
        kinds = self.habit.kinds
        if tip.until_branch_px <= 0 and tip.kind + 1 < len(kinds):
            tip.until_branch_px += kinds[tip.kind].apart_px * float(self.generator.uniform(0.75, 1.25))
            for side in (-1.0, 1.0):
                if self.generator.random() > MISSING:
                    self.add(time, self._branch(tip, side))
        return 1 - min(row / float(self.rest_px[row, column]), 0.99) ** 3

    def _free(self, tip: Tip) -> bool:
        """Tell whether nothing but its own or its parent's ice lies before a tip."""
        if not 0 <= tip.y < HEIGHT_PX - 4:
            return False
        reach_px = self.habit.kinds[tip.kind].clear_px
        for turn, ahead_px in ((0.0, reach_px), (0.7, 0.8 * reach_px), (-0.7, 0.8 * reach_px)):
            x, y = tip.x + ahead_px * math.cos(tip.heading + turn), tip.y + ahead_px * math.sin(tip.heading + turn)
            if 0 <= y < HEIGHT_PX and self.owner[int(y), int(x) % self.width_px] not in (0, tip.number, tip.parent):
                return False
        return True

    def _branch(self, tip: Tip, side: float) -> Tip:
        uniform, kinds = self.generator.uniform, self.habit.kinds
        kind = tip.kind + 1
        speed = tip.speed * kinds[kind].speed * float(uniform(0.8, 1.2))
        if tip.kind == 0 and self.generator.random() < self.habit.stems:
            kind, speed = 0, 0.8 * tip.speed
        return Tip(
            number=len(self.tips) + 1,
            parent=tip.number,
            kind=kind,
            x=tip.x,
            y=tip.y,
            heading=tip.heading + side * (tip.opening + 0.05 * float(self.generator.standard_normal())),
            bend=-self.habit.forward_rad * side if kind == 1 else 0.4 * tip.bend,
            speed=speed,
            longest_px=kinds[kind].longest_px * float(uniform(0.35, 1.0)),
            opening=tip.opening,
            until_branch_px=float(uniform(1.5, 5.0)),
            strength=float(uniform(0.45, 1.0)),
        )


def grown(width_px: int = WIDTH_PX, habit: Habit = FERN) -> list[Tip]:
    """Return all branches of a strip so long, the same on every call."""
    generator = stream(*habit.drawn_by)
    growth = Growth(generator, width_px, habit)
    x = 0.0
    while x < width_px:
        seed = Tip(
            number=len(growth.tips) + 1,
            parent=0,
            kind=0,
            x=x,
            y=0.0,
            heading=math.pi / 2 + 0.55 * float(generator.standard_normal()),
            bend=habit.bend_rad * float(generator.standard_normal()),
            speed=float(np.clip(np.exp(0.4 * generator.standard_normal()), 0.25, 2.5)),
            longest_px=float(generator.uniform(60, 420)),
            opening=float(generator.uniform(*habit.opening_rad)),
            until_branch_px=3.0,
            strength=float(generator.uniform(0.6, 1.0)),
        )
        growth.add(float(generator.exponential(25.0)), seed)
        x += habit.apart_px * float(generator.uniform(0.5, 1.5))
    growth.grow()
    return [tip for tip in growth.tips if len(tip.path) > 1]


def _clouds(generator: np.random.Generator, width_px: int, size_px: float) -> Field:
    """Return smooth noise of standard deviation 1, (HEIGHT_PX, width_px), its left and right ends joined."""
    noise = generator.standard_normal((HEIGHT_PX, width_px), dtype=np.float32)
    shape = [np.fft.fftfreq(count) for count in noise.shape]
    power = np.exp(-2 * (np.pi * size_px / 3) ** 2 * (shape[0][:, None] ** 2 + shape[1] ** 2))
    smooth = np.fft.ifft2(np.fft.fft2(noise) * power).real
    return smooth / smooth.std()


def ridges(tips: list[Tip], width_px: int = WIDTH_PX, habit: Habit = FERN) -> NDArray[np.uint8]:
    """Return (HEIGHT_PX, width_px): the thickness of ridges with a roof's profile, the highest where several are."""
    margin = 8
    strokes = [stroke for tip in tips for stroke in _strokes(tip, habit.kinds[tip.kind], width_px, margin)]
    strokes.sort(key=lambda stroke: stroke[0])
    canvas = np.zeros((HEIGHT_PX * FINER, (width_px + 2 * margin) * FINER), np.uint8)
    for grey, wide, points in strokes:
        cv2.polylines(canvas, [points], False, round(grey), wide)
    canvas = canvas[:, margin * FINER : -margin * FINER]
    small = cv2.resize(canvas, (width_px, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8) // (256 // GREYS) * (256 // GREYS)


def _strokes(tip: Tip, kind: Kind, width_px: int, margin: int) -> list[tuple[float, int, NDArray[np.int32]]]:
    """Return a branch as strokes: grey, width and points, wide dark ones below narrow bright ones."""
    path = np.array(tip.path)[:, :2]
    path[:, 0] += margin - width_px * np.floor(path[:, 0].min() / width_px)
    shifts = [k * width_px for k in (0, -1, -2) if path[:, 0].max() + k * width_px >= 0]
    taper = np.minimum(1.0, (np.arange(len(path), 0, -1) / (6 + 8 * kind.half_px)) ** 0.6)
    found = []
    for first in range(0, len(path) - 1, 3):
        half_px = kind.half_px * taper[first] * (0.6 + 0.5 * tip.strength)
        peak = 255 * kind.peak * tip.strength * taper[first] ** 0.7
        for level in (0.25, 0.5, 0.75, 1.0):
            wide = max(round(2 * half_px * FINER * (1.15 - level)), 1)
            for shift in shifts:
                points = np.rint((path[first : first + 4] + np.array([shift, 0.0])) * FINER).astype(np.int32)
                found.append((peak * (0.25 + 0.75 * level), wide, points))
    return found


def times(tips: list[Tip], width_px: int = WIDTH_PX) -> NDArray[np.uint8]:
    """Return when ice comes, 0 to 255, TIME_SHRUNK times smaller; between branches it is the nearest one's time."""
    points = np.concatenate([np.array(tip.path) for tip in tips])
    share = np.minimum(points[:, 2] / np.quantile(points[:, 2], 0.995), 1.0)
    first = np.full((HEIGHT_PX, width_px), np.inf)
    np.minimum.at(first, (points[:, 1].astype(int), points[:, 0].astype(int) % width_px), share)
    around = np.pad(first, ((0, 0), (64, 64)), mode="wrap")
    free = np.isinf(around).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    labels = np.asarray(labels, np.int64)
    by_label = np.zeros(int(labels.max()) + 1, np.float32)
    by_label[labels[free == 0]] = around[free == 0]
    nearest = np.asarray(cv2.GaussianBlur(by_label[labels], (0, 0), 1.2), np.float32)[:, 64:-64]
    size = width_px // TIME_SHRUNK, HEIGHT_PX // TIME_SHRUNK
    small = np.asarray(cv2.resize(nearest, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8)


def main() -> int:
    """Write both maps of each habit and return the exit status."""
    for of, habit in HABITS.items():
        tips = grown(habit=habit)
        for name, picture in (("thickness", ridges(tips, habit=habit)), ("time", times(tips))):
            path = map_file(name, of)
            cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
            print(f"wrote {path}: {path.stat().st_size / 2**10:.0f} KiB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
