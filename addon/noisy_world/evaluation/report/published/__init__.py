# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectory errors printed in the paper, each with its table, system and condition."""

from dataclasses import dataclass
from functools import cache
from typing import Any

from ....core.regular_files import read_bytes
from ....core.shipped import PACKAGE
from ....core.yaml_reading import read_yaml
from ...study.cases import CLEAN
from ..paper_conditions import PaperCondition, paper_condition

FILE = PACKAGE / "evaluate" / "noisy_replica.yaml"
UNACCEPTABLE = "x"
WITH_FAILURES = "F"
UNITS = {"ate": "m", "rpe": "rad", "sr": ""}
"""rpe is printed in metres; the code published with the paper takes the angle between consecutive keyframes."""

MARKS = {
    UNACCEPTABLE: "printed as a cross: an ATE of 1 m or more",
    WITH_FAILURES: "printed with F: the mean with runs that failed counted as 1 m",
}


@dataclass(frozen=True)
class Printed:
    """A number of the paper.

    metric: a name of UNITS. value: None where a mark stands instead of it. spread: the standard deviation beside it, if
    there is one. mark: "" or one of MARKS. severities: those that the number is the mean of; () where there are none.
    """

    label: str
    metric: str
    system: str
    paper_condition: PaperCondition
    severities: tuple[int, ...]
    value: float | None
    spread: float | None
    mark: str


@dataclass(frozen=True)
class Published:
    """What was typed of a paper. notes: misprints, by label of the table and mode."""

    paper: str
    data: str
    numbers: tuple[Printed, ...]
    notes: tuple[tuple[str, str, str], ...]

    def find(self, system: str, where: PaperCondition, metric: str) -> Printed | None:
        """Return the number of a system under a treatment; None where the paper has none.

        Without perturbation, the number of the first table that has one.
        """
        return _by_key(self).get((system, where, metric))


@cache
def published() -> Published:
    """Return the paper's numbers."""
    document = read_yaml(read_bytes(FILE), FILE)
    columns = document["columns"]
    numbers = [number for table in document["tables"] for number in _numbers(table, columns[table["columns"]])]
    notes = [
        (table["label"], table.get("mode", ""), note) for table in document["tables"] for note in table.get("notes", ())
    ]
    return Published(document["paper"], document["data"], tuple(numbers), tuple(notes))


@cache
def _by_key(of: Published) -> dict[tuple[str, PaperCondition, str], Printed]:
    found: dict[tuple[str, PaperCondition, str], Printed] = {}
    for number in of.numbers:
        found.setdefault((number.system, number.paper_condition, number.metric), number)
    return found


def _numbers(table: dict[str, Any], columns: list[str]) -> list[Printed]:
    conditions = [_condition(text, table.get("mode", "")) for text in columns]
    numbers = []
    for system, values in table["rows"].items():
        spreads = table.get("spread", {}).get(system, [None] * len(values))
        for where, given, spread in zip(conditions, values, spreads, strict=True):
            value, mark = _value(given)
            severities = () if where.perturbation == CLEAN else tuple(table.get("severities", ()))
            numbers.append(Printed(table["label"], table["metric"], system, where, severities, value, spread, mark))
    return numbers


def _condition(text: str, mode: str) -> PaperCondition:
    name, *pairs = text.split()
    parameters = {key: float(value) for key, _, value in (pair.partition("=") for pair in pairs)}
    return paper_condition(name, mode, parameters)


def _value(given: float | str) -> tuple[float | None, str]:
    if isinstance(given, str):
        if given == UNACCEPTABLE:
            return None, UNACCEPTABLE
        return float(given.removesuffix(WITH_FAILURES)), WITH_FAILURES
    return float(given), ""
