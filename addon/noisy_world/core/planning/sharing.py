# SPDX-License-Identifier: GPL-3.0-or-later
"""How many of a render's perturbed images are made, and how many are links to another sequence's."""

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator
from itertools import product
from math import prod
from typing import TypeAlias

from ..channels import CHANNELS
from ..datasets.layouts import Modality
from ..perturbing.execution import work_key
from ..perturbing.kinds import FrameContext
from ..perturbing.steps import Setting
from .sequence import PlannedSequence

MOST_COMBINATIONS = 1000  # of the severities of a setting's steps; beyond, nothing is taken to be shared


Works: TypeAlias = dict[tuple[str, Modality], tuple[tuple[Hashable, float], ...]]
"""By setting and modality, what a setting does to a frame, but for nothing at all, and how probable each is."""


def parts_made(
    sequences: Iterable[PlannedSequence], modality: Modality, works: Works | None = None
) -> dict[str, float]:
    """Return for sequences of one render, by folder, which part of their images of a modality is made, from 0 to 1.

    The rest is clean, as severity 0 leaves it, or made for a sequence before it, which does the same to the frame. That
    is what is expected before severities are drawn: each sequence draws its own, independently. Sequences that do
    nothing to the modality are left out; those that show frames in another order share nothing here.

    works: what the settings of a plan do, which is found once for all scenes and kept here.
    """
    works = {} if works is None else works
    found: dict[str, float] = {}
    not_yet: dict[Hashable, float] = {}  # the probability that no sequence so far does this to a frame
    orders: dict[Hashable, int] = {}
    for sequence in sequences:
        if not sequence.setting.on(modality):
            continue
        order = orders.setdefault((sequence.source_frames, sequence.depth_frames), len(orders))
        made = 0.0
        name = sequence.setting.name
        if (name, modality) not in works:
            works[name, modality] = tuple(_works(sequence.setting, modality))
        for work, chance in works[name, modality]:
            left = not_yet.get((order, work), 1.0)
            made += chance * left
            not_yet[order, work] = left * (1.0 - chance)
        found[sequence.folder] = made
    return found


class PartsMade:
    """What `parts_made` says of a plan's renders: found once for each, and what its settings do once for all scenes."""

    def __init__(self) -> None:
        """Begin with nothing found."""
        self._works: Works = {}
        self._found: dict[tuple[str, Modality], dict[str, float]] = {}

    def of(self, render: str, sequences: Iterable[PlannedSequence], modality: Modality) -> dict[str, float]:
        """Return it for a render's sequences, by its name."""
        if (render, modality) not in self._found:
            self._found[render, modality] = parts_made(sequences, modality, self._works)
        return self._found[render, modality]


def _works(setting: Setting, modality: Modality) -> Iterator[tuple[Hashable, float]]:
    """Yield what a setting does to a frame, but for nothing at all, and how probable that is."""
    steps = setting.on(modality)
    drawn = [Counter((step.severity,) if step.levels is None else step.levels) for step in steps]
    if prod(map(len, drawn)) > MOST_COMBINATIONS:
        yield setting.name, 1.0
        return
    backend = setting.backend if CHANNELS[modality].steps == "rgb" else ""
    contexts = [step.context(FrameContext(0, (setting.name,))) for step in steps]
    for severities in product(*drawn):
        active = zip(steps, contexts, severities, strict=True)
        key = work_key(tuple(item for item in active if item[2] != 0))
        if key:
            chances = (counted[severity] / counted.total() for counted, severity in zip(drawn, severities, strict=True))
            yield (backend, key), prod(chances)
