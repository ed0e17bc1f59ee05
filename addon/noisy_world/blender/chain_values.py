# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of a shown chain's sockets, keyed over the timeline; what a user does inside the chain is left alone."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import bpy
import numpy as np

from ..core.geometry import Intrinsics
from ..core.node_graphs.chain import camera_state_values, shown_values, step_node
from ..core.node_graphs.group_inputs import socket_name
from ..core.perturbing.contexts import Identifiers
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.perturbing.steps import Step
from ..core.trajectories.camera_state import CameraState
from .typed import action_of, fcurves_of, get_value, interpolation, new_action, set_value

LEFT_AT = "noisy_world_left_at"  # of a chain: the values that we gave its sockets, by their paths, as JSON
KEYED = "noisy_world_keyed"  # of a chain: the paths of the sockets that we keyed, as JSON
BUILT_AS = "noisy_world_built_as"  # of a chain: its nodes and links as we made them, as JSON

IndexOf: TypeAlias = Callable[[int], int]
"""A scene frame -> the frame of the sequence that it shows."""

CameraStateAt: TypeAlias = Callable[[int], CameraState]
"""A frame of the sequence -> how the camera stands and moves at it."""

DecidedAt: TypeAlias = Callable[[int], Mapping[str, FrameContext]]
"""A frame of the sequence -> contexts of its steps with what automatics decided, by `step_node`."""


def set_values(
    tree: bpy.types.NodeTree,
    steps: Sequence[Step[ColourPerturbation]],
    frames: Sequence[int],
    identifiers: Identifiers,
    *,
    index_of: IndexOf | None,
    now: int | None,
    intrinsics: Intrinsics | None = None,
    camera_state_at: CameraStateAt | None = None,
    decided_at: DecidedAt | None = None,
    lit: bool = False,
) -> None:
    """Set the sockets of a chain, and key them over `frames` where they change.

    A socket is set only where its value is another than we gave it last, and never where a user has linked or keyed it.
    now: the current scene frame, by default the first. intrinsics: of the camera, if known. stance_at: how it stands
    and moves; without it, its sockets are left alone. decided_at: what automatics decided; without it, as if all
    earlier frames were mid-grey. lit: the chain is of a lit scene.
    """
    if BUILT_AS not in tree:
        tree[BUILT_AS] = _structure(tree)
    left_at: dict[str, Any] = json.loads(tree.get(LEFT_AT, "{}"))
    clear_keys(tree, json.loads(tree.get(KEYED, "[]")))
    taken = _keyed_paths(tree)
    keyed: list[str] = []
    for step in steps:
        node = tree.nodes.get(step_node(step))
        if node is None:  # a user has removed it
            continue
        shown = partial(shown_values, step, identifiers=identifiers, intrinsics=intrinsics, lit=lit)
        told_at = None if step.perturbation.by_frame is None else decided_at
        each = list(
            _values(step, frames, identifiers, index_of, shown, camera_state_at=camera_state_at, decided_at=told_at)
        )
        for name in dict.fromkeys(name for _, sockets in each for name in sockets):
            socket = node.inputs[name]
            path = socket.path_from_id("default_value")
            if socket.is_linked or path in taken:
                continue
            # At frames where a step does nothing, its parameters keep their values.
            known = [(k, sockets[name]) for k, sockets in each if name in sockets]
            past = [value for k, value in known if now is not None and k <= now]
            value = past[-1] if past else known[0][1]
            changes = len({value for _, value in known}) > 1
            before = get_value(socket) if changes else left_at.get(path, get_value(socket))
            # Each assignment makes Blender update everything that uses the group.
            if not _are_equal(before, value):
                set_value(socket, value)
            left_at[path] = value
            if changes:
                key_socket(tree, socket, known)
                keyed.append(path)
    _remember(tree, LEFT_AT, left_at)
    _remember(tree, KEYED, keyed)


def _are_equal(one: Any, other: Any) -> bool:
    """Tell whether two values of a socket are equal: numbers and vectors as it holds them, or items of a menu."""
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return np.array_equal(np.array(one, np.float32), np.array(other, np.float32))


def _remember(tree: bpy.types.NodeTree, name: str, value: Any) -> None:
    text = json.dumps(value)
    if tree.get(name) != text:
        tree[name] = text


def _values(
    step: Step[ColourPerturbation],
    frames: Sequence[int],
    identifiers: Identifiers,
    index_of: IndexOf | None,
    shown: Callable[..., dict[str, Any]],
    *,
    camera_state_at: CameraStateAt | None,
    decided_at: DecidedAt | None,
) -> Iterator[tuple[int, Any]]:
    """Yield scene frames and socket values: those of each frame, or only of the first where all are equal."""
    by_severity: dict[float | None, dict[str, Any]] = {}
    camera_state_at = camera_state_at if step.uses_motion else None
    changes = step.levels is not None or any(item is not None for item in (index_of, camera_state_at, decided_at))
    for k in frames if changes else frames[:1]:
        index = k if index_of is None else index_of(k)
        severity = step.severity_of(step.context(FrameContext(index, identifiers)))
        if decided_at is not None:
            values = shown(index=index, scene_frame=index, decided=decided_at(index).get(step_node(step)))
        else:
            if severity not in by_severity:
                by_severity[severity] = shown(index=index, scene_frame=index)
            values = by_severity[severity]
        if camera_state_at is not None:
            values = values | camera_state_values(step, severity, camera_state_at(index))
        yield k, values | {"Frame Offset": index - k} if "Frame Offset" in values else values


def _keyed_paths(tree: bpy.types.NodeTree) -> set[str]:
    """Return the paths that are keyed or driven."""
    data = tree.animation_data
    if data is None:
        return set()
    return {curve.data_path for curve in (*fcurves_of(data), *data.drivers)}


def clear_keys(tree: bpy.types.NodeTree, ours: Sequence[str]) -> None:
    """Remove the curves that we made, and the action where nothing is left in it."""
    data = tree.animation_data
    if data is None or data.action is None:
        return
    action, curves = data.action, fcurves_of(data)
    if any(curve.data_path not in ours for curve in curves):
        bag = action_bag(tree)
        for curve in [curve for curve in curves if curve.data_path in ours]:
            bag.fcurves.remove(curve)
        return
    tree.animation_data_clear() if not (data.drivers or data.nla_tracks) else setattr(data, "action", None)
    if action.users == 0:
        bpy.data.actions.remove(action)


def action_bag(item: bpy.types.ID) -> bpy.types.ActionChannelbag:
    """Return the curves of a data-block in its action."""
    data = item.animation_data  # pyright: ignore[reportAttributeAccessIssue]  each subclass that is animated has it
    strips = (strip for layer in action_of(item).layers for strip in layer.strips)
    bags = (strip.channelbag(data.action_slot) for strip in strips if isinstance(strip, bpy.types.ActionKeyframeStrip))
    return next(bag for bag in bags if bag is not None)


def key_socket(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, values: list[tuple[int, Any]]) -> None:
    """Key a socket, a number or a vector, with constant interpolation: each value holds until the next key."""
    if tree.animation_data is None or tree.animation_data.action is None:
        new_action(tree, f"{tree.name} severity")
    path = socket.path_from_id("default_value")
    frames = np.array([frame for frame, _ in values], dtype=np.float32)
    numbers = np.array([value for _, value in values], dtype=np.float32).reshape(len(values), -1)
    for part, column in enumerate(numbers.T):
        curve = action_of(tree).fcurve_ensure_for_datablock(tree, path, index=part)
        points = curve.keyframe_points
        points.add(len(values))
        points.foreach_set("co", np.column_stack([frames, column]).ravel())
        points.foreach_set("interpolation", np.full(len(values), interpolation("CONSTANT"), dtype=np.int32))
        curve.update()


# --- what a user did ---


def is_edited(tree: bpy.types.NodeTree) -> bool:
    """Tell whether a chain is other than we left it: a value, a key, a link or a node of it."""
    left_at: dict[str, Any] = json.loads(tree.get(LEFT_AT, "{}"))
    ours = set(json.loads(tree.get(KEYED, "[]")))
    if tree.get(BUILT_AS, "") != _structure(tree) or _keyed_paths(tree) - ours:
        return True
    sockets = {socket.path_from_id("default_value"): socket for socket in _sockets(tree)}
    return any(
        path not in sockets or not _are_equal(get_value(sockets[path]), value)
        for path, value in left_at.items()
        if path not in ours
    )


def kept_by_user(tree: bpy.types.NodeTree, steps: Sequence[Step[ColourPerturbation]]) -> list[str]:
    """Return the sockets for values of each frame that a user has linked or keyed, which therefore stay, by names."""
    taken = _keyed_paths(tree) - set(json.loads(tree.get(KEYED, "[]")))
    found: list[str] = []
    for step in steps:
        node, by_frame = tree.nodes.get(step_node(step)), step.perturbation.by_frame
        if node is None or by_frame is None:
            continue
        sockets = [node.inputs[socket_name(step.perturbation, name)] for name in by_frame.values]
        own = [item for item in sockets if item.is_linked or item.path_from_id("default_value") in taken]
        found += [f"{node.name} > {item.name}" for item in own]
    return found


def _sockets(tree: bpy.types.NodeTree) -> Iterator[bpy.types.NodeSocket]:
    for node in tree.nodes:
        if isinstance(node, bpy.types.CompositorNodeGroup):
            yield from (socket for socket in node.inputs if hasattr(socket, "default_value"))


def _structure(tree: bpy.types.NodeTree) -> str:
    nodes = [[node.name, node.mute, getattr(getattr(node, "node_tree", None), "name", "")] for node in tree.nodes]
    links = [
        [link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier]
        for link in tree.links
        if link.from_node and link.from_socket and link.to_node and link.to_socket
    ]
    return json.dumps([nodes, sorted(links)])
