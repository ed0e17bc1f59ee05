# SPDX-License-Identifier: GPL-3.0-or-later
"""The thresholds of a folder of searches: a table, and a figure by system in the physical unit."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.datasets.storage import storage_errors
from ..report.figures.drawing import Picture
from ..report.figures.thresholds import ThresholdBar, thresholds
from ..study.results import ResultsFolder
from ..study.tables import csv_text
from .axis import Axis
from .search import Found, Verdict
from .trials import ENDING, SearchFile

COLUMNS = (
    *("perturbation", "parameter", "unit", "system", "verdict", "threshold", "mild_end", "worst_end", "runs"),
    *("searched_from", "searched_to", "success"),
)


@dataclass(frozen=True)
class SystemThreshold:
    """What a search that has ended found, of a system. success: the metric."""

    system: str
    found: Found
    success: str


def read_thresholds(folder: Path) -> list[SystemThreshold]:
    """Return what the searches in a folder have found, by perturbation and system. Raises StorageError."""
    found: list[SystemThreshold] = []
    for file in sorted(folder.glob(f"*/*{ENDING}")):
        content = SearchFile(ResultsFolder(file.parent), file.name.removesuffix(ENDING)).read()
        if content is not None and content["found"] is not None:
            identity, values = content["identity"], content["found"]
            at = {**values, "axis": Axis(**values["axis"]), "verdict": Verdict(values["verdict"])}
            found.append(SystemThreshold(identity["system"]["name"], Found(**at), identity["success"]))
    return sorted(found, key=lambda item: (item.found.axis.name, item.system))


def drawn(found: list[SystemThreshold]) -> Picture:
    """Draw thresholds by system, a panel for each parameter."""
    return thresholds([ThresholdBar(item.system, item.found) for item in found])


def write_thresholds(folder: Path) -> list[Path]:
    """Write thresholds.csv and thresholds.svg from the searches in a folder; return the files. Raises StorageError."""
    found = read_thresholds(folder)
    files = {"thresholds.csv": csv_text(map(row_of, found), COLUMNS).encode(), "thresholds.svg": drawn(found).svg}
    for name, data in files.items():
        with storage_errors(folder / name):
            (folder / name).write_bytes(data)
    return [folder / name for name in files]


def row_of(item: SystemThreshold) -> dict[str, Any]:
    """Return a row of the table, by COLUMNS."""
    found, axis = item.found, item.found.axis
    return {
        "perturbation": axis.perturbation,
        "parameter": axis.parameter,
        "unit": axis.unit,
        "system": item.system,
        "verdict": str(found.verdict),
        "threshold": found.threshold,
        "mild_end": found.mild,
        "worst_end": found.worst,
        "runs": found.runs,
        "success": item.success,
        "searched_from": axis.mild,
        "searched_to": axis.worst,
    }
