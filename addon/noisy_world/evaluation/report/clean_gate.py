# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether each system reached on clean frames what its definition expects, and the mark of all that it did not.

A ratio to a clean error that the baseline made says little of noise, and depth seems not to matter to a system that
errs in scale without any noise. So the report begins with such a system, and marks its name wherever a ratio stands.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING, Any

from ...core.datasets.json_text import finite_number
from ..analysis.run_results import complete_runs
from ..study.cases import CLEAN
from ..study.identity import EXPECTED
from ..systems.definition import ExpectedClean
from .findings import ERROR
from .labels import column_of
from .reading import Results
from .tables import Column, Table

if TYPE_CHECKING:
    from pandas import DataFrame

MARK = "\u2020"
AS_EXPECTED = "clean_as_expected"
"""The column of the files of tables that says of each row's system what the mark says."""
SCALE = "scale"
MOST_SAID = 4  # scenes in a sentence


@dataclass(frozen=True)
class CleanScene:
    """A system's clean runs in a scene. ate_m, scale: medians of complete ones, or None. wrong: what is, in words."""

    system: str
    scene: str
    runs: int
    ate_m: float | None
    scale: float | None
    expected: str
    wrong: str


@dataclass(frozen=True)
class CleanGate:
    """The clean runs of the systems that say what is expected of them."""

    scenes: tuple[CleanScene, ...]

    @property
    def marked(self) -> frozenset[str]:
        """The systems that have a scene in which they did not reach it."""
        return frozenset(scene.system for scene in self.scenes if scene.wrong)

    def name(self, system: str) -> str:
        """Return a system's name, with the mark where it has one."""
        return f"{system} {MARK}" if system in self.marked else system

    @property
    def sentences(self) -> list[str]:
        """A sentence for each system that did not reach it, which stands before all findings."""
        return [self._sentence(system) for system in sorted(self.marked)]

    def _sentence(self, system: str) -> str:
        every = [scene for scene in self.scenes if scene.system == system]
        wrong = [scene for scene in every if scene.wrong]
        said = "; ".join(f"{scene.scene} {scene.wrong}" for scene in wrong[:MOST_SAID])
        more = f"; {len(wrong) - MOST_SAID} more" if len(wrong) > MOST_SAID else ""
        return (
            f"{MARK} {system} does not reach on clean frames what its definition expects ({every[0].expected}), in "
            f"{len(wrong)} of {len(every)} scene{'s' if len(every) > 1 else ''}: {said}{more}. Its ratios to clean are "
            f"marked {MARK}: they are over an error that noise has no part in."
        )

    def of_frames(self, tables: "Mapping[str, DataFrame]") -> "dict[str, DataFrame]":
        """Return tables of the analyses with marked names of systems, as figures show them."""
        return {
            name: table.assign(system=table["system"].map(self.name)) if "system" in table else table
            for name, table in tables.items()
        }

    def of_table(self, table: Table) -> Table:
        """Return a table whose names of systems are marked, and whose file says so in a column of its own."""
        if "system" not in table.frame or not self.marked:
            return table
        columns = tuple(
            replace(column, text=self._cell) if column.name == "system" else column for column in table.columns
        )
        as_expected = [0 if system in self.marked else 1 for system in table.frame["system"]]
        return replace(table, columns=columns, frame=table.frame.assign(**{AS_EXPECTED: as_expected}))

    def _cell(self, row: Mapping[str, Any]) -> str:
        return self.name(str(row["system"]))

    @property
    def table(self) -> Table:
        """A row for each system and scene."""
        from pandas import DataFrame

        names = ["system", "scene", "runs", ERROR, SCALE, "expected", "wrong"]
        rows = [(at.system, at.scene, at.runs, at.ate_m, at.scale, at.expected, at.wrong) for at in self.scenes]
        columns = [column_of("system"), column_of("scene"), Column("runs", "clean runs"), column_of(ERROR)]
        columns += [column_of(SCALE), Column("expected", "expected"), Column("wrong", "what is not as expected")]
        caption = "Medians of complete clean runs in each scene, beside what the system's definition expects of them."
        return Table("clean", "On clean frames", caption, DataFrame(rows, columns=names), tuple(columns))


def clean_gate(results: Results) -> CleanGate:
    """Hold the clean runs of each system against what study.json says that its definition expects."""
    systems = results.study.get("systems")
    scenes: list[CleanScene] = []
    for system, definition in sorted(systems.items()) if isinstance(systems, Mapping) else ():
        expected = _expected(definition)
        if expected is not None:
            runs = results.runs[(results.runs["system"] == system) & (results.runs["perturbation"] == CLEAN)]
            scenes += [_scene(system, str(scene), group, expected) for scene, group in runs.groupby("scene")]
    return CleanGate(tuple(scenes))


def _expected(definition: Any) -> ExpectedClean | None:
    """Return what a system's entry in study.json says of clean runs; None where it says nothing, or no number."""
    said = definition.get(EXPECTED) if isinstance(definition, Mapping) else None
    ate_m = finite_number(said.get("ate_m")) if isinstance(said, Mapping) else None
    return None if ate_m is None or said is None else ExpectedClean(ate_m, finite_number(said.get("scale_off")))


def _scene(system: str, scene: str, runs: "DataFrame", expected: ExpectedClean) -> CleanScene:
    complete = complete_runs(runs)
    ended = len(runs) - len(complete)
    ate_m, scale = _median(complete, ERROR), _median(complete, SCALE)
    lost = [f"failed or was incomplete in {ended} of {len(runs)} clean runs"] if 2 * ended >= len(runs) else []
    wrong = ", ".join([*lost, *expected.unmet(ate_m, scale)])
    return CleanScene(system, scene, len(runs), ate_m, scale, expected.text, wrong)


def _median(runs: "DataFrame", name: str) -> float | None:
    """Return the median of the runs that have a value, None where none has."""
    known = runs[name].dropna().tolist() if name in runs else []
    return median(known) if known else None
