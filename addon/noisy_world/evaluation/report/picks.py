# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses the runs that are drawn: a system's clean, median, worst, incomplete and failed ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..analysis.run_results import complete_runs
from ..metrics.success import FAILED, INCOMPLETE
from ..study.cases import CLEAN
from .reading import KEY, Results, records

if TYPE_CHECKING:
    from pandas import DataFrame

ERROR = "ate_rmse_m"
MOST_SYSTEMS = 6
MOST_SEQUENCES = 6


@dataclass(frozen=True)
class Pick:
    """A run, as a row of the table of runs, and why it was chosen."""

    run: dict[str, Any]
    why: str


def picked_runs(results: Results) -> list[Pick]:
    """Return for each system a clean run, the median and the worst other complete one, an incomplete and a failed one.

    Where there are more systems than MOST_SYSTEMS, those that come first by name.
    """
    picks = []
    for system in sorted(set(results.runs["system"]))[:MOST_SYSTEMS]:
        runs = results.runs[results.runs["system"] == system]
        picks += _of_system(runs)
    return picks


def picked_sequences(results: Results) -> list[list[dict[str, Any]]]:
    """Return for some sequences their first repeats: a clean one, then those with the largest errors and most failures.

    No two are of one setting.
    """
    runs = results.runs[results.runs["repeat"] == results.runs["repeat"].min()]
    groups = []
    for _, group in runs.groupby(list(KEY), sort=False):
        rows = list(records(group))
        largest = max((row.get(ERROR, float("nan")) for row in rows if row.get(ERROR, -1.0) >= 0), default=0.0)
        groups.append((int(group["failed"].sum()), largest, rows))
    clean = [group for group in groups if group[2][0]["perturbation"] == CLEAN]
    # Dynamic ones first: there is something to see in what was done to each frame.
    noisy = [group for group in groups if group[2][0]["perturbation"] != CLEAN and group[0] < len(group[2])]
    noisy.sort(key=lambda group: (-(group[2][0]["mode"] == "dynamic"), -group[1], -group[0]))
    chosen, seen = clean[:1], {CLEAN}
    for group in noisy:
        setting = group[2][0]["setting"]
        if setting not in seen and len(chosen) < MOST_SEQUENCES:
            seen.add(setting)
            chosen.append(group)
    return [rows for _, _, rows in chosen]


def _of_system(runs: "DataFrame") -> list[Pick]:
    scored = complete_runs(runs)
    if ERROR in scored:
        scored = scored[scored[ERROR].notna()].sort_values(ERROR, kind="stable")
    clean = list(records(scored[scored["perturbation"] == CLEAN]))
    noisy = list(records(scored[scored["perturbation"] != CLEAN]))
    incomplete, failed = (list(records(runs[runs[name]])) for name in (INCOMPLETE, FAILED))
    picks = _first(clean[(len(clean) - 1) // 2 :], "clean")
    picks += _first(noisy[(len(noisy) - 1) // 2 :], "median") if len(noisy) > 1 else []
    picks += _first(noisy[-1:], "worst complete")
    return picks + _first(incomplete, INCOMPLETE) + _first(failed, FAILED)


def _first(rows: Sequence[dict[str, Any]], why: str) -> list[Pick]:
    return [Pick(rows[0], why)] if rows else []
