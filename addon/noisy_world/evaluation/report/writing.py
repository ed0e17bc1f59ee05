# SPDX-License-Identifier: GPL-3.0-or-later
"""The report as files: one page of HTML that fetches nothing, Markdown with pictures beside it, tables."""

from collections.abc import Sequence
from pathlib import Path

from ...core.datasets.storage import storage_errors
from ...core.regular_files import read_text
from .contents import Contents
from .paper_tables import LatexFile
from .tables import csv_bytes, latex_table, markdown_table, parquet_bytes
from .templating import FOLDER, environment

OWN = ("runs", "sequences")
"""Tables that the study wrote: the report adds Parquet to them and leaves the rest alone."""
LONGEST_IN_MARKDOWN = 40  # rows; the files have all
LONGEST_OPEN = 60  # rows of a table that is not folded away in the page


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
    parts = {name: read_text(FOLDER / name) for name in ("report.css", "sort.js")}
    template = environment().get_template("report.html.j2")
    return template.render(report=contents, css=parts["report.css"], script=parts["sort.js"], longest_open=LONGEST_OPEN)


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
