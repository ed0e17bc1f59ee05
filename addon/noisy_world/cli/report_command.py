# SPDX-License-Identifier: GPL-3.0-or-later
"""`report`: write a study's report anew, from what is in its folder of results."""

import argparse

from .ending import ended
from .entry import Entry
from .places import folder

NEEDED = ("numpy", "yaml")


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    options = _parse(arguments, entry)
    return ended(lambda: report(options), entry, needs=NEEDED, stopped="what was written before stays")


def report(options: argparse.Namespace) -> int:
    """Write the report, and say where it is and what it has to do without."""
    from ..evaluation.report import write_report

    written = write_report(options.results)
    for line in written.missing:
        print(f"missing: {line}")
    print(
        f"wrote {options.results / 'report.html'}, report.md, and {len(written.files) - 2} files of tables and figures"
    )
    return 0


def _parse(arguments: list[str], entry: Entry) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog=entry.name,
        description="Write the report of a study into its folder of results, from what is there: report.html, one page "
        "that opens offline, report.md, figures/ and tables/ as CSV, Parquet (where pyarrow is installed) and LaTeX. "
        "docs/report.md says what each part of it means.",
    )
    parser.add_argument("results", metavar="RESULTS", type=folder, help="the folder that 'noisy-world evaluate' wrote")
    return parser.parse_args(arguments)
