# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation's table of severities as nodes: one socket decides all parameters that the table has."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..batches import batched
from ..perturbing.kinds import SEVERITIES, Perturbation
from .graph import Socket, Value
from .group_inputs import socket_name, socket_value


def by_severity(
    perturbation: Perturbation, severity: Socket, override: Socket, own: Mapping[str, Socket]
) -> dict[str, Socket]:
    """Return each parameter of the table at a severity, or `own` where `override` is on.

    Between levels it is interpolated linearly, as Perturbation.at_severity does; at whole levels it is the table's
    value to the bit, and below 1 that of level 1.
    """
    graph = severity.graph
    inputs = {"Value": severity, "Min": float(SEVERITIES[0]), "Max": float(SEVERITIES[-1])}
    level = graph.node("ShaderNodeClamp", inputs, label="Level").out("Result", "float")
    ends = graph.math("FLOOR", level), graph.math("CEIL", level)
    between = graph.math("FRACT", level)
    found: dict[str, Socket] = {}
    for names in batched(perturbation.severities, 3):
        tables = {None: perturbation.severities, **perturbation.other_severities}
        at: dict[str | None, Socket] = {}
        for switch, table in tables.items():
            lower, upper = (_looked_up(perturbation, table, names, end) for end in ends)
            at[switch] = graph.blend(lower, upper, between)
        value = at[None]
        for switch in perturbation.other_severities:
            value = graph.choose(own[switch], at[switch], value, value.kind)
        for name, at_level in zip(names, (value,) if len(names) == 1 else (value.x, value.y, value.z), strict=False):
            whole = graph.math("FLOOR", at_level + 0.5) if name in perturbation.counts else at_level
            found[name] = graph.choose(override, own[name], whole, own[name].kind)
    return found


def _looked_up(
    perturbation: Perturbation, table: Mapping[str, Sequence[float]], names: Sequence[str], level: Socket
) -> Socket:
    """Return the values of up to three parameters at a whole level: one number, or a vector."""
    rows = [
        [socket_value(perturbation, name, float(table[name][place])) for name in names]
        for place in range(len(SEVERITIES))
    ]
    items: list[Value] = [row[0] if len(names) == 1 else tuple((*row, 0.0, 0.0)[:3]) for row in rows]
    inputs: dict[str, Any] = {"Index": level, "Item_0": items[0]}  # there is no level 0
    inputs |= {f"Item_{place}": item for place, item in zip(SEVERITIES, items, strict=True)}
    kind = "FLOAT" if len(names) == 1 else "VECTOR"
    label = ", ".join(socket_name(perturbation, name) for name in names)
    properties = {"data_type": kind, "items": len(items) + 1}
    made = level.graph.node("GeometryNodeIndexSwitch", inputs, properties, label=label)
    return made.out("Output", "float" if len(names) == 1 else "vector")


def strength(severity: Socket, override: Socket, mask: Socket) -> Socket:
    """Return the share of the effect that shows: the mask, faded out below severity 1 unless `override` is on."""
    graph = severity.graph
    fade = graph.math("MINIMUM", severity, 1.0)
    return mask * graph.choose(override, 1.0, fade, "float")
