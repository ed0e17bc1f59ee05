# SPDX-License-Identifier: GPL-3.0-or-later
"""`report`: write a study's report anew, from what is in its folder of results."""

import argparse
from pathlib import Path

from .ending import ended
from .entry import Entry
from .parser import Parser
from .places import folder

NEEDED = ("numpy", "yaml")


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = _parse(arguments, entry)
    return ended(lambda: report(options), entry, needs=NEEDED, stopped="what was written before stays")


def report(options: argparse.Namespace) -> int:
    """Write the tables of runs and sequences from the folder's files, and the report."""
    from ..evaluation.study.results import STUDY, ResultsFolder
    from ..evaluation.study.tables import write_tables

    if (options.results / STUDY).is_file():
        results = ResultsFolder(options.results)
        try:
            write_tables(results)
        finally:
            results.tidy()
    tell_report(options.results)
    return 0


def tell_report(results: Path) -> None:
    """Write the report of a folder of results, and print what it found, what it has to do without and where it is."""
    from ..evaluation.report import write_report

    written = write_report(results)
    for line in written.findings:
        print(line)
    for line in written.missing:
        print(f"missing: {line}")
    print(f"wrote {results / 'report.html'}, and beside it report.md, figures/ and tables/")


def _parse(arguments: list[str], entry: Entry) -> argparse.Namespace:
    parser = Parser(
        prog=entry.name,
        description="Write the report of a study into its folder of results, from what is there: report.html, one page "
        "that opens offline, report.md, figures/ and tables/ as CSV, Parquet (where pyarrow is installed) and LaTeX. "
        "docs/report.md says what each part of it means.",
    )
    parser.add_argument("results", metavar="RESULTS", type=folder, help="the folder that 'noisy-world evaluate' wrote")
    return parser.parse_args(arguments)
