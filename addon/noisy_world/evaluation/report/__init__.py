# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a study: HTML, Markdown, CSV, Parquet and LaTeX, from a results folder alone."""

from dataclasses import dataclass
from pathlib import Path

from ...core.extras import need

NEEDED = ("pandas", "jinja2", "matplotlib", "tabulate", "scipy")


@dataclass(frozen=True)
class WrittenReport:
    """A report. files: what was written. missing: a sentence for each thing that it has to do without.

    findings: what it begins with, in sentences.
    """

    files: tuple[Path, ...]
    missing: tuple[str, ...]
    findings: tuple[str, ...]


def write_report(results: Path) -> WrittenReport:
    """Write the report of a results folder into it.

    Equal folders give equal bytes. Raises InputError where the folder holds no results or a damaged file, StorageError
    where it cannot be written, and MissingDependencyError without the packages of the extra evaluate.
    """
    need(NEEDED, "evaluate")
    from ..analysis.tables import analyse
    from .gathering import gather
    from .paper_tables import paper_tables
    from .published import published
    from .reading import read_results
    from .writing import write_contents

    found = read_results(results)
    contents = gather(found, analyse(found.runs, found.sequences))
    files = write_contents(contents, paper_tables(found, published()), results)
    return WrittenReport(tuple(files), tuple(contents.missing), tuple(contents.findings))
