# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of the report: what was evaluated, and the analyses' tables and figures as it shows them."""

import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from ..core.errors import one_line
from ..core.progress import counted
from .analyses import CAPTIONS
from .cases import CLEAN, RUN
from .figures import ENDS, HERE_ENDS, LINE, Picture, correlation_matrices, curves
from .metrics import IS_INCOMPLETE, LEAST_TRACKED
from .pose_errors import CONDITIONING, PROTOCOLS, WELL_CONDITIONED, WRONG_DEG
from .report_runs import HeatMap
from .report_tables import KEY, NOTHING, SHARED, Column, Results, Table, cell_text, column_of, read_object, records
from .run_figures import FramePicture
from .study_results import VERSIONS
from .study_tables import SUCCESS, SUCCESS_OVER_CLEAN

if TYPE_CHECKING:
    from pandas import DataFrame


# What the report says, part by part, whatever it is written as.


@dataclass(frozen=True)
class Section:
    """A part of the report. name: of its anchor. grid: what the page shows instead of the part's pictures."""

    name: str
    title: str
    paragraphs: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    frames: Sequence[FramePicture] = ()
    tables: Sequence[Table] = ()
    grid: HeatMap | None = None


@dataclass(frozen=True)
class Contents:
    """The report. findings: what it found, the first sentence before all. ranking: their picture.

    opening: how many runs there are. facts: what was evaluated, label and text. missing: what it has to do without.

    again: how to get it again, in sentences, and a command; "" where none is known. runs: what the page opens of them.
    """

    title: str
    findings: Sequence[str]
    ranking: Picture | None
    opening: str
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    missing: Sequence[str] = field(default=())
    again: Sequence[str] = field(default=())
    command: str = ""
    runs: Mapping[str, Any] = field(default_factory=dict)

    @property
    def pictures(self) -> list[Picture]:
        """All figures, in order; of a part with a grid the page shows that instead."""
        shown = [picture for section in self.sections if section.grid is None for picture in section.pictures]
        return [*([self.ranking] if self.ranking else []), *shown]

    @property
    def tables(self) -> list[Table]:
        """All tables, in order."""
        return [table for section in self.sections for table in section.tables]


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
    pictures, sentences = [], []
    over, alone = _long_lines(_over_clean_points(analyses["over_clean"]))
    if alone:
        had = "has" if len(alone) == 1 else "have"
        sentences.append(f"{_listed(alone)} {had} one severity, which makes no curve: see Settings.")
    if len(over):
        title = "Error over clean, over severity"
        pictures.append(curves(over, "over_clean_curves", title, "error over clean", over_clean=True))
    for name, picture in ((SUCCESS_OVER_CLEAN, "failure_over_clean_curves"), (SUCCESS, "failure_curves")):
        label, points = column_of(name).label, _long_lines(_complement(_points(analyses["curves"], name)))[0]
        if len(points) and (points["value"] == points["value"].iloc[0]).all():
            had = {0.0: "Every run", 1.0: "No run"}.get(points["value"].iloc[0], "The same share of runs")
            sentences.append(f"{had} had {label} at every severity, so no curve is drawn of it.")
        elif len(points):
            pictures.append(curves(points, picture, f"Share of runs without {label}, over severity", "without success"))
    areas, _ = _long_lines(_points(analyses["curves"], "success_auc"))
    if len(areas):
        least, most = areas["value"].min(), areas["value"].max()
        if most - least < FLAT:
            ends = f"{cell_text(least, 3)} and {cell_text(most, 3)}"
            sentences.append(f"Success AUC is between {ends} at every severity, so no curve is drawn of it.")
        else:
            pictures.append(curves(areas, "auc_curves", "Success AUC over severity", "success AUC"))
    return pictures, sentences


def _long_lines(points: "DataFrame") -> "tuple[DataFrame, list[str]]":
    """Return the points of perturbations of which a line has more than two, clean among them, and the others' names."""
    if not len(points):
        return points, []
    most = points.groupby(LINE)["severity"].nunique().groupby("perturbation").max()
    long = set(most[most > 2].index)
    return points[points["perturbation"].isin(long)].reset_index(drop=True), sorted(set(most.index) - long)


def _over_clean_points(table: "DataFrame") -> "DataFrame":
    """Return the error over clean at each severity: the geometric mean of the settings that have it; 1 at 0."""
    import numpy as np
    from pandas import concat

    logs, ended = np.log(table["over_clean"].astype(float)), table["n_failed"] + table["n_incomplete"]
    graded = table.assign(log=logs, ended=ended)[table["severity"].notna()]
    grouped = graded.groupby([*LINE, "severity"])
    sums = grouped[["ended", "n_runs"]].sum()
    value = grouped["log"].mean().map(np.exp).mask(2 * sums["ended"] >= sums["n_runs"], np.inf)
    points = value.dropna().rename("value").reset_index()
    clean = points.loc[np.isfinite(points["value"]), LINE].drop_duplicates().assign(severity=0.0, value=1.0)
    return concat([clean, points], ignore_index=True)


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
    text = cell_text(value, 3)
    if NOTHING in (text, cell_text(low)) or not n >= FEWEST:
        return text
    return f"{text} [{cell_text(low, 3)}, {cell_text(high, 3)}]"


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
        if name in taken or name == HERE_ENDS[1] or not _says(frame, name):
            continue
        columns.append(_here() if name == HERE_ENDS[0] else _column(name, ends.get(name)))
    return columns


def _says(frame: "DataFrame", name: str) -> bool:
    """Tell whether a column has a value that is shown."""
    values = frame[name]
    if name == HERE_ENDS[0]:
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
        low, high = (cell_text(row[name], 3) for name in HERE_ENDS)
        return NOTHING if low == NOTHING or not row["n"] >= FEWEST else f"[{low}, {high}]"

    return Column(
        HERE_ENDS[0], "in these scenes", meaning="the 95 % interval for other seeds in these scenes", text=text
    )


def _points(table: "DataFrame", measure: str) -> "DataFrame":
    """Return the points of a measure's curves; intervals that stand on fewer than FEWEST are left out."""
    points = table[table["measure"] == measure].rename(columns={"mean": "value"})
    for ends, count in ((ENDS, "n_scenes"), (HERE_ENDS, "n")):
        points.loc[points[count] < FEWEST, ends] = float("nan")
    return points


def _complement(points: "DataFrame") -> "DataFrame":
    """Return the share of the others."""
    turned = {"value": "value", "low": "high", "high": "low", "here_low": "here_high", "here_high": "here_low"}
    return points.assign(**{name: 1.0 - points[other] for name, other in turned.items()})


def _correlation_pictures(analyses: Analyses) -> list[Picture]:
    pictures = []
    for name, title in (("perturbation_correlations", "Perturbations"), ("system_correlations", "Systems")):
        table = analyses[name]
        names = set(table[["a", "b"]].to_numpy().ravel())
        if len(names) > 2 and table["spearman"].notna().any():  # a pair's number is in the table
            pictures.append(correlation_matrices(table, name, f"{title} with one another"))
    return pictures


# What was evaluated, and how to get it again: from study.json, the tables, and what single runs recorded.


LONGEST_LIST = 12
ROTATION = "ate_rotation_median_deg"


def opening(results: Results) -> str:
    """Return the report's first sentence."""
    runs, systems = results.runs, results.runs["system"].nunique()
    sequences = runs.drop_duplicates(list(KEY))
    text = (
        f"{counted(len(runs), 'run')} of {counted(systems, 'system')} on {counted(len(sequences), 'sequence')} "
        f"({counted(runs['scene'].nunique(), 'scene')}, {counted(runs['setting'].nunique(), 'setting')}). "
        f"{_ended(runs)}"
        "Means of errors are geometric."
    )
    if SUCCESS in runs:
        successes = int((runs[SUCCESS] == 1.0).sum())
        meaning = f"an ATE below that, with {100 * LEAST_TRACKED:g} % of the frames tracked"
        text += f" {successes} had {column_of(SUCCESS).label}: {meaning}."
    if SUCCESS_OVER_CLEAN in runs:
        noisy = runs[(runs["perturbation"] != CLEAN) & runs[SUCCESS_OVER_CLEAN].notna()]
        if len(noisy):
            successes = int((noisy[SUCCESS_OVER_CLEAN] == 1.0).sum())
            text += (
                f" Of the {len(noisy)} perturbed runs that have a clean one beside them, {successes} had "
                f"{column_of(SUCCESS_OVER_CLEAN).label}: an ATE below ten times the clean one."
            )
    return text + _turned(results) + _nearly_straight(results)


def _ended(runs: "DataFrame") -> str:
    """Return how many runs failed or are incomplete, and what becomes of them; nothing of what did not happen."""
    failed, incomplete = int(runs["failed"].sum()), int(runs["incomplete"].sum())
    text = f"{failed} failed: they gave no estimate, or one that cannot be scored. " if failed else ""
    if incomplete:
        text += (
            f"{incomplete} are incomplete: they {IS_INCOMPLETE}; the error of such a run is of the frames that it did "
            "not give up, and stands in the table of single runs alone. "
        )
    if not text:
        return "All were tracked. "
    return f"{text}They are counted, and are in no mean, median or ratio of an error. "


def _nearly_straight(results: Results) -> str:
    """Return a sentence that marks the scenes whose paths do not say how an estimate is turned; "" for none.

    By the clean runs, or by all where there is none; nothing is said of results whose runs have no such column.
    """
    runs = results.complete
    if CONDITIONING not in runs:
        return ""
    clean = runs[runs["perturbation"] == CLEAN]
    known = (clean if len(clean) else runs).dropna(subset=[CONDITIONING])
    least = known.groupby("scene", sort=True)[CONDITIONING].median()
    marked = [f"{scene} ({ratio:.2g})" for scene, ratio in least.items() if ratio < WELL_CONDITIONED]
    if not marked:
        return ""
    return (
        f" The path does not say how an estimate is turned about itself in {_listed(marked)}: its second extent is so "
        f"many ATEs of clean runs (median), below {WELL_CONDITIONED:g}. Full poses lay rotations and maps there."
    )


def _turned(results: Results) -> str:
    """Return a sentence on each system whose positions are right where its rotations are not; "" for none.

    Nothing is said of results without the column of the conditioning: their rotations were laid by positions alone.
    """
    runs = results.complete
    if SUCCESS not in runs or ROTATION not in runs or CONDITIONING not in runs:
        return ""
    turned = runs[(runs[SUCCESS] == 1.0) & (runs[ROTATION] > WRONG_DEG)]
    return "".join(
        f" In {counted(len(group), 'run')} of {system} the positions are right and the rotations off by more than "
        f"{WRONG_DEG:g} degrees, as where quaternions are written w first and read as x y z w, or where the camera's "
        "axes are others."
        for system, group in turned.groupby("system", sort=True)
    )


def facts(results: Results) -> list[tuple[str, str]]:
    """Return what was evaluated, as labels and texts."""
    runs = results.runs
    rows = [(f"system {system}", _system(results, str(system))) for system in sorted(set(runs["system"]))]
    rows.append(("scenes", _listed(sorted(set(runs["scene"])))))
    rows.append(("settings", _listed(list(dict.fromkeys(results.sequences["setting"])))))
    rows.append(("seeds", _listed(sorted(set(runs["seed"]), key=lambda seed: seed.zfill(20)))))
    frames = results.sequences["frames"] if "frames" in results.sequences else runs.get("frames")
    if frames is not None and frames.notna().any():
        least, most = int(frames.min()), int(frames.max())
        rows.append(("frames of a sequence", str(least) if least == most else f"{least} to {most}"))
    if results.study:
        protocol = PROTOCOLS[results.study["protocol"]]
        rows.append(("protocol", f"{protocol.name}: {protocol.meaning}"))
        rows.append(("stamps", f"poses belong together within {protocol.max_difference_s:g} s"))
    if any(str(name).startswith("paper.") for name in runs.columns):
        faults = "; ".join(fault for _, fault in PROTOCOLS["paper"].faults)
        rows.append(("columns paper.", f"as the published code does it: {faults}"))
    if "processor_s" in runs and runs["processor_s"].notna().any():
        rows.append(("processor time of the systems", f"{runs['processor_s'].sum() / 3600:.3g} h"))
    return rows + _subject(results.study.get("subject"))


def again(results: Results) -> list[str]:
    """Return how to get the report and the results again, in sentences."""
    lines = ["From what is in the folder, 'noisy-world report FOLDER' writes this report anew, to the same bytes."]
    if results.study:
        lines.append(
            "study.json holds everything that decides the results, the preset among it; 'noisy-world evaluate PRESET "
            "--systems ... --out FOLDER' makes them, and what differs from study.json is refused."
        )
    return lines


def command(results: Results) -> str:
    """Return the command that makes the results: the preset's document has to stand in a file; "" if it is unknown."""
    study = results.study
    if not study:
        return ""
    systems = ",".join(sorted(set(results.runs["system"])))
    words = [f"noisy-world evaluate PRESET --systems {shlex.quote(systems)}"]
    if study["seeds"]:
        words.append(f"--seeds {','.join(map(str, study['seeds']))}")
    words += [f"--repeats {study['repeats']}", f"--protocol {study['protocol']}"]
    return one_line(" ".join([*words, "--out FOLDER"]))


def _system(results: Results, system: str) -> str:
    runs = results.runs[results.runs["system"] == system]
    parts = [counted(len(runs), "run"), f"{int(runs['failed'].sum())} failed"]
    parts.append(f"{int(runs['incomplete'].sum())} incomplete")
    repeats = int(runs["repeat"].nunique())
    parts.append(f"{repeats} repeats, as its results differ from run to run" if repeats > 1 else "one repeat")
    of_record = results.study.get(VERSIONS, {}).get(system, {})
    versions = {name: {version} for name, version in of_record.items()}
    for run in records(runs.drop_duplicates("setting").head(LONGEST_LIST)):
        path = results.run_folder(run) / RUN
        systems = read_object(path).get("versions") if path.is_file() else None
        for name, version in (systems if isinstance(systems, Mapping) else {}).items():
            versions.setdefault(str(name), set()).add(str(version))
    if versions:
        parts.append(", ".join(f"{name} {' and '.join(sorted(versions[name]))}" for name in sorted(versions)))
    definition = results.study["systems"].get(system) if results.study else None
    if definition is not None:
        parts.append(f"definition {_digest(definition)}")
    return "; ".join(parts)


def _subject(subject: Any) -> list[tuple[str, str]]:
    """Return what the sequences were made from, as far as it is short enough to be read: study.json has all."""
    if not isinstance(subject, Mapping):
        return []
    rows = []
    for key in ("preset_sha256", "seed", "render", "output", "versions"):
        value = subject.get(key)
        if isinstance(value, Mapping):
            value = ", ".join(f"{name} {_plain(value[name])}" for name in sorted(value) if value[name] is not None)
        if value is not None:
            rows.append(
                (f"preset's {key}" if key in ("seed", "render", "output") else key.replace("_", " "), str(value))
            )
    return rows


def _digest(definition: Any) -> str:
    """Return a definition's digest as study.json has it; of one that stands there whole, the digest of that."""
    if isinstance(definition, str):
        return definition[:16]
    return hashlib.sha256(_plain(definition).encode()).hexdigest()[:16]


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True, ensure_ascii=False)


def _listed(names: Iterable[Any]) -> str:
    every = [str(name) for name in names]
    more = f", ... ({len(every)} in all)" if len(every) > LONGEST_LIST else ""
    return ", ".join(every[:LONGEST_LIST]) + more
