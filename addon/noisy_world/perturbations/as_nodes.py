# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation of scene-linear light carried out on arrays by its own node group: both draw one picture."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.camera_motion import AT_REST, camera_state_of
from ..core.errors import title
from ..core.graph_arrays import carried_out, image_of
from ..core.node_graph import Graph
from .groups import PATTERN, build_group, camera_values, seed_of, socket_name, socket_value
from .kinds import ColourPerturbation, FrameContext

_GROUPS: dict[tuple[Any, ...], Graph] = {}  # describing one takes as long as a small frame


def as_nodes(
    perturbation: ColourPerturbation, light: NDArray[np.float32], parameters: Any, context: FrameContext
) -> NDArray[np.float32]:
    """Return what the group makes of scene-linear light (H, W, 3), of any brightness."""
    nodes = perturbation.nodes
    assert nodes is not None, "it draws light by them"
    given: dict[str, Any] = {"Image": light, "Enabled": True, "Encoded": False, "Reference Width": light.shape[1]}
    if perturbation.needs_depth:
        given["Depth"] = context.depth_m
    if context.intrinsics is not None and nodes.by_camera is not None:
        parameters = replace(parameters, **nodes.by_camera(context.intrinsics))
    given |= {
        socket_name(perturbation, item.name): socket_value(perturbation, item.name, getattr(parameters, item.name))
        for item in fields(parameters)
    }
    if perturbation.uses_motion:
        held = perturbation.goes_with_camera and context.temporal == "fixed"
        given |= camera_values(AT_REST if held else camera_state_of(context.motion))
    if perturbation.temporals:
        given |= {"Seed": seed_of(context.identifiers), "Frame Offset": context.index, PATTERN: title(context.temporal)}
    made = carried_out(_group(perturbation, nodes.capacity, parameters), given)["Image"]
    return np.ascontiguousarray(image_of(made, light.shape[:2]))


def _group(perturbation: ColourPerturbation, capacity: Mapping[str, float], parameters: Any) -> Graph:
    served = {name: max(most, getattr(parameters, name)) for name, most in capacity.items()}
    key = perturbation.name, *served.items()
    if key not in _GROUPS:
        _GROUPS[key] = build_group(perturbation, served, bare=True, lit=True)
    return _GROUPS[key]
