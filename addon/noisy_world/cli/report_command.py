# SPDX-License-Identifier: GPL-3.0-or-later
"""`report`: write a study's report anew, from what is in its folder of results, or in those of its pieces."""

import argparse
from pathlib import Path

from .command import Command
from .entry import Entry
from .parser import Parser
from .places import folder


def _report(options: argparse.Namespace, _: Entry) -> int:
    """Write the tables of runs and sequences from the folders' files, and the report."""
    from ..evaluation.study.results import STUDY, ResultsFolder
    from ..evaluation.study.tables import write_tables
    from ..evaluation.study.written import is_record

    if options.out is not None:
        return _join(options)
    (folder,) = options.results
    results = ResultsFolder(folder)
    if (folder / STUDY).is_file() and not is_record(results):
        try:
            write_tables(results)
        finally:
            results.tidy()
    if options.tables:
        print(f"wrote {results.tables}")
    else:
        tell_report(folder)
    return 0


def _join(options: argparse.Namespace) -> int:
    """Write the record of a study from the folders of its pieces, and its report."""
    from ..evaluation.study.record import joined, read_record, write_record
    from ..evaluation.study.results import ResultsFolder

    pieces = [ResultsFolder(folder) for folder in options.results]
    out = ResultsFolder(options.out)
    try:
        record = joined([(piece, read_record(piece)) for piece in pieces])
        write_record(record, out)
    finally:
        for results in (*pieces, out):
            results.tidy()
    print(f"{len(record.runs)} runs on {len(record.sequences)} sequences, of {len(pieces)} pieces")
    if options.tables:
        print(f"wrote {out.folder / 'study.json'} and {out.tables}")
    else:
        tell_report(out.folder)
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


def _report_options(parser: Parser) -> None:
    parser.add_argument(
        "results",
        metavar="RESULTS",
        type=folder,
        nargs="+",
        help="the folder that 'noisy-world evaluate' wrote; with --out, those of a study's pieces, or their records",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=folder,
        help="the folder of the record of all of it: study.json and the tables of runs and sequences; the report too",
    )
    parser.add_argument("--tables", action="store_true", help="end with the tables of runs and sequences")


def _settle_report(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if len(options.results) > 1 and options.out is None:
        parser.error("several folders are put together in another one: name it with --out")
    return options


REPORT = Command(
    name="report",
    group="evaluate SLAM systems",
    help="write the report of a study anew",
    description="Write the report of a study into its folder of results, from what is there: report.html, one page "
    "that opens offline, report.md, figures/ and tables/ as CSV, Parquet (where pyarrow is installed) and LaTeX. "
    "docs/report.md says what each part of it means. With --out, put a study together that was run in pieces.",
    options=_report_options,
    settle=_settle_report,
    run=_report,
    needs=("numpy", "yaml"),
    stopped="what was written before stays",
)
