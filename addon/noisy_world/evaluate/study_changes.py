# SPDX-License-Identifier: GPL-3.0-or-later
"""Two studies beside each other: which findings change, of the systems and settings that both have."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .findings import Ranked, SystemFindings, findings_of, times
from .metrics import OVER_CLEAN
from .report_sections import FEWEST, Section, with_interval
from .report_tables import NOTHING, Column, Results, Table, cell_text, column_of
from .spread import SceneValues, difference_here_interval, exponential, mean_interval, mean_over_scenes
from .study_tables import SETTING, over_clean_table, tidy_runs

if TYPE_CHECKING:
    from pandas import DataFrame

    from .spread import Interval

ByScene: TypeAlias = Mapping[str, tuple[float, float, float]]
"""By scene: mean, the variance of that mean, and its degrees of freedom."""

MOST_SAID = 6
BREAKS, HOLDS, WORSE, BETTER, SAME = "breaks now", "no longer breaks", "worse", "better", ""


@dataclass(frozen=True)
class Change:
    """A system's finding of a setting in both studies. ratio: its error over clean now, over that before; None without.

    large, here: the interval of the ratio for scenes at large, and for other seeds in these scenes; n_scenes: in how
    many both have the error over clean, of n runs now.
    """

    system: str
    before: Ranked
    now: Ranked
    ratio: float | None
    large: "Interval"
    here: "Interval"
    n_scenes: int
    n: int

    @property
    def sure(self) -> "Interval":
        """The interval by which a change is told: for scenes at large where they are enough, else in these."""
        return self.large if self.n_scenes >= FEWEST else self.here

    @property
    def finding(self) -> str:
        """What has changed; "" where nothing surely has."""
        if self.before.broke != self.now.broke:
            return BREAKS if self.now.broke else HOLDS
        if self.ratio is not None and self.sure.low > 1:
            return WORSE
        return BETTER if self.ratio is not None and self.sure.high < 1 else SAME


def changes_section(results: Results, before: Results) -> Section:
    """Return the part of a report that says which findings differ from those of a study before."""
    import pandas as pd

    tables = [tidy_runs(each.runs) for each in (before, results)]
    found = [
        findings_of(each, over_clean_table(table, ["system", *SETTING]))
        for each, table in zip((before, results), tables, strict=True)
    ]
    changes = sorted(_changes(tables, found), key=_order)
    columns = {
        "system": [change.system for change in changes],
        "setting": [change.now.setting for change in changes],
        "finding": [change.finding for change in changes],
        "before": [_number(change.before.over_clean) for change in changes],
        "now": [_number(change.now.over_clean) for change in changes],
        "ratio": [_number(change.ratio) for change in changes],
        **{f"ratio_{end}": [float(getattr(change.large, end)) for change in changes] for end in ("low", "high")},
        **{f"here_{end}": [float(getattr(change.here, end)) for change in changes] for end in ("low", "high")},
        "endings_before": [change.before.endings for change in changes],
        "endings_now": [change.now.endings for change in changes],
        "n_scenes": [change.n_scenes for change in changes],
        "n": [change.n for change in changes],
    }
    caption = (
        "The error over clean of both studies, and that now over that before in scenes that both have: below 1 it is "
        "less now. A setting breaks a system where half of the runs or more failed or are incomplete."
    )
    table = Table("changes", "Each setting in both studies", caption, pd.DataFrame(columns), _columns())
    paragraphs = [*_sentences(changes, found), *_unlike(results, before), *_alone(found)]
    return Section("changes", f"Beside {before.folder.name}", paragraphs, tables=[table] if changes else [])


def _changes(tables: "Sequence[DataFrame]", found: Sequence[Sequence[SystemFindings]]) -> Iterator[Change]:
    known = [{(item.system, ranked.setting): ranked for item in each for ranked in item.settings} for each in found]
    for system, setting in known[1]:
        if (system, setting) not in known[0]:
            continue
        before, now = (_by_scene(table, system, setting) for table in tables)
        scenes = sorted(before.keys() & now.keys())
        values = [SceneValues(*np.array([each[scene] for scene in scenes]).reshape(-1, 3).T) for each in (before, now)]
        apart = values[1].mean - values[0].mean
        ratio = float(np.exp(mean_over_scenes(apart))) if scenes else None
        large = exponential(mean_interval(apart))
        here = exponential(difference_here_interval(values[1], values[0]))
        runs = tables[1]
        mine = runs[(runs["system"] == system) & (runs["setting"] == setting) & runs["scene"].isin(scenes)]
        n = int(mine[OVER_CLEAN].notna().sum()) if scenes else 0
        pair = known[0][system, setting], known[1][system, setting]
        yield Change(system, *pair, ratio, large, here, len(scenes), n)


def _by_scene(runs: "DataFrame", system: str, setting: str) -> ByScene:
    """Return the logarithm of the error over clean in each scene that has it, over its seeds, or one seed's repeats."""
    if OVER_CLEAN not in runs:
        return {}
    mine = runs[(runs["system"] == system) & (runs["setting"] == setting) & (runs[OVER_CLEAN] > 0)]
    made: dict[str, tuple[float, float, float]] = {}
    for scene, group in mine.groupby("scene"):
        logs = group[OVER_CLEAN].astype(float).map(math.log)
        seeds = logs.groupby(group["seed"]).mean()
        values = seeds if len(seeds) > 1 else logs
        made[str(scene)] = float(seeds.mean()), float(values.var() / len(values)), len(values) - 1.0
    return made


def _order(change: Change) -> tuple[int, float, str, str]:
    """Return what changes are sorted by: those that are sure first, by how much."""
    kind = (BREAKS, HOLDS, WORSE, BETTER, SAME).index(change.finding)
    size = abs(np.log(change.ratio)) if change.ratio else 0.0
    return (kind if kind < 2 else 2 if kind < 4 else 3), -float(size), change.system, change.now.setting


# --- in words ---


def _sentences(changes: Sequence[Change], found: Sequence[Sequence[SystemFindings]]) -> Iterator[str]:
    sure = [change for change in changes if change.finding]
    of = f"{len(changes)} finding{'s' if len(changes) != 1 else ''} that both have"
    if not changes:
        yield "The two studies have no system and setting in common."
        return
    yield (
        f"{len(sure) or 'None'} of the {of} change{'s' if len(sure) == 1 else ''}. Intervals are of 95 %: of unchanged "
        "ones one in twenty is outside of its own by chance."
    )
    for change in sure[:MOST_SAID]:
        yield _sentence(change)
    if len(sure) > MOST_SAID:
        yield f"{len(sure) - MOST_SAID} more: see the table."
    worst = [{item.system: item.settings[0].setting for item in each if item.settings} for each in found]
    for system, setting in sorted(worst[1].items()):
        if worst[0].get(system, setting) != setting:
            yield f"Worst for {system} was {worst[0][system]}, and is {setting}."


def _sentence(change: Change) -> str:
    about = f"{change.now.setting} with {change.system}"
    if change.finding in (BREAKS, HOLDS):
        texts = [each.endings or "complete" for each in (change.before, change.now)]
        return f"{about} {change.finding}: {texts[1]}, before {texts[0]}."
    assert change.ratio is not None, "it is surely another"
    ends = f"{cell_text(change.sure.low, 3)} to {cell_text(change.sure.high, 3)}"
    where = "" if change.n_scenes >= FEWEST else ", in these scenes"
    both = (times(each.over_clean) for each in (change.before, change.now) if each.over_clean is not None)
    ratio = f"{cell_text(change.ratio, 3)} times ({ends}{where})"
    return f"{about} is {change.finding}: {' and now '.join(both)} over clean, {ratio}."


def _unlike(results: Results, before: Results) -> Iterator[str]:
    """Say what the studies were not run alike by, as study.json has it."""
    one, other = before.study, results.study
    if not one or not other:
        return
    if one.get("protocol") != other.get("protocol"):
        yield f"Protocols differ, {one.get('protocol')} and {other.get('protocol')}, so errors are not of one kind."
    systems = [each.get("systems", {}) for each in (one, other)]
    changed = [name for name in sorted(systems[0].keys() & systems[1].keys()) if systems[0][name] != systems[1][name]]
    if changed:
        yield f"Definitions differ of {', '.join(changed)}."


def _alone(found: Sequence[Sequence[SystemFindings]]) -> Iterator[str]:
    """Say what only one of them has."""
    systems = [{item.system: {ranked.setting for ranked in item.settings} for item in each} for each in found]
    for whose, mine, others in (("before", *systems), ("now", *reversed(systems))):
        alone = sorted(mine.keys() - others.keys())
        if alone:
            yield f"Only {whose}: {', '.join(alone)}."
        for system in sorted(mine.keys() & others.keys()):
            if names := sorted(mine[system] - others[system]):
                yield f"Only {whose}, of {system}: {', '.join(names)}."


def _columns() -> tuple[Column, ...]:
    def ratio(row: Mapping[str, Any]) -> str:
        return with_interval(row["ratio"], row["ratio_low"], row["ratio_high"], row["n_scenes"])

    def here(row: Mapping[str, Any]) -> str:
        ends = [cell_text(row[name], 3) for name in ("here_low", "here_high")]
        return NOTHING if NOTHING in ends else f"[{ends[0]}, {ends[1]}]"

    over = "the error over that on clean frames, the geometric mean"
    return (
        column_of("system"),
        column_of("setting"),
        Column("finding", "finding"),
        Column("before", "before, over clean", better="lower", meaning=over),
        Column("now", "now, over clean", better="lower", meaning=over),
        Column(
            "ratio", "now over before", better="lower", meaning=f"with its interval, of {FEWEST} scenes", text=ratio
        ),
        Column("here_low", "in these scenes", meaning="the 95 % interval for other seeds in these scenes", text=here),
        Column("endings_before", "endings before"),
        Column("endings_now", "endings now"),
        Column("n_scenes", "scenes"),
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else value
