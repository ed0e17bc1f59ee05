# SPDX-License-Identifier: GPL-3.0-or-later
"""What a study consists of: cases, each a sequence, and the runs of systems on them, by name."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..dataset.identity import RecordedSetting, RecordedStep
from ..perturbations.kinds import MotionPerturbation, PairingPerturbation
from ..perturbations.parsing import Registry

CLEAN = "clean"
"""The setting in which nothing is done, and what is said to be done there."""
RECORDED = "recorded"
"""The setting of a recording, whose folder does not tell of one."""

_CASE = re.compile(r"([^/]+)/([^/]+)/seed-([0-9]+)")


@dataclass(frozen=True, order=True)
class Case:
    """A sequence of a study: a scene in a setting, with a seed."""

    scene: str
    setting: str
    seed: int

    @property
    def name(self) -> str:
        """Its name, which is its folder in the results too: SCENE/SETTING/seed-N."""
        return f"{self.scene}/{self.setting}/seed-{self.seed}"

    @classmethod
    def parse(cls, name: str) -> "Case":
        """Return the case of a name. Raises ValueError for what names none."""
        if (found := _CASE.fullmatch(name)) is None:
            raise ValueError(f"{name!r} is no case; it has to be SCENE/SETTING/seed-N")
        return cls(found[1], found[2], int(found[3]))


@dataclass(frozen=True, order=True)
class SystemRun:
    """A run of a system on a case. repeat: counted from 1."""

    case: Case
    system: str
    repeat: int

    @property
    def name(self) -> str:
        """Its name, which is its folder in the results too: SCENE/SETTING/seed-N/SYSTEM/repeat-K."""
        return f"{self.case.name}/{self.system}/repeat-{self.repeat}"

    @property
    def placeholders(self) -> dict[str, str]:
        """What a system's command may name of it."""
        case = self.case
        return {"scene": case.scene, "setting": case.setting, "seed": str(case.seed), "repeat": str(self.repeat)}


@dataclass(frozen=True)
class Condition:
    """What is done in a setting, in the words of the tables.

    perturbation: the names of its steps, joined by +; CLEAN where there is none. mode: "static" or "dynamic" (where
    it changes from frame to frame); "" where only the motion is another, and where nothing is done. severity: 1 to 5
    where all steps have one and the same, else "".
    """

    perturbation: str
    mode: str
    severity: str

    @classmethod
    def of(cls, setting: Any, known: Registry) -> "Condition":
        """Return the condition of a setting as a dataset's identity has it, which is one that can be read."""
        steps = RecordedSetting.read(setting).steps
        if not steps:
            return cls(CLEAN, "", "")
        name = "+".join(step.name for step in steps)
        return cls(name, _mode(steps, known), _severity(step.severity for step in steps))

    @classmethod
    def of_name(cls, setting: str) -> "Condition":
        """Return the condition of a setting of which nothing but its name is known."""
        return cls(CLEAN if setting in (CLEAN, RECORDED) else setting, "", "")


def _mode(steps: Iterable[RecordedStep], known: Registry) -> str:
    kinds = [known.get(step.name) for step in steps]
    if all(isinstance(kind, MotionPerturbation) for kind in kinds):
        return ""
    dynamic = any(
        step.mode != "static"
        or (isinstance(kind, PairingPerturbation) and (step.parameters[0] or {}).get("mode") == "dynamic")
        for step, kind in zip(steps, kinds, strict=True)
    )
    return "dynamic" if dynamic else "static"


def _severity(severities: Iterable[float | None]) -> str:
    found = set(severities)
    severity = found.pop() if len(found) == 1 else None
    return "" if severity is None else f"{severity:g}"


# Texts in tables of comma-separated values, which people open in spreadsheets: none may be taken for a formula.
#
# A text that begins with = + - @, a tab or a carriage return gets an apostrophe before it, as spreadsheets do for a
# text that is typed in. It is taken off where this program reads its tables. Numbers stay as they are.


_FORMULA = re.compile(r"'*[=+\-@\t\r]")


def cell_of(text: str) -> str:
    """Return a text as it stands in a cell."""
    return f"'{text}" if _FORMULA.match(text) else text


def text_of(cell: str) -> str:
    """Return the text that stands in a cell: what `cell_of` was given."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
