# SPDX-License-Identifier: GPL-3.0-or-later
"""Our numbers beside those that the paper prints, where system, perturbation, mode and parameters correspond."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from ..core.file_access import read_bytes
from ..core.packages import PACKAGE
from ..core.schema import read_yaml
from ..dataset.identity import RecordedSetting, RecordedStep
from .cases import CLEAN
from .findings import counts
from .metrics import IS_INCOMPLETE
from .report_tables import NOTHING, Column, Results, Table, cell_text, column_of, latex, latex_tabular
from .study_tables import complete_runs, geometric_deviation, geometric_mean

if TYPE_CHECKING:
    from pandas import DataFrame


# Conditions of the paper's tables: what two experiments share where their numbers are comparable.


PARAMETERS = {
    "faster_motion": ("factor",),
    "motion_deviation": ("rotation_deg", "translation_m"),
    "desync": ("offset",),
}
"""What takes the severity's place, of perturbations that have none."""


@dataclass(frozen=True, order=True)
class PaperCondition:
    """What is done to a sequence, without its severity.

    perturbation: names joined by "+", or "clean". mode: "static" or "dynamic", of clean "". parameters: those of
    PARAMETERS, where it is the only perturbation; unknown is ().
    """

    perturbation: str
    mode: str
    parameters: tuple[tuple[str, float], ...] = ()


def paper_condition(perturbation: str, mode: str, parameters: Mapping[str, Any] | None = None) -> PaperCondition:
    """Return a treatment. mode: "" is static. parameters: others than those of PARAMETERS are left out."""
    if perturbation == CLEAN:
        return PaperCondition(CLEAN, "")
    given = parameters or {}
    kept = tuple((name, float(given[name])) for name in PARAMETERS.get(perturbation, ()) if name in given)
    return PaperCondition(perturbation, mode or "static", kept)


def condition_of_steps(perturbation: str, mode: str, steps: Iterable[RecordedStep]) -> PaperCondition:
    """Return the treatment of a setting. steps: as the identity of a dataset has them."""
    known = [step for step in steps if step.name == perturbation]
    alone = len(known) == 1 and known[0].levels is None
    return paper_condition(perturbation, mode, known[0].parameters[0] if alone else None)


# Trajectory errors printed in the paper, each with its table, system and condition.


FILE = PACKAGE / "evaluate" / "noisy_replica.yaml"
UNACCEPTABLE = "x"
WITH_FAILURES = "F"
UNITS = {"ate": "m", "rpe": "rad", "sr": ""}
"""rpe is printed in metres; the code published with the paper takes the angle between consecutive keyframes."""

MARKS = {
    UNACCEPTABLE: "printed as a cross: an ATE of 1 m or more",
    WITH_FAILURES: "printed with F: the mean with runs that failed counted as 1 m",
}


@dataclass(frozen=True)
class Printed:
    """A number of the paper.

    metric: a name of UNITS. value: None where a mark stands instead of it. spread: the standard deviation beside it, if
    there is one. mark: "" or one of MARKS. severities: those that the number is the mean of; () where there are none.
    """

    label: str
    metric: str
    system: str
    paper_condition: PaperCondition
    severities: tuple[int, ...]
    value: float | None
    spread: float | None
    mark: str


@dataclass(frozen=True)
class Published:
    """What was typed of a paper. notes: misprints, by label of the table and mode."""

    paper: str
    data: str
    numbers: tuple[Printed, ...]
    notes: tuple[tuple[str, str, str], ...]

    def find(self, system: str, where: PaperCondition, metric: str) -> Printed | None:
        """Return the number of a system under a treatment; None where the paper has none.

        Without perturbation, the number of the first table that has one.
        """
        return _by_key(self).get((system, where, metric))


@cache
def published() -> Published:
    """Return the paper's numbers."""
    document = read_yaml(read_bytes(FILE), FILE)
    columns = document["columns"]
    numbers = [number for table in document["tables"] for number in _numbers(table, columns[table["columns"]])]
    notes = [
        (table["label"], table.get("mode", ""), note) for table in document["tables"] for note in table.get("notes", ())
    ]
    return Published(document["paper"], document["data"], tuple(numbers), tuple(notes))


@cache
def _by_key(of: Published) -> dict[tuple[str, PaperCondition, str], Printed]:
    numbers: dict[tuple[str, PaperCondition, str], Printed] = {}
    for number in of.numbers:
        numbers.setdefault((number.system, number.paper_condition, number.metric), number)
    return numbers


def _numbers(table: dict[str, Any], columns: list[str]) -> list[Printed]:
    conditions = [_condition(text, table.get("mode", "")) for text in columns]
    numbers = []
    for system, values in table["rows"].items():
        spreads = table.get("spread", {}).get(system, [None] * len(values))
        for where, given, spread in zip(conditions, values, spreads, strict=True):
            value, mark = _value(given)
            severities = () if where.perturbation == CLEAN else tuple(table.get("severities", ()))
            numbers.append(Printed(table["label"], table["metric"], system, where, severities, value, spread, mark))
    return numbers


def _condition(text: str, mode: str) -> PaperCondition:
    name, *pairs = text.split()
    parameters = {key: float(value) for key, _, value in (pair.partition("=") for pair in pairs)}
    return paper_condition(name, mode, parameters)


def _value(given: float | str) -> tuple[float | None, str]:
    if isinstance(given, str):
        if given == UNACCEPTABLE:
            return None, UNACCEPTABLE
        return float(given.removesuffix(WITH_FAILURES)), WITH_FAILURES
    return float(given), ""


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
    values = ", ".join(f"{name} {cell_text(value)}" for name, value in where.parameters)
    return f"{where.perturbation} ({values})" if values else where.perturbation


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
    text = cell_text(mean, 3)
    return text if cell_text(deviation) == NOTHING else f"{text} ± {cell_text(deviation, 2)}"


# Tables in the shape of the paper's: systems as rows, what was done as columns, ready for LaTeX.


GROUPS = {
    "Blur": ("motion_blur", "defocus_blur", "gaussian_blur", "glass_blur"),
    "Noise": ("gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise"),
    "Environment": ("fog", "frost", "snow", "spatter"),
    "Post-processing": ("brightness", "contrast", "jpeg_compression", "pixelate"),
    "Depth": ("depth_gaussian_noise", "depth_edge_erosion", "depth_random_missing", "depth_range_clipping"),
    "Faster motion": ("faster_motion",),
    "Motion deviations": ("motion_deviation",),
    "Desynchronisation": ("desync",),
}
"""In the order of the paper's columns."""
SHORT = {
    "jpeg_compression": "JPEG",
    "faster_motion": "",
    "motion_deviation": "",
    "desync": "",
    **{name: name.removesuffix("_blur").removesuffix("_noise") for name in GROUPS["Blur"] + GROUPS["Noise"]},
    "depth_gaussian_noise": "gaussian noise",
    "depth_edge_erosion": "edge erosion",
    "depth_random_missing": "random missing",
    "depth_range_clipping": "range clipping",
}
UNITS_SHOWN = {
    "factor": ("", "$\\times$"),
    "rotation_deg": ("", "$^\\circ$"),
    "translation_m": ("", " m"),
    "offset": ("$\\Delta$ ", ""),
}
SETS = {
    "colour": ("Blur", "Noise", "Environment", "Post-processing"),
    "depth": ("Depth",),
    "faster_motion": ("Faster motion",),
    "motion_deviation": ("Motion deviations",),
    "desync": ("Desynchronisation",),
}
MEASURES = {
    STRICT: "ATE RMSE [m], protocol strict",
    **{name: f"{LABELS[key]}, protocol paper" for key, name in OURS.items()},
}


@dataclass(frozen=True)
class LatexFile:
    """A file of LaTeX. name: without the ending."""

    name: str
    text: str


def paper_tables(results: Results, paper: Published) -> list[LatexFile]:
    """Return a table for each set of perturbations, mode and measure that the results have."""
    known = paper_conditions(results)
    runs = results.runs.assign(_condition=results.runs["setting"].map(known))
    sources = []
    for name, groups in SETS.items():
        for mode in ("static", "dynamic"):
            columns = _columns(groups, mode, set(known.values()))
            if columns:
                layout = _Layout(name, mode, columns)
                sources += [_source(layout, measure, runs, paper) for measure in MEASURES if measure in runs]
    return sources


def _columns(groups: Sequence[str], mode: str, known: set[PaperCondition]) -> list[tuple[str, PaperCondition]]:
    return [
        (group, where)
        for group in groups
        for perturbation in GROUPS[group]
        for where in sorted(known)
        if where.perturbation == perturbation and where.mode == mode
    ]


@dataclass(frozen=True)
class _Layout:
    """What a table's columns are: a set of perturbations under a mode, each with the group that it stands in."""

    name: str
    mode: str
    columns: Sequence[tuple[str, PaperCondition]]


def _source(layout: _Layout, measure: str, runs: "DataFrame", paper: Published) -> LatexFile:
    name, mode, columns = layout.name, layout.mode, layout.columns
    clean = PaperCondition(CLEAN, "")
    every = [clean, *(where for _, where in columns)]
    first, second = ["", ""], ["System", "Clean"]
    for group in dict.fromkeys(group for group, _ in columns):
        count = sum(other == group for other, _ in columns)
        first.append(rf"\multicolumn{{{count}}}{{c}}{{{latex(group)}}}")
    second += [_heading(where) for _, where in columns]
    body = list(_body(measure, every, runs, paper))
    key = f"paper_{name}_{mode}_{measure.replace('.', '_')}"
    over = "mean ± standard deviation over the runs that have a number"
    if measure == STRICT:
        over = "geometric mean and, after \u00d7, the factor of one standard deviation, over complete runs"
    caption = (
        f"{MEASURES[measure]}, {name.replace('_', ' ')}, {mode}: {over}; in brackets, how many of how many failed (F) "
        f"or are incomplete (I: {IS_INCOMPLETE}), where some did."
    )
    if any(row[0].endswith("printed") for row in body):
        caption += " Rows marked printed are the paper's own figures, on Replica."
    return LatexFile(key, latex_tabular(key, caption, "l" + "r" * len(every), [first, second], body))


def _heading(where: PaperCondition) -> str:
    text = latex(SHORT.get(where.perturbation, where.perturbation).replace("_", " "))
    values = []
    for name, value in where.parameters:
        before, after = UNITS_SHOWN[name]
        values.append(f"{before}{cell_text(value)}{after}")
    return " ".join([*([text] if text else []), *values]) or latex(where.perturbation)


def _body(measure: str, every: Sequence[PaperCondition], runs: "DataFrame", paper: Published) -> Iterator[list[str]]:
    printed_as = {column: metric for metric, column in OURS.items()}.get(measure, "ate")
    for system, group in runs.groupby("system", sort=True):
        yield [
            latex(str(system)),
            *(_paper_tables_ours(group[group["_condition"] == where], measure) for where in every),
        ]
        numbers = [paper.find(str(system), where, printed_as) for where in every]
        if any(numbers):
            yield [r"\quad printed", *(_paper_tables_printed(number) for number in numbers)]


def _paper_tables_ours(group: "DataFrame", measure: str) -> str:
    if group.empty:
        return ""
    values = (complete_runs(group) if measure == STRICT else group)[measure].dropna()
    if not len(values):
        text = NOTHING
    elif measure == STRICT:
        factor = geometric_deviation(values)
        text = cell_text(geometric_mean(values), 3) + (f" \u00d7 {cell_text(factor, 2)}" if len(values) > 1 else "")
    else:
        text = with_spread(values.mean(), values.std())
    ended = [
        f"{group[name].sum()} {letter}" for name, letter in (("failed", "F"), ("incomplete", "I")) if group[name].any()
    ]
    return latex(f"{text} ({', '.join(ended)} of {len(group)})" if ended else text)


def _paper_tables_printed(number: Printed | None) -> str:
    if number is None:
        return ""
    if number.value is None:
        return number.mark
    return latex(with_spread(number.value, number.spread) + number.mark)
