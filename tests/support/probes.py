# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations that change nothing and note down what they are told, for tests of what reaches a perturbation."""

import threading
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import noisy_world.perturb
import noisy_world.dataset.plan
from noisy_world.perturbations.kinds import ColourPerturbation, DepthPerturbation, FrameContext
from noisy_world.core.schema import key
from noisy_world.perturbations import registry

COLOUR, DEPTH = "tell_colour", "tell_depth"
BOTH_PROBES = [{COLOUR: {"severity": 2}}, {DEPTH: {"severity": 2}}]


@dataclass(frozen=True)
class Amount:
    """The severity again."""

    amount: float = key("nothing", default=0.0, minimum=0, maximum=9)


@dataclass(frozen=True)
class Received:
    """One call. own, other: the image that is perturbed, and the other one of the context. amount: the severity."""

    context: FrameContext
    own: NDArray[np.generic]
    other: NDArray[np.generic]
    amount: float


@dataclass
class Probes:
    """A perturbation of colour and one of depth. received: what each was given, by name, setting and frame."""

    received: dict[tuple[str, str, int], Received] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def install(self, monkeypatch, *more):
        """Put both into the registry, beside other perturbations."""
        common = {"order": 1, "parameters": Amount, "severities": {"amount": (1, 2, 3, 4, 5)}, "source": "here"}

        def colour(rgb, parameters, context):
            return self._note(COLOUR, context, rgb, context.depth_m, parameters)

        def depth(depth_m, parameters, context):
            return self._note(DEPTH, context, depth_m, context.rgb, parameters)

        ours = (
            ColourPerturbation(
                name=COLOUR, label="C", stage="sensor", needs_depth=True, uses_motion=True, apply=colour, **common
            ),
            DepthPerturbation(name=DEPTH, label="D", needs_rgb=True, apply=depth, **common),
        )
        known = dict(registry()) | {item.name: item for item in (*ours, *more)}
        for module in (noisy_world.dataset.plan, noisy_world.perturb):
            monkeypatch.setattr(module, "registry", lambda: known)

    def _note(self, name, context, own, other, parameters):
        with self.lock:
            self.received[name, context.identifiers[2], context.index] = Received(
                context, own, other, parameters.amount
            )
        return own.copy()

    def of(self, name, setting):
        """What one of them was told in a setting, by frame."""
        found = {frame: told for (by, where, frame), told in self.received.items() if (by, where) == (name, setting)}
        return dict(sorted(found.items()))
