# SPDX-License-Identifier: GPL-3.0-or-later
"""A perturbation carried out on arrays by its own node group, for lit frames: both executions show one picture."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.labels import title
from ..core.linear_light import decoded, encoded
from ..core.node_graphs.camera import camera_values
from ..core.node_graphs.graph import Graph
from ..core.node_graphs.group_inputs import PATTERN, seed_of, socket_name, socket_value
from ..core.node_graphs.groups import build_group
from ..core.node_graphs.on_arrays import carried_out, image_of
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.trajectories.camera_state import AT_REST, camera_state_of
from ._bands import by_bands

_GROUPS: dict[str, Graph] = {}  # by the perturbation's name: describing one takes as long as a small frame


def _group(perturbation: ColourPerturbation) -> Graph:
    if perturbation.name not in _GROUPS:
        _GROUPS[perturbation.name] = build_group(perturbation, bare=True, lit=True)
    return _GROUPS[perturbation.name]


def as_nodes(
    perturbation: ColourPerturbation, rgb: NDArray[np.float32], parameters: Any, context: FrameContext
) -> NDArray[np.float32]:
    """Return what the group makes of (H, W, 3), of light of any brightness, encoded; likewise encoded."""
    height, width = rgb.shape[:2]
    given: dict[str, Any] = {
        "Image": by_bands(rgb, rgb.dtype, decoded),
        "Enabled": True,
        "Encoded": False,
        "Reference Width": width,
    }
    if perturbation.needs_depth:
        given["Depth"] = context.depth_m
    if context.intrinsics is not None and perturbation.by_camera is not None:
        parameters = replace(parameters, **perturbation.by_camera(context.intrinsics))
    given |= {
        socket_name(item.name): socket_value(perturbation, item.name, getattr(parameters, item.name))
        for item in fields(parameters)
    }
    if perturbation.uses_motion:
        held = perturbation.goes_with_camera and context.temporal == "fixed"
        given |= camera_values(AT_REST if held else camera_state_of(context.motion))
    given |= {"Seed": seed_of(context.identifiers), "Frame Offset": context.index, PATTERN: title(context.temporal)}
    made = carried_out(_group(perturbation), given)["Image"]
    return by_bands(image_of(made, (height, width)), rgb.dtype, encoded)
