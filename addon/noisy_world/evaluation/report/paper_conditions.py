# SPDX-License-Identifier: GPL-3.0-or-later
"""Conditions of the paper's tables: what two experiments share where their numbers are comparable."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...core.datasets.recorded_setting import RecordedStep
from ..study.cases import CLEAN

PARAMETERS = {
    "faster_motion": ("factor",),
    "motion_deviation": ("rotation_deg", "translation_m"),
    "desync": ("offset",),
}
"""What takes the severity's place, of perturbations that have none."""


@dataclass(frozen=True, order=True)
class PaperCondition:
    """What is done to a sequence, without its severity.

    perturbation: names joined by "+", or "clean". mode: "static" or "dynamic", of clean "". parameters: those of
    PARAMETERS, where it is the only perturbation; unknown is ().
    """

    perturbation: str
    mode: str
    parameters: tuple[tuple[str, float], ...] = ()


def paper_condition(perturbation: str, mode: str, parameters: Mapping[str, Any] | None = None) -> PaperCondition:
    """Return a treatment. mode: "" is static. parameters: others than those of PARAMETERS are left out."""
    if perturbation == CLEAN:
        return PaperCondition(CLEAN, "")
    given = parameters or {}
    kept = tuple((name, float(given[name])) for name in PARAMETERS.get(perturbation, ()) if name in given)
    return PaperCondition(perturbation, mode or "static", kept)


def condition_of_steps(perturbation: str, mode: str, steps: Iterable[RecordedStep]) -> PaperCondition:
    """Return the treatment of a setting. steps: as the identity of a dataset has them."""
    known = [step for step in steps if step.name == perturbation]
    alone = len(known) == 1 and known[0].levels is None
    return paper_condition(perturbation, mode, known[0].parameters[0] if alone else None)
