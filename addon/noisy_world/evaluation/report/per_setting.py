# SPDX-License-Identifier: GPL-3.0-or-later
"""A row for each setting and system: what came of its runs, and mean, least and largest of the main metrics with n."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..analysis.run_results import LEFT_OUT, RESULT
from ..metrics import METRICS
from ..metrics.success import FAILED
from ..study.cases import CLEAN
from .labels import column_of
from .reading import Results, records
from .tables import NOTHING, Column, Table, shown

if TYPE_CHECKING:
    from pandas import DataFrame

MAIN = ("ate_rmse_m", "rpe_1s_rmse_m", "rpe_1s_rmse_deg", "tracked_share", "success_auc", "f1_auc")
MAIN_OF_MAPS = ("map.accuracy_m", "map.completion_m", "map.completion_ratio_5cm", "map.depth_l1_m", "map.psnr_db")
SETTING = ("setting", "perturbation", "mode", "severity")
COUNTED_RUNS = ("runs", "failed", "incomplete")
PARTS = {"mean": "mean", "min": "minimum", "max": "maximum", "n": "n"}
"""Of a metric's spread: the ends of the columns here, and the columns of the analyses."""


def settings_table(results: Results, of_all: "DataFrame") -> Table:
    """Return the table. of_all: `spread` of the analyses, whose means are shown."""
    import pandas as pd

    runs = in_order(results.runs)
    metrics = main_metrics(runs)
    known = of_all[of_all["measure"].isin(metrics)]
    spreads = {(row["setting"], row["system"], row["measure"]): row for row in records(known)}
    rows = []
    for (setting, system), group in runs.groupby(["setting", "system"], sort=False):
        row: dict[str, Any] = {name: group.iloc[0][name] for name in SETTING}
        row |= {
            "setting": setting,
            "system": system,
            "scenes": group["scene"].nunique(),
            "seeds": group["seed"].nunique(),
        }
        row |= {**counts(group), "endings": endings(records_of(group))}
        for name in metrics:
            found = spreads.get((setting, system, name), {"n": 0})
            row |= {f"{name}.{part}": found.get(column, float("nan")) for part, column in PARTS.items()}
        rows.append(row)
    columns = [column_of(name) for name in ("setting", "system", *COUNTED_RUNS)]
    columns += [Column("endings", "endings", meaning="how many runs ended how")]
    columns += [spread_column(name) for name in metrics]
    caption = (
        "Mean (least to largest; n) over scenes, which weigh alike, seeds and repeats; of errors the geometric mean. A "
        f"failed run has no error, and counts as 0 in success AUC and F1 AUC. {LEFT_OUT} It counts as 0 in success AUC."
    )
    return Table("settings", "Every setting and system", caption, pd.DataFrame(rows), tuple(columns))


def in_order(runs: "DataFrame") -> "DataFrame":
    """Return runs by setting: clean first, then perturbations by name, mode and severity."""
    first = (runs["perturbation"] != CLEAN).astype(int)
    keys = ["_first", "perturbation", "mode", "severity", "setting", "system"]
    return runs.assign(_first=first).sort_values(keys, kind="stable", ignore_index=True).drop(columns="_first")


def main_metrics(runs: "DataFrame") -> list[str]:
    """Return which of the main metrics, and of installed packages, the runs have; of maps where one was scored."""
    installed = [name for name in METRICS if METRICS.distribution(name)]
    of_maps = [name for name in MAIN_OF_MAPS if name in runs.columns and runs[name].notna().any()]
    return [name for name in (*MAIN, *installed) if name in runs.columns] + of_maps


def counts(group: "DataFrame") -> dict[str, int]:
    """Return how many runs there are, and how many of them failed or are incomplete: COUNTED_RUNS."""
    return {"runs": len(group), **{name: int(group[name].sum()) for name in COUNTED_RUNS[1:]}}


def records_of(group: "DataFrame") -> list[tuple[str, str, str]]:
    """Return outcome, failure and result of each run."""
    return list(group[["outcome", "failure", RESULT]].itertuples(index=False, name=None))


def endings(of: Iterable[tuple[str, str, str]]) -> str:
    """Return how many runs ended how: complete or incomplete; of failed ones the outcome of the system's process or,
    where it finished, why its estimate has no score.
    """
    counted = Counter(
        result if result != FAILED else failure or outcome if outcome == "finished" else outcome
        for outcome, failure, result in of
    )
    return ", ".join(f"{count} {name}" for name, count in sorted(counted.items(), key=lambda item: (-item[1], item[0])))


def spread_column(name: str) -> Column:
    """Return how the four numbers of a metric are shown: in one cell."""
    metric = column_of(name)

    def text(row: Mapping[str, Any]) -> str:
        mean, least, largest, count = (row[f"{name}.{part}"] for part in ("mean", "min", "max", "n"))
        if not count:
            return NOTHING
        return f"{shown(mean, 3)} ({shown(least, 3)} to {shown(largest, 3)}; {count})"

    return Column(f"{name}.mean", metric.label, metric.unit, metric.better, metric.meaning, text)
