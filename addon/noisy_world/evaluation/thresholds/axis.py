# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of a perturbation among which a threshold is searched, from the mildest to the worst."""

import math
from dataclasses import dataclass, fields
from typing import get_type_hints

from ...core.errors import NoisyWorldError
from ...core.perturbing.kinds import Perturbation
from ...core.schema import ConfigPath, KeyInfo, allowed_range, number_text, unknown_name

SEVERITY = "severity"
OF_SEVERITY = KeyInfo("severity", minimum=1, maximum=5)
PLACES = 31
"""At most so many values are tried. Chosen: a fifth of the asked width apart, or less."""
BEYOND = 4.0
"""How far a search goes beyond the values of severities 1 and 5 where nothing is said, as a factor. Chosen."""
DIGITS = 4


@dataclass(frozen=True)
class Axis:
    """A parameter's values. mild, worst: its ends; either may be the larger. whole: whether they are whole numbers.

    logarithmic: whether places between the ends are in proportion to the value's logarithm.
    """

    perturbation: str
    parameter: str
    unit: str
    mild: float
    worst: float
    logarithmic: bool
    whole: bool

    @property
    def name(self) -> str:
        """Its name, which is a folder's too."""
        return f"{self.perturbation}.{self.parameter}"

    def value_at(self, place: float) -> float:
        """Return the value at a place, from 0 (the mildest) to 1 (the worst)."""
        low, high = self._scaled(self.mild), self._scaled(self.worst)
        scaled = low + place * (high - low)
        return math.exp(scaled) if self.logarithmic else scaled

    def place_of(self, value: float) -> float:
        """Return the place of a value."""
        low, high = self._scaled(self.mild), self._scaled(self.worst)
        return (self._scaled(value) - low) / (high - low)

    def tried(self) -> list[float]:
        """Return the values that may be tried, from the mildest to the worst, each once."""
        found = [self.mild, *(self._rounded(self.value_at(k / (PLACES - 1))) for k in range(1, PLACES - 1)), self.worst]
        return list(dict.fromkeys(found))

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{number_text(float(f'{value:.3g}'))}{f' {self.unit}' if self.unit else ''}"

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value

    def _rounded(self, value: float) -> float:
        return round(value) if self.whole else float(f"{value:.{DIGITS}g}")


def axis_of(kind: Perturbation, parameter: str | None, mild: float | None, worst: float | None) -> Axis:
    """Return the axis of a perturbation's parameter.

    parameter: None for the severity or, where it has none, its only number. mild, worst: None for what the table of
    severities says and BEYOND. Raises InputError and NoisyWorldError in a line that names the option.
    """
    hints = get_type_hints(kind.parameters)
    known: dict[str, KeyInfo] = {
        item.name: item.metadata["key"] for item in fields(kind.parameters) if hints[item.name] in (int, float)
    }
    if parameter is None:
        parameter = _usual(kind, list(known))
    if parameter == SEVERITY and kind.severities:
        info, table = OF_SEVERITY, (1.0, 5.0)
    elif parameter in known:
        info, table = known[parameter], kind.severities.get(parameter, ())
    else:
        names = [*([SEVERITY] if kind.severities else []), *known]
        raise unknown_name(ConfigPath("--parameter"), f"number of {kind.name}", parameter, names)
    whole = hints.get(parameter) is int
    for option, value in (("--from", mild), ("--to", worst)):
        if whole and value is not None and not value.is_integer():
            problem = f"{option}: {value:g} is no value of {kind.name}.{parameter}"
            raise NoisyWorldError(problem, remedy="give a whole number")
    mild, worst = _ends(f"{kind.name}.{parameter}", info, [float(value) for value in table], (mild, worst))
    logarithmic = parameter != SEVERITY and min(mild, worst) > 0
    return Axis(kind.name, parameter, info.unit, mild, worst, logarithmic, whole)


def _usual(kind: Perturbation, numbers: list[str]) -> str:
    if kind.severities:
        return SEVERITY
    if len(numbers) == 1:
        return numbers[0]
    raise NoisyWorldError(f"{kind.name} has no severity", remedy=f"name one of {', '.join(numbers)} with --parameter")


def _ends(
    name: str, info: KeyInfo, table: list[float], given: tuple[float | None, float | None]
) -> tuple[float, float]:
    """Return the mildest and the worst value. name: of the parameter. table: its values at severities."""
    (mild, worst), allowed = given, allowed_range(info)
    steps = len(table) > 1 and table[0] != table[-1]
    if mild is None or worst is None:
        if not steps:
            says = f"no severities say which values of {name} are mild and which are worse"
            raise NoisyWorldError(says, remedy=f"give both --from, the mildest, and --to, the worst ({allowed})")
        factor = 1.0 if info is OF_SEVERITY else BEYOND if table[-1] > table[0] else 1.0 / BEYOND
        mild = _within(info, table[0] / factor) if mild is None else mild
        worst = _within(info, table[-1] * factor) if worst is None else worst
    for option, value in (("--from", mild), ("--to", worst)):
        if (
            not math.isfinite(value)
            or value != _within(info, value)
            or (info.above is not None and value <= info.above)
        ):
            raise NoisyWorldError(f"{option}: {value:g} is no value of {name}", remedy=f"allowed: {allowed}")
    if mild == worst:
        raise NoisyWorldError(f"--from and --to are both {mild:g}", remedy="give two values between which to search")
    if steps and (worst - mild) * (table[-1] - table[0]) < 0:
        said = f"{name} is worse the {'larger' if table[-1] > table[0] else 'smaller'} it is"
        raise NoisyWorldError(f"--from {mild:g} --to {worst:g}: {said}", remedy="give the milder value with --from")
    return mild, worst


def _within(info: KeyInfo, value: float) -> float:
    value = value if info.minimum is None else max(value, info.minimum)
    return value if info.maximum is None else min(value, info.maximum)
