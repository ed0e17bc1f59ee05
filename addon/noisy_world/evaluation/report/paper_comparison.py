# SPDX-License-Identifier: GPL-3.0-or-later
"""Our numbers beside those that the paper prints, where system, perturbation, mode and parameters correspond."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...core.datasets.recorded_setting import RecordedSetting
from ..analysis.log_scale import geometric_mean
from ..analysis.run_results import complete_runs
from .labels import column_of
from .paper_conditions import PaperCondition, condition_of_steps
from .per_setting import counts
from .published import MARKS, UNITS, Printed, Published
from .reading import Results
from .tables import NOTHING, Column, Table, shown

if TYPE_CHECKING:
    from pandas import DataFrame

OURS = {"ate": "paper.ate_m", "rpe": "paper.rpe_rad", "sr": "paper.sr"}
"""Columns of runs by the metrics of the paper's tables."""
LABELS = {"ate": "ATE", "rpe": "RPE", "sr": "SR"}
STRICT = "ate_rmse_m"


def paper_conditions(results: Results) -> dict[str, PaperCondition]:
    """Return the treatment of each setting, by its name."""
    settings: Mapping[str, Any] = results.study["subject"]["settings"] if results.study else {}
    steps = {name: RecordedSetting.read(content).steps for name, content in settings.items()}
    of_setting = results.runs.drop_duplicates("setting")[["setting", "perturbation", "mode"]]
    return {
        setting: condition_of_steps(perturbation, mode, steps.get(setting, ()))
        for setting, perturbation, mode in of_setting.itertuples(index=False, name=None)
    }


def paper_comparison(results: Results, paper: Published) -> Table | None:
    """Return the table; None where no number corresponds."""
    import pandas as pd

    rows = list(_rows(results, paper))
    if not rows:
        return None
    frame = pd.DataFrame(rows)
    columns = [Column("treatment", "what was done"), Column("mode", "mode"), Column("system", "system")]
    columns += [
        Column("severities", "severities"),
        Column("runs", "runs"),
        column_of("failed"),
        column_of("incomplete"),
    ]
    meaning = "the geometric mean of complete runs"
    columns.append(Column(f"{STRICT}.mean", "ours, strict: ATE RMSE", "m", "lower", meaning))
    for metric, unit in UNITS.items():
        if f"{metric}.printed" in frame.columns:
            columns += [_ours(metric, unit), _printed(metric, unit)]
    columns.append(Column("tables", "tables of the paper"))
    marks = "; ".join(f"{mark}: {meaning}" for mark, meaning in MARKS.items())
    caption = (
        "Ours by protocol paper (mean ± standard deviation over runs, a failed run as 1, 1 and 0, an incomplete one as "
        f"what it is) beside what the paper prints; {marks}. Both are means over the severities of the row, where the "
        f"paper has them. The data differ: the paper's are {paper.data}. Look for agreement in the order of the rows "
        "rather than in digits."
    )
    return Table("beside_the_paper", "Beside the paper's figures", caption, frame, tuple(columns))


def notes(table: Table, paper: Published) -> list[str]:
    """Return the misprints in those of the paper's tables that a table of ours stands beside, a sentence each."""
    labels = {label for text in table.frame["tables"] for label in text.split(", ")}
    return [f"{label}{f', {mode}' if mode else ''}: {note}." for label, mode, note in paper.notes if label in labels]


def label_of(where: PaperCondition) -> str:
    """Return what was done, with its parameters."""
    said = ", ".join(f"{name} {shown(value)}" for name, value in where.parameters)
    return f"{where.perturbation} ({said})" if said else where.perturbation


def _rows(results: Results, paper: Published) -> Iterator[dict[str, Any]]:
    known = paper_conditions(results)
    runs = results.runs.assign(_condition=results.runs["setting"].map(known))
    for where in sorted(set(known.values())):
        for system, group in runs[runs["_condition"] == where].groupby("system", sort=True):
            printed = {metric: paper.find(str(system), where, metric) for metric in UNITS}
            printed = {metric: number for metric, number in printed.items() if number is not None}
            if printed:
                yield _row(where, str(system), group, printed)


def _row(where: PaperCondition, system: str, group: "DataFrame", printed: Mapping[str, Printed]) -> dict[str, Any]:
    wanted = next(iter(printed.values())).severities
    if wanted and group["severity"].isin(wanted).any():
        group = group[group["severity"].isin(wanted)]
    severities = sorted({int(value) if value == int(value) else value for value in group["severity"].dropna()})
    row: dict[str, Any] = {"treatment": label_of(where), "mode": where.mode, "system": system}
    row |= {"severities": ", ".join(map(str, severities)), **counts(group)}
    row["severities_of_paper"] = ", ".join(map(str, wanted))
    row[f"{STRICT}.mean"] = geometric_mean(complete_runs(group)[STRICT].dropna()) if STRICT in group else float("nan")
    for metric, number in printed.items():
        name = OURS[metric]
        if name in group:
            row |= {f"{metric}.ours": group[name].mean(), f"{metric}.ours_std": group[name].std()}
        row |= {
            f"{metric}.printed": number.value,
            f"{metric}.printed_std": number.spread,
            f"{metric}.mark": number.mark,
        }
    row["tables"] = ", ".join(sorted({number.label for number in printed.values()}))
    return row


def _ours(metric: str, unit: str) -> Column:
    def text(row: Mapping[str, Any]) -> str:
        return with_spread(row.get(f"{metric}.ours"), row.get(f"{metric}.ours_std"))

    return Column(f"{metric}.ours", f"ours: {LABELS[metric]}", unit, text=text)


def _printed(metric: str, unit: str) -> Column:
    def text(row: Mapping[str, Any]) -> str:
        mark = row.get(f"{metric}.mark")
        mark = mark if isinstance(mark, str) else ""
        value = with_spread(row.get(f"{metric}.printed"), row.get(f"{metric}.printed_std"))
        return mark if value == NOTHING and mark else value + mark

    return Column(f"{metric}.printed", f"printed: {LABELS[metric]}", unit, text=text)


def with_spread(mean: float | None, deviation: float | None) -> str:
    """Return "0.123 ± 0.045", without a deviation that is not known."""
    said = shown(mean, 3)
    return said if shown(deviation) == NOTHING else f"{said} ± {shown(deviation, 2)}"
