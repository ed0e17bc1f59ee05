# SPDX-License-Identifier: GPL-3.0-or-later
"""What a metric is: a number with a name, a unit, the better direction and its meaning; one of paths has a function."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from .compared import Compared

Better: TypeAlias = Literal["lower", "higher", ""]
Compute: TypeAlias = Callable[[Compared], float | None]


@dataclass(frozen=True)
class Metric:
    """A number that is said of a run. unit: "" where it has none. better: "" where neither way is.

    label: a heading. meaning: a sentence or two, with formula and source where they are not plain.
    """

    name: str
    label: str
    unit: str
    better: Better
    meaning: str


@dataclass(frozen=True)
class TrajectoryMetric(Metric):
    """A metric of an estimate that lies over the truth; a column of a study's tables.

    compute: what was compared -> a finite number, or None where it has no value. of_failed: whether compute is asked
    about failed runs too, of which `failure` says why, and whose poses are not aligned; else such a run has no value.

    Raises ValueError for a name that is none, another `better`, and a label or meaning that is empty.
    """

    compute: Compute
    of_failed: bool = False

    def __post_init__(self) -> None:
        check_described(self)


def check_described(metric: Metric) -> None:
    """Raise ValueError for a name that is none, another `better`, and a label or meaning that is empty."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", metric.name):
        raise ValueError(f"{metric.name!r} is no name: small letters, digits and underscores, a letter first")
    if metric.better not in get_args(Better):
        raise ValueError(f"{metric.name}: better is {metric.better!r}, but has to be lower, higher or empty")
    if not (metric.label and metric.meaning):
        raise ValueError(f"{metric.name}: needs a label and a meaning")
