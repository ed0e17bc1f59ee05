# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's first table: the main results, a row for each system."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..analysis.run_results import complete_runs
from ..analysis.run_table import SUCCESS, SUCCESS_OVER_CLEAN
from .analysed import FEWEST, LABELS, Analyses, with_interval
from .findings import SystemFound, times
from .labels import column_of
from .per_setting import COUNTED_RUNS, counts, endings, records_of
from .reading import Results
from .tables import NOTHING, Column, Table, shown

if TYPE_CHECKING:
    from pandas import DataFrame

ERROR = "ate_rmse_m"
SCORES = (SUCCESS, SUCCESS_OVER_CLEAN, "success_auc", "f1_auc")
RATED = "success_auc"
ALL = "all"


def headline_table(results: Results, analyses: Analyses, found: Sequence[SystemFound]) -> Table:
    """Return the table. found: of each system."""
    import pandas as pd

    worst = {item.system: _worst(item) for item in found}
    rows = []
    for system, group in results.runs.groupby("system", sort=True):
        row: dict[str, Any] = {"system": system, **counts(group)}
        row |= {
            "endings": endings(records_of(group)),
            "worst": worst[str(system)],
            "n_scenes": group["scene"].nunique(),
        }
        if ERROR in group:
            errors = complete_runs(group)[ERROR]
            row |= {f"{ERROR}.median": errors.median(), f"{ERROR}.n": int(errors.notna().sum())}
        rows.append(row | _scores(analyses["systems"], str(system)) | _rates(analyses["robustness"], str(system)))
    frame = pd.DataFrame(rows)
    columns = [column_of("system"), *map(column_of, COUNTED_RUNS), Column("endings", "endings")]
    columns.append(Column("worst", "worst setting", meaning="and its error over that on clean frames"))
    if ERROR in results.runs:
        columns.append(_median())
    columns += [_interval(name, column_of(name)) for name in SCORES if name in frame]
    columns += [
        _interval(name, Column(name, LABELS[name][0], better=better, meaning=LABELS[name][1]))
        for name, better in _RATES
        if name in frame and frame[name].notna().any()
    ]
    columns.append(Column("n_scenes", "scenes", meaning="which the intervals stand on"))
    return Table("headline", "Systems", _caption(analyses), frame, tuple(columns))


_RATES = (("mrr", "higher"), ("mce", "lower"))


def _worst(item: SystemFound) -> str:
    """Return the worst setting, and by how much."""
    if not item.settings:
        return ""
    worst = item.settings[0]
    if worst.broke or worst.over_clean is None:
        return f"{worst.setting}, {worst.endings}" if worst.endings else ""
    return f"{worst.setting}, {times(worst.over_clean)}"


def _caption(analyses: Analyses) -> str:
    table = analyses["robustness"]
    baselines = sorted({name for name in table["baseline"] if name}) if len(table) else []
    against = f" mCE is against {baselines[0]}." if baselines else ""
    return (
        "All scenes, settings, seeds and repeats. Success, success AUC and F1 AUC are means over the perturbed "
        "settings, in which a failed run is 0, and in all but F1 AUC an incomplete one; mRR and mCE are of success "
        "AUC, over perturbations. In brackets: 95 % "
        f"intervals for scenes at large, of {FEWEST} scenes or more.{against} The median of ATE is over the n "
        "complete runs, clean ones too."
    )


def _scores(table: "DataFrame", system: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for name in SCORES:
        rows = table[(table["system"] == system) & (table["measure"] == name)]
        if len(rows):
            row = rows.iloc[0]
            found |= {name: row["mean"], f"{name}_low": row["low"], f"{name}_high": row["high"]}
            found[f"{name}_n"] = row["n_scenes"]
    return found


def _rates(table: "DataFrame", system: str) -> dict[str, float]:
    rows = table[(table["system"] == system) & (table["score"] == RATED) & (table["perturbation"] == ALL)]
    if not len(rows):
        return {}
    row = rows.iloc[0]
    rates = {name: row[name] for rate, _ in _RATES for name in (rate, f"{rate}_low", f"{rate}_high")}
    return rates | {f"{rate}_n": row["n_scenes"] for rate, _ in _RATES}


def _interval(name: str, column: Column) -> Column:
    def text(row: Mapping[str, Any]) -> str:
        return with_interval(row[name], row[f"{name}_low"], row[f"{name}_high"], row[f"{name}_n"])

    return replace(column, text=text)


def _median() -> Column:
    metric = column_of(ERROR)

    def text(row: Mapping[str, Any]) -> str:
        return f"{shown(row[f'{ERROR}.median'], 3)} (n {row[f'{ERROR}.n']})" if row[f"{ERROR}.n"] else NOTHING

    return Column(f"{ERROR}.median", f"median {metric.label}", metric.unit, "lower", metric.meaning, text)
