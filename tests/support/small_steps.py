# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of a line each, and the steps that carry them."""

from dataclasses import dataclass

import numpy as np

from noisy_world.perturbations.kinds import (
    ColourPerturbation,
    DepthPerturbation,
    FrameContext,
    MotionPerturbation,
    PairingPerturbation,
)
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath, key

SEQUENCE = (7, "room", "setting")
WHERE = FrameContext(3, SEQUENCE)


@dataclass(frozen=True)
class Amount:
    """How much."""

    amount: float = key("how much", default=1.0, minimum=-1000, maximum=1000)


COMMON = {"label": "Label", "order": 10, "parameters": Amount, "severities": {}, "source": "none"}
BY_SEVERITY = {"severities": {"amount": (1, 2, 3, 4, 5)}}


def steps(*perturbations, **values):
    """Steps of these perturbations; values by name."""
    known = {item.name: item for item in perturbations}
    return parse_steps([{item.name: values.get(item.name)} for item in perturbations], ConfigPath("x"), known)


def colour(name, apply, **other):
    return ColourPerturbation(**(COMMON | {"name": name, "stage": "sensor", "apply": apply} | other))


def depth(name, apply, **other):
    return DepthPerturbation(**(COMMON | {"name": name, "apply": apply} | other))


def motion(name, order=10, **other):
    return MotionPerturbation(**(COMMON | {"name": name, "order": order} | other))


def pairing(name, apply, order=10, **other):
    return PairingPerturbation(**(COMMON | {"name": name, "order": order, "apply": apply} | other))


def adding(rgb, parameters, _context):
    return rgb + np.float32(parameters.amount)
