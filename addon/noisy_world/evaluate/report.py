# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a study: HTML, Markdown, CSV, Parquet and LaTeX, from a results folder alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors
from ..core.file_access import read_text
from ..core.packages import need
from . import report_sections
from .cases import CLEAN
from .figures import Scale, about_cells, cell_colours, heat_map
from .findings import (
    CleanGate,
    Ranked,
    SystemFindings,
    clean_gate,
    findings_of,
    headline_table,
    in_order,
    main_metrics,
    ranking_picture,
    sentences,
    settings_table,
    times,
)
from .paper_comparison import LatexFile, notes, paper_comparison, published
from .report_runs import HeatMap, opened_runs, packed
from .report_sections import Analyses, Contents, Section, again, command, curves_of, facts, opening
from .report_tables import (
    FOLDER,
    NOTHING,
    RUN_KEY,
    Results,
    Table,
    cell_text,
    column_of,
    csv_bytes,
    environment,
    latex_table,
    markdown_table,
    parquet_bytes,
)
from .run_figures import path_picture, time_picture, worst_frames
from .study_changes import changes_section
from .thresholds import threshold_section

if TYPE_CHECKING:
    from .figures import Picture
    from .run_figures import FramePicture


NEEDED = ("pandas", "jinja2", "matplotlib", "tabulate", "scipy")


@dataclass(frozen=True)
class WrittenReport:
    """A report. files: what was written. missing: a sentence for each thing that it has to do without.

    findings: what it begins with, in sentences.
    """

    files: tuple[Path, ...]
    missing: tuple[str, ...]
    findings: tuple[str, ...]


def write_report(results: Path, before: Path | None = None) -> WrittenReport:
    """Write the report of a results folder into it. before: another one, beside whose findings its own are put.

    Equal folders give equal bytes. Raises InputError where the folder holds no results or a damaged file, StorageError
    where it cannot be written, and MissingDependencyError without the packages of the extra evaluate.
    """
    need(NEEDED, "evaluate")
    from .analyses import analyse
    from .paper_comparison import paper_tables, published
    from .report_tables import read_results

    study = read_results(results)
    changes = None if before is None else changes_section(study, read_results(before))
    contents = gather(study, analyse(study.runs, study.sequences))
    if changes is not None:
        first, *others = contents.sections
        findings = [*contents.findings, *changes.paragraphs]
        contents = replace(contents, sections=[first, changes, *others], findings=findings)
    files = write_contents(contents, paper_tables(study, published()), results)
    return WrittenReport(tuple(files), tuple(contents.missing), tuple(contents.findings))


# The report's contents, from what a results folder holds.


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
    findings = findings_of(results, analyses["over_clean"])
    gate = clean_gate(results)
    named = [replace(item, system=gate.name(item.system)) for item in findings]
    pictures, sentences_of_curves = curves_of(gate.of_frames(analyses))
    of_settings = _heat_map(results, findings, gate)
    short = [headline_table(results, analyses, findings), *([gate.table] if gate.scenes else [])]
    sections = [
        Section("short", "In short", tables=short),
        Section("severity", "Over severity", sentences_of_curves, pictures),
        Section(
            "settings",
            "Settings",
            pictures=[of_settings[0]] if of_settings else [],
            tables=[settings_table(results, analyses["spread"])],
            grid=of_settings[1] if of_settings else None,
        ),
        *([thresholds] if (thresholds := threshold_section(results.folder)) else []),
        Section("runs", "Single runs", _RUNS, _run_pictures(results, missing), tables=[_runs_table(results)]),
        Section("frames", "Where it went wrong", _FRAMES, frames=_frames(results, missing)),
    ]
    if beside is not None:
        sections.append(Section("paper", "Beside the paper", notes(beside, paper), tables=[beside]))
    sections += report_sections.sections(analyses)
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
            if part.pictures or part.frames or part.tables or (sentences_of_curves and part.name == "severity")
        ],
        tuple(dict.fromkeys(missing)),
        again(results),
        command(results),
        opened_runs(results),
    )


_RUNS = (
    "Of each system a clean run, the median and the worst of the others that are complete, and, if any, an "
    "incomplete and a failed one. All are in the results folder, under runs/.",
)
_FRAMES = (
    "Frames nearest to where a system was first lost or erred most, in the sequences of the figure above; on the right "
    "what the system was given, on the left the clean frame, if there is one.",
)


def _heat_map(
    results: Results, findings: Sequence[SystemFindings], gate: CleanGate
) -> tuple["Picture", HeatMap] | None:
    """Return the error over clean of each setting and system or, where nothing has one, the mean success AUC."""
    cells = _cells(results, findings)
    if cells is None or not cells.settings:
        return None
    shown = [gate.name(system) for system in cells.systems]
    colours = cell_colours(cells.values, cells.scale)
    grid = HeatMap(cells.settings, cells.systems, shown, cells.texts, colours, about_cells(cells.scale))
    return heat_map(cells.settings, shown, cells.values, cells.texts, cells.scale), grid


@dataclass(frozen=True)
class _Cells:
    """The cells of the heat map. values: (settings, systems), NaN where nothing is known."""

    settings: list[str]
    systems: list[str]
    values: NDArray[np.float64]
    texts: list[list[str]]
    scale: Scale


def _cells(results: Results, findings: Sequence[SystemFindings]) -> _Cells | None:
    runs = in_order(results.runs)
    settings, systems = list(dict.fromkeys(map(str, runs["setting"]))), sorted(set(map(str, runs["system"])))
    values = np.full((len(settings), len(systems)), np.nan)
    texts = [[NOTHING for _ in systems] for _ in settings]
    if any(item.compared for item in findings):
        for item in findings:
            column = systems.index(item.system)
            for ranked in item.settings:
                row = settings.index(ranked.setting)
                values[row, column], texts[row][column] = _cell(ranked)
        for row in [row for row, setting in enumerate(settings) if np.isnan(values[row]).all() and setting == CLEAN]:
            del settings[row], texts[row]
            values = np.delete(values, row, axis=0)
        return _Cells(settings, systems, values, texts, Scale.OVER_CLEAN)
    if SCORE not in results.runs:
        return None
    for (setting, system), group in runs.groupby(["setting", "system"], sort=False):
        row, column = settings.index(str(setting)), systems.index(str(system))
        values[row, column] = group[SCORE].mean()
        counts = ", ".join(f"{group[name].sum()} {name}" for name in ("failed", "incomplete") if group[name].any())
        texts[row][column] = cell_text(group[SCORE].mean(), 2) + (f", {counts} of {len(group)}" if counts else "")
    return _Cells(settings, systems, values, texts, Scale.SCORE)


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


# The report as files: one page of HTML that fetches nothing, Markdown with pictures beside it, tables.


OWN = ("runs", "sequences")
"""Tables that the study wrote: the report adds Parquet to them and leaves the rest alone."""
LONGEST_IN_MARKDOWN = 40  # rows; the files have all
LONGEST_OPEN = 60  # rows of a table that stands in the page itself; longer ones are drawn when they are opened


def write_contents(contents: Contents, sources: Sequence[LatexFile], folder: Path) -> list[Path]:
    """Write everything into a results folder, and return the files. Raises StorageError."""
    files = {"report.html": html(contents).encode(), "report.md": markdown(contents).encode()}
    if contents.ranking is not None:
        files[f"figures/{contents.ranking.name}.svg"] = contents.ranking.svg
    for section in contents.sections:
        files |= {f"figures/{picture.name}.svg": picture.svg for picture in section.pictures}
        files |= {f"figures/{frame.name}.jpg": frame.jpeg for frame in section.frames}
    for table in contents.tables:
        if table.name not in OWN:
            files[f"tables/{table.name}.csv"] = csv_bytes(table.frame)
            files[f"tables/{table.name}.tex"] = latex_table(table).encode()
        if (data := parquet_bytes(table.frame)) is not None:
            files[f"tables/{table.name}.parquet"] = data
    files |= {f"tables/{source.name}.tex": source.text.encode() for source in sources}
    return [_write(folder / name, data) for name, data in sorted(files.items())]


def html(contents: Contents) -> str:
    """Return the page."""
    parts = {name: read_text(FOLDER / name) for name in ("report.css", "report.js")}
    long = {table.name: table for table in contents.tables if len(table.read) > LONGEST_OPEN}
    data = {
        **contents.runs,
        "figures": {picture.name: _texts(picture) for picture in contents.pictures},
        "tables": {name: {"numeric": table.numeric, "rows": table.rows()} for name, table in long.items()},
    }
    template = environment().get_template("report.html.j2")
    return template.render(
        report=contents, css=parts["report.css"], script=parts["report.js"], data=packed(data), long=long
    )


def _texts(picture: "Picture") -> list[str]:
    """Return a figure's shapes: the wide one and, where there is one, that for a phone."""
    return [shape.decode() for shape in (picture.svg, picture.narrow) if shape]


def markdown(contents: Contents) -> str:
    """Return the report in Markdown; of long tables, the first rows."""
    template = environment().get_template("report.md.j2")
    return template.render(report=contents, markdown_table=lambda table: markdown_table(table, LONGEST_IN_MARKDOWN))


def _write(path: Path, data: bytes) -> Path:
    """Write a file under another name and rename it, so that a reader never sees half of it."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(data)
        unfinished.replace(path)
    return path
