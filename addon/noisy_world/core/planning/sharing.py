# SPDX-License-Identifier: GPL-3.0-or-later
"""Which part of a render's perturbed images is made, and which part is a link to one that another sequence has made."""

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator
from itertools import product
from math import prod

from ..channels import CHANNELS
from ..datasets.layouts import Modality
from ..perturbing.execution import work_key
from ..perturbing.kinds import FrameContext
from .sequence import Sequence

MOST_COMBINATIONS = 1000  # of the severities of a setting's steps; beyond, nothing is taken to be shared


def parts_made(sequences: Iterable[Sequence], modality: Modality) -> dict[str, float]:
    """Return for sequences of one render, by folder, which part of their images of a modality is made, from 0 to 1.

    The rest is clean, as severity 0 leaves it, or made for a sequence before it, which does the same to the frame. That
    is what is expected before severities are drawn: each sequence draws its own, independently. Sequences that do
    nothing to the modality are left out; those that show frames in another order share nothing here.
    """
    found: dict[str, float] = {}
    not_yet: dict[Hashable, float] = {}  # the probability that no sequence so far does this to a frame
    orders: dict[Hashable, int] = {}
    for sequence in sequences:
        if not sequence.setting.on(modality):
            continue
        order = orders.setdefault((sequence.source_frames, sequence.depth_frames), len(orders))
        made = 0.0
        for work, chance in _works(sequence, modality):
            left = not_yet.get((order, work), 1.0)
            made += chance * left
            not_yet[order, work] = left * (1.0 - chance)
        found[sequence.folder] = made
    return found


def _works(sequence: Sequence, modality: Modality) -> Iterator[tuple[Hashable, float]]:
    """Yield what a sequence does to a frame, but for nothing at all, and how probable that is."""
    setting = sequence.setting
    steps = setting.on(modality)
    drawn = [Counter((step.severity,) if step.levels is None else step.levels) for step in steps]
    if prod(map(len, drawn)) > MOST_COMBINATIONS:
        yield setting.name, 1.0
        return
    backend = setting.backend if CHANNELS[modality].steps == "rgb" else ""
    contexts = [step.context(FrameContext(0, sequence.identifiers)) for step in steps]
    for severities in product(*drawn):
        active = zip(steps, contexts, severities, strict=True)
        key = work_key(tuple(item for item in active if item[2] != 0))
        if key:
            chances = (counted[severity] / counted.total() for counted, severity in zip(drawn, severities, strict=True))
            yield (backend, key), prod(chances)
