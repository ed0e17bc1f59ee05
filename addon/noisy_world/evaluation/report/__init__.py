# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a study: HTML, Markdown, CSV, Parquet and LaTeX, from a results folder alone."""

from pathlib import Path

from ...core.requirements import missing_packages, missing_sentence
from ...core.errors import MissingDependencyError

NEEDED = ("pandas", "jinja2", "matplotlib", "tabulate", "scipy")
REMEDY = "install them with: pip install 'noisy-world[evaluate]'"


def write_report(results: Path) -> list[Path]:
    """Write the report of a results folder into it, and return its files.

    Equal folders give equal bytes. Raises InputError where the folder holds no results or a damaged file, StorageError
    where it cannot be written, and MissingDependencyError without the packages of the extra evaluate.
    """
    if missing := missing_packages(NEEDED):
        raise MissingDependencyError(missing_sentence(missing, "", REMEDY))
    from ..analysis.tables import analyse
    from .gathering import gather
    from .paper_tables import paper_tables
    from .published import published
    from .reading import read_results
    from .writing import write_contents

    found = read_results(results)
    analyses = analyse(found.runs, found.sequences)
    return write_contents(gather(found, analyses), paper_tables(found, published()), results)
