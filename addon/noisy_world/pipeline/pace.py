# SPDX-License-Identifier: GPL-3.0-or-later
"""How fast a run goes, by when its newest files were written, and how long the rest takes at that pace.

Frames differ in cost: a frame of a render of its own takes many times what a link to a clean image takes. So the pace
is in seconds of the estimate a second, and what is left is weighed in the same way.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..core.datasets.file_inventory import JournalTimes

WINDOW_S = 600.0  # of the newest files that count: long enough for a scene to be loaded in it, chosen
SILENCE_S = 60.0  # without a new file for this long, and for ten times the usual, no run seems to go on; chosen


@dataclass(frozen=True)
class Pace:
    """How fast a run goes.

    last_s: seconds since the newest frame was written, None without one. frames_per_s: of all sequences together, over
    the last `window_s`; None where that is unknown. left_s: what the rest takes at that pace, None where unknown.
    """

    last_s: float | None = None
    window_s: float = 0.0
    frames_per_s: float | None = None
    left_s: float | None = None

    @property
    def silent(self) -> bool:
        """Whether no run seems to go on."""
        usual_s = 0.0 if not self.frames_per_s else 1 / self.frames_per_s
        return self.last_s is not None and self.last_s > max(SILENCE_S, 10 * usual_s)


def pace_of(
    written: Sequence[tuple[str, JournalTimes]],
    costs_s: Mapping[str, float],
    left: Mapping[str, float] | None,
    now_s: float,
) -> Pace:
    """Return the pace of a run.

    written: when the newest frames of its journals were written, with the folder of the sequence. costs_s: what a frame
    of each sequence costs, by its folder. left: how many frames of each sequence are missing; None where that is
    unknown. now_s: since the epoch.
    """
    times = [time_s for _, item in written for time_s in item.times_s]
    if not times:
        return Pace()
    last_s = max(times)
    # A journal of which only the end was read tells nothing of the time before that.
    begun = [min(item.times_s) for _, item in written if item.cut and max(item.times_s) > last_s - WINDOW_S]
    first_s = max([min(times), last_s - WINDOW_S, *begun])
    counts: dict[str, float] = {}
    for folder, item in written:
        later = sum(time_s > first_s for time_s in item.times_s)
        counts[folder] = counts.get(folder, 0.0) + later * item.frames_each
    window_s = last_s - first_s
    age_s = max(0.0, now_s - last_s)
    if window_s <= 0 or not any(counts.values()):
        return Pace(age_s)
    rate = sum(count * costs_s[folder] for folder, count in counts.items()) / window_s
    left_s = None if left is None else sum(count * costs_s[folder] for folder, count in left.items()) / rate
    return Pace(age_s, window_s, sum(counts.values()) / window_s, left_s)
