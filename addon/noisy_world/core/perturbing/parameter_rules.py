# SPDX-License-Identifier: GPL-3.0-or-later
"""What the parameters of a perturbation have to be."""

from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Literal, get_args, get_origin, get_type_hints


def check_parameters(name: str, parameters: type, *, files: bool) -> None:
    """Raise ValueError where they are no dataclass of keys with defaults, of kinds that presets and sockets know.

    files: whether a text may name a file, which no socket of a node can.
    """
    if not (isinstance(parameters, type) and is_dataclass(parameters)):
        raise ValueError(f"{name}: parameters has to be a dataclass")
    hints = get_type_hints(parameters)
    for item in fields(parameters):
        if "key" not in item.metadata or item.default is MISSING:
            raise ValueError(f"{name}: the parameter {item.name} has to be a key(...) with a default")
        hint = hints[item.name]
        chosen = get_origin(hint) is Literal and all(isinstance(value, str) for value in get_args(hint))
        named = files and hint is str and item.metadata["key"].file is not None and item.default == ""
        if hint not in (float, int, bool) and not chosen and not named:
            more = ', a text "" with the key\'s file' if files else ""
            raise ValueError(
                f"{name}: the parameter {item.name} has to be a float, an int, a bool{more} or a Literal of texts"
            )


def check_no_temporals(name: str, temporals: Sequence[str]) -> None:
    """Raise ValueError where a perturbation that acts on a whole sequence has temporals. name: the perturbation's."""
    if temporals:
        raise ValueError(f"{name}: acts on a whole sequence, so it has no temporals")
