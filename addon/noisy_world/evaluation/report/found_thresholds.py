# SPDX-License-Identifier: GPL-3.0-or-later
"""Where each system breaks, from searches for thresholds that were kept in the study's folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..thresholds.search import Verdict
from ..thresholds.table import COLUMNS, drawn, read_thresholds, row_of
from .contents import Section
from .labels import SHARED
from .tables import NOTHING, Column, Table, shown

FOLDER = "thresholds"
"""In a results folder, that of the searches."""
DIGITS = 3


def threshold_text(row: Mapping[str, Any]) -> str:
    """Return what was found, of a row of the table: "14.9 [11.6, 18.8] frames", or beyond which value it lies."""
    unit = f" {row['unit']}" if row["unit"] else ""
    mildest, worst = (shown(row[name], DIGITS) for name in ("searched_from", "searched_to"))
    if row["verdict"] == Verdict.HOLDS:
        return f"beyond {worst}{unit}"
    if row["verdict"] == Verdict.FAILS:
        return f"before {mildest}{unit}"
    threshold, low, high = (shown(row[name], DIGITS) for name in ("threshold", "mild_end", "worst_end"))
    low = f"before {mildest}" if low == NOTHING else low
    high = f"beyond {worst}" if high == NOTHING else high
    return f"{threshold} [{low}, {high}]{unit}"


COLUMNS_SHOWN = (
    *(SHARED["perturbation"], Column("parameter", "parameter"), SHARED["system"]),
    Column(
        "threshold",
        "threshold",
        meaning="the value at which success falls to one half; in brackets its 95 % interval",
        text=threshold_text,
    ),
    Column("runs", "runs", meaning="that the search took"),
    Column("success", "success", meaning="the metric that says what a success is"),
)


def threshold_section(results: Path) -> Section | None:
    """Return what the searches in a results folder have found; None where none has ended. Raises StorageError."""
    import pandas as pd

    found = read_thresholds(results / FOLDER)
    if not found:
        return None
    frame = pd.DataFrame(list(map(row_of, found)), columns=list(COLUMNS))
    caption = "The value of a perturbation at which a system's success falls to one half, with its 95 % interval."
    table = Table(FOLDER, "Where each system breaks", caption, frame, COLUMNS_SHOWN)
    return Section(FOLDER, "Thresholds", pictures=[drawn(found)], tables=[table])
