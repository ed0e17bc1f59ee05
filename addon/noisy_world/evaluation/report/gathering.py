# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's contents, from what a results folder holds."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..study.cases import CLEAN
from . import analysed
from .analysed import Analyses, curves_of
from .clean_gate import CleanGate, clean_gate
from .contents import Contents, Section
from .evaluated import again, command, facts, opening
from .figures.heat_map import Scale, heat_map
from .findings import Ranked, SystemFound, found_of, ranking_picture, sentences, times
from .found_thresholds import threshold_section
from .headline import headline_table
from .labels import column_of
from .paper_comparison import notes, paper_comparison
from .per_setting import in_order, main_metrics, settings_table
from .published import published
from .reading import RUN_KEY, Results
from .run_pictures import path_picture, time_picture, worst_frames
from .tables import NOTHING, Table, shown

if TYPE_CHECKING:
    from .figures.drawing import Picture
    from .run_pictures import FramePicture

T = TypeVar("T")

SCORE = "success_auc"
RUN_COLUMNS = (
    *(*RUN_KEY, "perturbation", "mode", "severity", "outcome", "failure", "result"),
    *("frames", "seconds", "processor_s", "peak_memory_bytes"),
)


def gather(results: Results, analyses: Analyses) -> Contents:
    """Return the contents. Raises InputError where a file in the folder cannot be read."""
    missing = list(results.missing)
    paper = published()
    beside = paper_comparison(results, paper)
    found = found_of(results, analyses["over_clean"])
    gate = clean_gate(results)
    named = [replace(item, system=gate.name(item.system)) for item in found]
    pictures, said = curves_of(gate.of_frames(analyses))
    short = [headline_table(results, analyses, found), *([gate.table] if gate.scenes else [])]
    sections = [
        Section("short", "In short", tables=short),
        Section("severity", "Over severity", said, pictures),
        Section(
            "settings",
            "Settings",
            pictures=_some(_heat_map(results, found, gate)),
            tables=[settings_table(results, analyses["spread"])],
        ),
        *_some(threshold_section(results.folder)),
        Section("runs", "Single runs", _RUNS, _run_pictures(results, missing), tables=[_runs_table(results)]),
        Section("frames", "Where it went wrong", _FRAMES, frames=_frames(results, missing)),
    ]
    if beside is not None:
        sections.append(Section("paper", "Beside the paper", notes(beside, paper), tables=[beside]))
    sections += analysed.sections(analyses)
    sections = [replace(part, tables=[gate.of_table(table) for table in part.tables]) for part in sections]
    return Contents(
        "What noise did to SLAM",
        [*gate.sentences, *sentences(named)],
        ranking_picture(named),
        opening(results),
        facts(results),
        [
            part
            for part in sections
            if part.pictures or part.frames or part.tables or (said and part.name == "severity")
        ],
        tuple(dict.fromkeys(missing)),
        again(results),
        command(results),
    )


_RUNS = (
    "Of each system a clean run, the median and the worst of the others that are complete, one that is incomplete, and "
    "one that failed. All are in the results folder, under runs/.",
)
_FRAMES = (
    "Frames nearest to where a system was first lost or erred most, in the sequences of the figure above; on the right "
    "what the system was given, on the left the clean frame, if there is one.",
)


def _heat_map(results: Results, found: Sequence[SystemFound], gate: CleanGate) -> "Picture | None":
    """Draw the error over clean of each setting and system or, where nothing has one, the mean success AUC."""
    runs = in_order(results.runs)
    settings, systems = list(dict.fromkeys(map(str, runs["setting"]))), sorted(set(map(str, runs["system"])))
    values, names = np.full((len(settings), len(systems)), np.nan), [gate.name(system) for system in systems]
    texts = [[NOTHING for _ in systems] for _ in settings]
    if any(item.compared for item in found):
        for item in found:
            column = systems.index(item.system)
            for ranked in item.settings:
                row = settings.index(ranked.setting)
                values[row, column], texts[row][column] = _cell(ranked)
        for row in [row for row, setting in enumerate(settings) if np.isnan(values[row]).all() and setting == CLEAN]:
            del settings[row], texts[row]
            values = np.delete(values, row, axis=0)
        return heat_map(settings, names, values, texts, Scale.OVER_CLEAN) if settings else None
    if SCORE not in results.runs:
        return None
    for (setting, system), group in runs.groupby(["setting", "system"], sort=False):
        row, column = settings.index(str(setting)), systems.index(str(system))
        values[row, column] = group[SCORE].mean()
        said = ", ".join(f"{group[name].sum()} {name}" for name in ("failed", "incomplete") if group[name].any())
        texts[row][column] = shown(group[SCORE].mean(), 2) + (f", {said} of {len(group)}" if said else "")
    return heat_map(settings, names, values, texts, Scale.SCORE)


def _cell(ranked: Ranked) -> tuple[float, str]:
    """Return the value that a cell's colour stands for, infinite for a failure, and its text."""
    if ranked.broke:
        return float("inf"), ranked.endings
    if ranked.over_clean is None:
        return float("nan"), NOTHING
    return ranked.over_clean, times(ranked.over_clean) + (f", {ranked.endings}" if ranked.endings else "")


def _run_pictures(results: Results, missing: list[str]) -> "list[Picture]":
    if results.of_record:
        return []
    return [picture for draw in (path_picture, time_picture) if (picture := draw(results, missing))]


def _frames(results: Results, missing: list[str]) -> "list[FramePicture]":
    return [] if results.of_record else worst_frames(results, missing)


def _runs_table(results: Results) -> Table:
    """Return all runs, with the metrics."""
    names = [name for name in RUN_COLUMNS if name in results.runs]
    metrics = main_metrics(results.runs)
    columns = tuple(column_of(str(name)) for name in (*names, *metrics))
    caption = "A row for each run, with the main metrics; the file has all."
    return Table("runs", "All runs", caption, results.runs, columns)


def _some(item: T | None) -> list[T]:
    return [] if item is None else [item]
