# SPDX-License-Identifier: GPL-3.0-or-later
"""A row for each setting and system: how its runs ended, and mean, least and largest of the main metrics with n."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..metrics import METRICS
from .labels import column_of
from .paper_conditions import CLEAN
from .reading import Results
from .tables import NOTHING, Column, Table, shown

if TYPE_CHECKING:
    from pandas import DataFrame

MAIN = ("ate_rmse_m", "rpe_1s_rmse_m", "rpe_1s_rmse_deg", "tracked_share", "success_auc", "f1_auc")
MAIN_OF_MAPS = ("map.accuracy_m", "map.completion_m", "map.completion_ratio_5cm", "map.depth_l1_m", "map.psnr_db")
SETTING = ("setting", "perturbation", "mode", "severity")


def settings_table(results: Results) -> Table:
    """Return the table."""
    import pandas as pd

    runs = in_order(results.runs)
    metrics = main_metrics(runs)
    rows = []
    for (setting, system), group in runs.groupby(["setting", "system"], sort=False):
        row: dict[str, Any] = {name: group.iloc[0][name] for name in SETTING}
        row |= {
            "setting": setting,
            "system": system,
            "scenes": group["scene"].nunique(),
            "seeds": group["seed"].nunique(),
        }
        row |= {"runs": len(group), "failed": int(group["failed"].sum()), "endings": endings(records_of(group))}
        for name in metrics:
            row |= spread(name, group[name])
        rows.append(row)
    columns = [column_of("setting"), column_of("system"), column_of("runs"), column_of("failed")]
    columns += [Column("endings", "endings", meaning="how many runs ended how")]
    columns += [spread_column(name) for name in metrics]
    caption = (
        "Mean (least to largest; n) over scenes, seeds and repeats. A failed run has no error, so it is not in the "
        "mean of an error; it counts as 0 in success AUC and F1 AUC."
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


def records_of(group: "DataFrame") -> list[tuple[str, str]]:
    """Return outcome and failure of each run."""
    return list(group[["outcome", "failure"]].itertuples(index=False, name=None))


def endings(of: Iterable[tuple[str, str]]) -> str:
    """Return how many runs ended how: the system's outcome or, where it finished, why its estimate has no score."""
    counted = Counter(failure or outcome if outcome == "finished" else outcome for outcome, failure in of)
    return ", ".join(f"{count} {name}" for name, count in sorted(counted.items(), key=lambda item: (-item[1], item[0])))


def spread(name: str, values: "Any") -> dict[str, float]:
    """Return mean, least, largest and count of the numbers among some values."""
    known = values.dropna()
    return {
        f"{name}.mean": known.mean(),
        f"{name}.min": known.min(),
        f"{name}.max": known.max(),
        f"{name}.n": len(known),
    }


def spread_column(name: str) -> Column:
    """Return how the four numbers of `spread` are shown: in one cell."""
    metric = column_of(name)

    def text(row: Mapping[str, Any]) -> str:
        mean, least, largest, count = (row[f"{name}.{part}"] for part in ("mean", "min", "max", "n"))
        if not count:
            return NOTHING
        return f"{shown(mean, 3)} ({shown(least, 3)} to {shown(largest, 3)}; {count})"

    return Column(f"{name}.mean", metric.label, metric.unit, metric.better, metric.meaning, text)
