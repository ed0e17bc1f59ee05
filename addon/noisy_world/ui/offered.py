# SPDX-License-Identifier: GPL-3.0-or-later
"""How the perturbations are offered: in two lists, the benchmark's and the physical ones, and in a sentence each."""

from dataclasses import dataclass

from ..core.labels import american, title
from ..core.perturbing.kinds import Perturbation
from ..perturbations import registry
from .document import OWN_FIELDS


@dataclass(frozen=True)
class Offered:
    """A list of perturbations. name: of its menu. said: what is in it, in a line."""

    name: str
    label: str
    said: str


PHYSICAL = Offered("physical", "Physical", "Of the scene's air and light, the lens, the sensors")
BENCHMARK = Offered("benchmark", "Benchmark", "The paper's: laid over images, depth and path")
PACKAGES = Offered("packages", "Packages", "Of packages that are installed")


def list_of(perturbation: Perturbation) -> Offered:
    """Return the list that a perturbation is offered in."""
    if perturbation.distribution:
        return PACKAGES
    return BENCHMARK if perturbation.about.of_paper else PHYSICAL


def offered(chosen: Offered) -> list[Perturbation]:
    """Return what a list offers, in the order of propagation: what has no fields of its own in the panel."""
    return [item for item in registry().values() if list_of(item) == chosen and item.name not in OWN_FIELDS]


def line_on(perturbation: Perturbation) -> str:
    """Return which list a perturbation is of, what it does, and its physical twin, where it has one."""
    line = f"{list_of(perturbation).label}: {american(perturbation.sentence)}"
    twin = registry().get(perturbation.about.twin)
    return line if twin is None else f"{line}. Its physical twin is {title(twin.label)}"


def short_label(perturbation: Perturbation) -> str:
    """Return a perturbation's name for a list that shows its stage beside it."""
    label = perturbation.label.removeprefix("Depth: ").removeprefix("RGB-D ")
    return title(label[0].upper() + label[1:])
