# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys on groups in an artist's own compositor that are told a value for each frame, such as auto-exposure's stops."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.group_inputs import socket_name
from ..core.perturbing.kinds import ColourPerturbation
from .camera_links import Place, groups_within
from .chain_values import clear_keys, key_socket
from .nodes import described_as
from .typed import fcurves_of, set_value

BAKED = "noisy_world_baked"  # of a tree: the keys that were baked, [frame, value] by their sockets' paths, as JSON
CONSTANT = 1e-6  # stops or turns; what changes less is set, not keyed


@dataclass(frozen=True)
class ToldGroup:
    """A group node that is told values for each frame. place: its tree and the node."""

    place: Place
    perturbation: ColourPerturbation

    @property
    def name(self) -> str:
        """What the node is called."""
        _, node = self.place
        return node.label or node.name


def told_groups(own: bpy.types.NodeTree | None, by_group: Mapping[str, ColourPerturbation]) -> list[ToldGroup]:
    """Return the group nodes of a scene's own compositing that have sockets for values of each frame.

    by_group: those perturbations, by the name of their group. Groups inside groups of the user's own are among them, in
    the order in which the compositor has them.
    """
    found: list[ToldGroup] = []
    for tree, node in [] if own is None else groups_within(own):
        group: Any = node.node_tree
        if (perturbation := by_group.get(described_as(group))) is not None:
            found.append(ToldGroup((tree, node), perturbation))
    return found


def bake(group: ToldGroup, frames: range, values: Mapping[str, Sequence[float]]) -> list[str]:
    """Key a group's sockets over scene frames; return the names of those that stay as an artist has set them up.

    values: of each frame, by the perturbation's name for them. What an earlier call keyed is keyed anew, unless it was
    changed since; sockets that are linked, driven or keyed otherwise stay.
    """
    tree, node = group.place
    baked: dict[str, Any] = json.loads(tree.get(BAKED, "{}"))
    left: list[str] = []
    for name, each in values.items():
        socket: Any = node.inputs[socket_name(group.perturbation, name)]
        path = socket.path_from_id("default_value")
        if socket.is_linked or _is_own(tree, path, baked.get(path)):
            left.append(f"{group.name} > {socket.name}")
            continue
        clear_keys(tree, [path])
        numbers = np.array(each, np.float32)
        set_value(socket, float(numbers[0]))
        baked.pop(path, None)
        if np.ptp(numbers) > CONSTANT:
            key_socket(tree, socket, list(zip(frames, numbers.tolist(), strict=True)))
            baked[path] = _keys(tree, path).tolist()
    tree[BAKED] = json.dumps(baked)
    return left


def _is_own(tree: bpy.types.NodeTree, path: str, baked: Any) -> bool:
    """Tell whether a socket is driven, or has keys that are not those that were baked."""
    data = tree.animation_data
    if data is None:
        return False
    if any(curve.data_path == path for curve in data.drivers):
        return True
    keys = _keys(tree, path)
    return len(keys) > 0 and keys.tolist() != baked


def _keys(tree: bpy.types.NodeTree, path: str) -> NDArray[np.float64]:
    """Return (N, 2) frame and value of a socket's keys."""
    data = tree.animation_data
    curves = [] if data is None else [curve for curve in fcurves_of(data) if curve.data_path == path]
    return np.array([point.co[:] for curve in curves for point in curve.keyframe_points], np.float64).reshape(-1, 2)
