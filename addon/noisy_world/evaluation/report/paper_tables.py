# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables in the shape of the paper's: systems as rows, what was done as columns, ready for LaTeX."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..analysis.log_scale import geometric_deviation, geometric_mean
from ..analysis.run_results import complete_runs
from ..metrics.success import IS_INCOMPLETE
from ..study.cases import CLEAN
from .escaping import latex
from .paper_comparison import LABELS, OURS, STRICT, paper_conditions, with_spread
from .paper_conditions import PaperCondition
from .published import Printed, Published
from .reading import Results
from .tables import NOTHING, latex_tabular, shown

if TYPE_CHECKING:
    from pandas import DataFrame

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
    said = latex(SHORT.get(where.perturbation, where.perturbation).replace("_", " "))
    values = []
    for name, value in where.parameters:
        before, after = UNITS_SHOWN[name]
        values.append(f"{before}{shown(value)}{after}")
    return " ".join([*([said] if said else []), *values]) or latex(where.perturbation)


def _body(measure: str, every: Sequence[PaperCondition], runs: "DataFrame", paper: Published) -> Iterator[list[str]]:
    printed_as = {column: metric for metric, column in OURS.items()}.get(measure, "ate")
    for system, group in runs.groupby("system", sort=True):
        yield [latex(str(system)), *(_ours(group[group["_condition"] == where], measure) for where in every)]
        numbers = [paper.find(str(system), where, printed_as) for where in every]
        if any(numbers):
            yield [r"\quad printed", *(_printed(number) for number in numbers)]


def _ours(group: "DataFrame", measure: str) -> str:
    if group.empty:
        return ""
    values = (complete_runs(group) if measure == STRICT else group)[measure].dropna()
    if not len(values):
        said = NOTHING
    elif measure == STRICT:
        factor = geometric_deviation(values)
        said = shown(geometric_mean(values), 3) + (f" \u00d7 {shown(factor, 2)}" if len(values) > 1 else "")
    else:
        said = with_spread(values.mean(), values.std())
    ended = [
        f"{group[name].sum()} {letter}" for name, letter in (("failed", "F"), ("incomplete", "I")) if group[name].any()
    ]
    return latex(f"{said} ({', '.join(ended)} of {len(group)})" if ended else said)


def _printed(number: Printed | None) -> str:
    if number is None:
        return ""
    if number.value is None:
        return number.mark
    return latex(with_spread(number.value, number.spread) + number.mark)
