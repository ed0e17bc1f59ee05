# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of the analyses as the report shows them: a number and its interval share a cell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from ..analysis.run_table import SUCCESS, SUCCESS_OVER_CLEAN
from ..analysis.tables import CAPTIONS
from ..metrics.success import IS_INCOMPLETE
from .contents import Section
from .figures.correlations import Correlation, correlation_matrices
from .figures.curves import CurvePoint, curves
from .figures.drawing import Picture
from .labels import SHARED, column_of
from .reading import records
from .tables import NOTHING, Column, Table, shown

if TYPE_CHECKING:
    from pandas import DataFrame

Analyses: TypeAlias = Mapping[str, "DataFrame"]

TITLES = {
    "over_clean": "Error over clean",
    "spread": "Every measure of each system and setting",
    "variance": "Scene, seed and chance",
    "differences": "Differences from clean",
    "tests": "Tests against clean",
    "curves": "Over severity",
    "systems": "Each system over all perturbed settings",
    "by_perturbation": "Each perturbation",
    "by_mode": "Static and dynamic",
    "by_severity": "Each severity",
    "robustness": "Resilience and corruption error",
    "perturbation_correlations": "Perturbations with one another",
    "system_correlations": "Systems with one another",
    "indicator_correlations": "Errors and what the sequences are like",
    "prediction": "Predicting failure",
    "prediction_coefficients": "What the prediction goes by",
    "predictions": "What was predicted of each sequence",
    "images": "Images",
    "depth": "Depth",
    "motion": "Motion",
}
SECTIONS = {
    "robustness": ("Robustness", ("robustness", "systems", "by_perturbation", "by_mode", "by_severity", "curves")),
    "differences": ("Against clean", ("over_clean", "differences", "tests")),
    "correlations": ("Correlations", ("perturbation_correlations", "system_correlations", "indicator_correlations")),
    "prediction": ("Can the data alone tell?", ("prediction", "prediction_coefficients", "predictions")),
    "data": ("What the sequences are like", ("images", "depth", "motion")),
    "spread": ("All measures", ("variance", "spread")),
}
"""Parts of the report with the tables that are in them; a table that is named nowhere comes last."""
INTERVALS = (
    ("ratio", "ratio_low", "ratio_high"),
    ("mrr", "mrr_low", "mrr_high"),
    ("mce", "mce_low", "mce_high"),
    ("auc", "auc_low", "auc_high"),
    ("pearson_log10", "low_log10", "high_log10"),
    ("pearson", "low", "high"),
    ("difference", "low", "high"),
    ("mean", "low", "high"),
)
"""Columns that share a cell: a number and the ends of its 95 % interval; a column is in the first of them alone."""
COUNTED = {"pearson": "n", "pearson_log10": "n"}
"""Which column says how many values an interval of scenes at large stands on; of all others it is n_scenes."""
FEWEST = 5
"""Values on which an interval has to stand to be shown: with fewer it is so wide that it says nothing."""
FLAT = 0.05
HERE = ("here_low", "here_high")
MOST_SHOWN = 600  # rows of a table in the page, which would be megabytes
SHOWN = (SUCCESS, "ate_rmse_m", "success_auc")
"""The measures whose rows are shown where all would be too many."""
LABELS = {
    "n_runs": ("runs", "all of them, failed and incomplete ones too"),
    "n_failed": ("failed", ""),
    "n": ("n", "values that the number is made of"),
    "n_scenes": ("scenes", ""),
    "n_settings": ("settings", ""),
    "n_cells": ("scenes \u00d7 settings", ""),
    "n_perturbations": ("perturbations", ""),
    "standard_deviation": ("standard deviation", "of an error the factor of one"),
    "average": ("kind of mean", ""),
    "n_incomplete": ("incomplete", f"runs that {IS_INCOMPLETE}"),
    "n_without_success": ("without success", "failed and incomplete ones too"),
    "ate_m": ("ATE [m]", "the geometric mean"),
    "clean_ate_m": ("clean ATE [m]", "the geometric mean of the clean runs beside them"),
    "over_clean": ("over clean", "the one over the other"),
    "clean_mean": ("clean", "the mean without perturbation, in the same scenes"),
    "mrr": ("mRR", "mean resilience rate: the score over the own clean score; 1 is unimpaired"),
    "mce": ("mCE", "mean corruption error: the error over the baseline's; 1 is its equal"),
    "ratio": ("ratio", "of geometric means, to clean"),
    "p_holm": ("p, Holm", "that of no difference over scenes, corrected for the number of the system's settings"),
    "a": ("one", ""),
    "b": ("other", ""),
    "outcome": ("success", "what is predicted not to be"),
    "held_out": ("scene left out", "the model was fitted on the others"),
    "base_rate": ("base rate", "the share without success in the scenes that were fitted"),
    "brier": ("Brier score", "the mean squared error of the probability; 0 is perfect"),
    "brier_base": ("Brier, base rate", "of always predicting the base rate"),
}


def curves_of(analyses: Analyses) -> tuple[list[Picture], list[str]]:
    """Draw curves over severity, and say in a sentence of what would be a straight line why it is not drawn.

    They are the error over clean, the shares of runs without success, and the area under the curve of success.
    """
    pictures, said = [], []
    if over := _over_clean_points(analyses["over_clean"]):
        title = "Error over clean, over severity"
        pictures.append(curves(over, "over_clean_curves", title, "error over clean", over_clean=True))
    for name, picture in ((SUCCESS_OVER_CLEAN, "failure_over_clean_curves"), (SUCCESS, "failure_curves")):
        label = column_of(name).label
        points = [_complement(point) for point in _points(analyses["curves"], name)]
        if points and all(point.value == points[0].value for point in points):
            had = "Every run" if points[0].value == 0.0 else "No run" if points[0].value == 1.0 else ""
            said.append(f"{had or 'The same share of runs'} had {label} at every severity, so no curve is drawn of it.")
        elif points:
            pictures.append(curves(points, picture, f"Share of runs without {label}, over severity", "without success"))
    if areas := _points(analyses["curves"], "success_auc"):
        values = [point.value for point in areas]
        if max(values) - min(values) < FLAT:
            least, most = (shown(value, 3) for value in (min(values), max(values)))
            said.append(f"Success AUC is between {least} and {most} at every severity, so no curve is drawn of it.")
        else:
            pictures.append(curves(areas, "auc_curves", "Success AUC over severity", "success AUC"))
    return pictures, said


def _over_clean_points(table: "DataFrame") -> list[CurvePoint]:
    """Return the error over clean at each severity: the geometric mean of the settings that have it; 1 at 0."""
    import numpy as np

    points = []
    graded = table[table["severity"].notna()]
    for (perturbation, system, mode), of_line in graded.groupby(["perturbation", "system", "mode"], sort=True):
        for severity, rows in of_line.groupby("severity", sort=True):
            broke = 2 * int(rows[["n_failed", "n_incomplete"]].to_numpy().sum()) >= int(rows["n_runs"].sum())
            value = np.inf if broke else float(np.exp(np.log(rows["over_clean"]).mean()))
            if not np.isnan(value):
                n = int(rows["n"].sum())
                points.append(CurvePoint(str(perturbation), str(system), str(mode), float(str(severity)), value, n=n))
    clean = [replace(point, severity=0.0, value=1.0) for point in points if np.isfinite(point.value)]
    return [*dict.fromkeys(replace(point, n=0) for point in clean), *points]


def sections(analyses: Analyses) -> list[Section]:
    """Return the parts of the report that show the analyses."""
    named = {name for _, names in SECTIONS.values() for name in names}
    parts = [*((key, title, names) for key, (title, names) in SECTIONS.items())]
    parts.append(("others", "More", tuple(name for name in analyses if name not in named)))
    pictures = {"correlations": _correlation_pictures(analyses)}
    return [
        Section(key, title, pictures=pictures.get(key, ()), tables=_tables(analyses, names))
        for key, title, names in parts
    ]


def table_of(name: str, frame: "DataFrame") -> Table:
    """Return a table of the analyses as it is shown."""
    caption, page = CAPTIONS.get(name, ""), None
    if "measure" in frame and len(frame) > MOST_SHOWN:
        page = frame[frame["measure"].isin(SHOWN)].head(MOST_SHOWN)
        caption += (
            f" Here are the rows of {', '.join(column_of(measure).label for measure in SHOWN)}; the file has all."
        )
    return Table(name, TITLES.get(name, name), caption, frame, tuple(_columns(frame)), page)


def with_interval(value: Any, low: Any, high: Any, n: float) -> str:
    """Return "0.5 [0.4, 0.6]"; without the brackets where there is no interval, or it stands on fewer than FEWEST."""
    said = shown(value, 3)
    if NOTHING in (said, shown(low)) or not n >= FEWEST:
        return said
    return f"{said} [{shown(low, 3)}, {shown(high, 3)}]"


def _tables(analyses: Analyses, names: Sequence[str]) -> list[Table]:
    return [table_of(name, analyses[name]) for name in names if name in analyses and len(analyses[name])]


def _columns(frame: "DataFrame") -> list[Column]:
    ends: dict[str, tuple[str, str]] = {}
    taken: set[str] = set()
    for name, low, high in INTERVALS:
        if {name, low, high} <= set(frame.columns) and low not in taken:
            ends[name] = low, high
            taken |= {low, high}
    columns = []
    for name in map(str, frame.columns):
        if name in taken or name == HERE[1] or not _says(frame, name):
            continue
        columns.append(_here() if name == HERE[0] else _column(name, ends.get(name)))
    return columns


def _says(frame: "DataFrame", name: str) -> bool:
    """Tell whether a column has a value that is shown."""
    values = frame[name]
    if name == HERE[0]:
        values = values[frame["n"] >= FEWEST]
    return bool((values.notna() & (values != "")).any())


def _column(name: str, ends: tuple[str, str] | None) -> Column:
    label, meaning = LABELS.get(name, (name.replace("_", " "), ""))
    if name in ("measure", "score"):
        return Column(name, label, text=lambda row: column_of(str(row[name])).heading)
    if ends is None:
        return SHARED.get(name) or Column(name, label, meaning=meaning)
    low, high = ends
    counted = COUNTED.get(name, "n_scenes")
    meaning = f"{meaning}; in brackets its 95 % interval, of {FEWEST} values or more".removeprefix("; ")

    def text(row: Mapping[str, Any]) -> str:
        return with_interval(row[name], row[low], row[high], row[counted])

    return Column(name, label, meaning=meaning, text=text)


def _here() -> Column:
    def text(row: Mapping[str, Any]) -> str:
        low, high = (shown(row[name], 3) for name in HERE)
        return NOTHING if low == NOTHING or not row["n"] >= FEWEST else f"[{low}, {high}]"

    return Column(HERE[0], "in these scenes", meaning="the 95 % interval for other seeds in these scenes", text=text)


def _points(table: "DataFrame", measure: str) -> list[CurvePoint]:
    return [
        CurvePoint(
            str(row["perturbation"]),
            str(row["system"]),
            str(row["mode"]),
            severity=float(row["severity"]),
            value=float(row["mean"]),
            large=_ends(row, "low", "high", "n_scenes"),
            here=_ends(row, *HERE, "n"),
            n=int(row["n_runs"]),
        )
        for row in records(table[table["measure"] == measure])
    ]


def _ends(row: Mapping[str, Any], low: str, high: str, counted: str) -> tuple[float, float]:
    """Return the ends of an interval, NaN where it stands on fewer than FEWEST."""
    nothing = float("nan")
    return (float(row[low]), float(row[high])) if row[counted] >= FEWEST else (nothing, nothing)


def _complement(point: CurvePoint) -> CurvePoint:
    """Return the share of the others."""
    large, here = ((1.0 - high, 1.0 - low) for low, high in (point.large, point.here))
    return replace(point, value=1.0 - point.value, large=large, here=here)


def _correlation_pictures(analyses: Analyses) -> list[Picture]:
    pictures = []
    for name, title in (("perturbation_correlations", "Perturbations"), ("system_correlations", "Systems")):
        rows = list(records(analyses[name])) if name in analyses else []
        found = [
            Correlation(str(row["mode"]), str(row["a"]), str(row["b"]), float(row["spearman"]), int(row["n"]))
            for row in rows
        ]
        names = {part for item in found for part in (item.one, item.other)}
        if len(names) > 2 and any(item.value == item.value for item in found):  # a pair's number is in the table
            pictures.append(correlation_matrices(found, name, f"{title} with one another"))
    return pictures
