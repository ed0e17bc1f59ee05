# SPDX-License-Identifier: GPL-3.0-or-later
"""The search for a threshold: trial after trial, each where it tells most, until the interval is narrow enough.

What was tried before decides the next trial, and nothing else does, so a search that is taken up again is the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from ...core.errors import StorageError
from ...core.streams import stream
from .axis import Axis
from .psychometric import LEVEL, chances, interval, next_place, prior, quantile, updated

FEWEST_RUNS = 10
"""Before a search ends without a threshold. Chosen."""
FEWEST_TO_FIND = 25
"""Before a threshold is found. Chosen: fewer outcomes do not tell how gradual the rise is, and an interval that allows
for any is too wide where it is abrupt and too narrow where it is gradual."""
NARROW_IN_A_ROW = 3
"""Runs after which the interval is narrow enough, one after the other. Chosen: a search that ended at the first would
end where chance has made it narrow."""


@dataclass(frozen=True)
class Planned:
    """A trial that is to be made. number: from 0; seed: of its path and its noise."""

    number: int
    scene: str
    seed: int
    value: float


@dataclass(frozen=True)
class Trial:
    """A trial that was made. outcome: how the run ended. ate_m: None where it has none. succeeded: as asked for."""

    number: int
    scene: str
    seed: int
    value: float
    outcome: str
    ate_m: float | None
    tracked_share: float
    succeeded: bool

    @property
    def planned(self) -> Planned:
        """What it was to be."""
        return Planned(self.number, self.scene, self.seed, self.value)


class Verdict(StrEnum):
    """What a search found."""

    FOUND = "found"  # the interval is as narrow as asked
    ENDED = "ended"  # it is wider: no more runs were allowed
    HOLDS = "holds"  # the threshold, if there is one, lies beyond the worst value
    FAILS = "fails"  # the threshold lies before the mildest value


@dataclass(frozen=True)
class Found:
    """What a search found. threshold, mild, worst: with the interval's ends; None where not in what was searched."""

    axis: Axis
    verdict: Verdict
    runs: int
    threshold: float | None
    mild: float | None
    worst: float | None

    def text(self) -> str:
        """Return it in a sentence."""
        axis, runs = self.axis, f"{self.runs} runs"
        if self.verdict is Verdict.HOLDS:
            return f"more than half succeed at the worst value too, {axis.text(axis.worst)}; no threshold ({runs})"
        if self.verdict is Verdict.FAILS:
            return f"half or more fail at the mildest value too, {axis.text(axis.mild)}; no threshold ({runs})"
        ends = f"{100 * LEVEL:.0f} %: {self._end(self.mild, axis.mild, 'before')} to "
        ends += self._end(self.worst, axis.worst, "beyond")
        found = "is not found" if self.threshold is None else f"is {axis.text(self.threshold)}"
        wide = ", which is wider than asked for" if self.verdict is Verdict.ENDED else ""
        return f"the threshold {found} ({ends}{wide}; {runs})"

    def _end(self, value: float | None, end: float, side: str) -> str:
        return f"{side} {self.axis.text(end)}" if value is None else self.axis.text(value)


def scene_of(number: int, scenes: Sequence[str], seed: int) -> str:
    """Return the scene of a trial: all of them in a drawn order, then all in another, so that each comes as often."""
    round_, place = divmod(number, len(scenes))
    return scenes[int(stream("threshold", "scenes", seed, frame=round_).permutation(len(scenes))[place])]


def search(
    axis: Axis,
    scenes: Sequence[str],
    seed: int,
    made: Sequence[Trial],
    carry_out: Callable[[Planned], Trial],
    *,
    width: float,
    most: int,
) -> Found:
    """Search, and return what was found.

    scenes: names. seed: of the first trial; each takes the next. made: trials of before, which are not made again.
    carry_out: makes one, and keeps it. width: of the interval, as a share of the axis. most: runs. Raises StorageError
    where `made` is of another search, and whatever carry_out raises.
    """
    values = axis.tried()
    known = chances(tuple(map(axis.place_of, values)))
    posterior = prior(known)
    verdict = Verdict.ENDED
    runs = narrow = 0
    while runs < most and verdict is Verdict.ENDED:
        place = next_place(posterior, known)
        planned = Planned(runs, scene_of(runs, scenes, seed), seed + runs, values[place])
        if runs < len(made) and made[runs].planned != planned:
            raise StorageError(f"trial {runs} of those that were made is of another search", remedy="begin anew")
        trial = made[runs] if runs < len(made) else carry_out(planned)
        posterior = updated(posterior, known[:, place], failed=not trial.succeeded)
        runs += 1
        low, high = interval(posterior)
        narrow = narrow + 1 if low >= 0.0 and high <= 1.0 and high - low <= width else 0
        if runs >= FEWEST_RUNS and low >= 1.0:
            verdict = Verdict.HOLDS
        elif runs >= FEWEST_RUNS and high <= 0.0:
            verdict = Verdict.FAILS
        elif (runs >= FEWEST_TO_FIND and narrow >= NARROW_IN_A_ROW) or (runs == most and narrow):
            verdict = Verdict.FOUND
    low, high = interval(posterior)
    middle, low, high = (
        axis.value_at(end) if 0.0 <= end <= 1.0 else None for end in (quantile(posterior, 0.5), low, high)
    )
    return Found(axis, verdict, runs, middle, low, high)
