# SPDX-License-Identifier: GPL-3.0-or-later
"""A chain shown in Blender: keyed on the timeline, after a scene's render or after an image."""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import bpy
import numpy as np

from ..core.camera_motion import CameraState
from ..core.geometry import Intrinsics
from ..core.node_graph import Graph
from ..perturbations.groups import socket_name
from ..perturbations.kinds import ColourPerturbation, FrameContext, Identifiers
from ..perturbations.shares import WHOLE, sha256_of
from ..perturbations.steps import Step
from .chain import build_chain, camera_state_values, nodes_of, roomy_capacity_of, shown_values, step_node
from .datablocks import (
    action_of,
    fcurves_of,
    get_node,
    get_value,
    interface,
    interpolation,
    new_action,
    new_node,
    new_socket,
    new_tree,
    set_value,
)
from .node_trees import adopt, described_as, ensure_group, is_made_from, made_before, remove_group

# The values of a shown chain's sockets, keyed over the timeline; what a user does inside the chain is left alone.


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
    The chain has an action from the first on, so that keys which come later need no new one.
    now: the current scene frame, by default the first. intrinsics: of the camera, if known. stance_at: how it stands
    and moves; without it, its sockets are left alone. decided_at: what automatics decided; without it, as if all
    earlier frames were mid-grey. lit: the chain is of a lit scene.
    """
    if BUILT_AS not in tree:
        tree[BUILT_AS] = _structure(tree)
    if not _has_action(tree):
        new_action(tree, f"{tree.name} severity")
    left_at: dict[str, Any] = json.loads(tree.get(LEFT_AT, "{}"))
    clear_keys(tree, json.loads(tree.get(KEYED, "[]")))
    taken = _keyed_paths(tree)
    keyed: list[str] = []
    for step in steps:
        node = tree.nodes.get(step_node(step))
        if node is None:  # a user has removed it
            continue
        shown = partial(shown_values, step, identifiers=identifiers, intrinsics=intrinsics, lit=lit)
        told_at = None if nodes_of(step).by_frame is None else decided_at
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
    by_severity: dict[tuple[float | None, float], dict[str, Any]] = {}
    share = step.share or WHOLE
    camera_state_at = camera_state_at if step.uses_motion else None
    varies = step.levels is not None or len(share.mix) > 1
    changes = varies or any(item is not None for item in (index_of, camera_state_at, decided_at))
    for k in frames if changes else frames[:1]:
        index = k if index_of is None else index_of(k)
        severity = step.severity_of(step.context(FrameContext(index, identifiers)))
        if decided_at is not None:
            values = shown(index=index, scene_frame=index, decided=decided_at(index).get(step_node(step)))
        else:
            known = severity, share.mix_of(index)
            if known not in by_severity:
                by_severity[known] = shown(index=index, scene_frame=index)
            values = by_severity[known]
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
    """Remove the curves that we made. The action stays, to be keyed anew or dropped: `emptied_action` says why."""
    data = tree.animation_data
    if data is None or data.action is None:
        return
    if any(curve.data_path in ours for curve in fcurves_of(data)):
        if data.action.users > 1:  # a copy of the tree has it, too
            data.action = data.action.copy()
        bag = action_bag(tree)
        for curve in [curve for curve in bag.fcurves if curve.data_path in ours]:
            bag.fcurves.remove(curve)


def _has_action(tree: bpy.types.NodeTree) -> bool:
    return tree.animation_data is not None and tree.animation_data.action is not None


def drop_empty_action(tree: bpy.types.NodeTree) -> None:
    """Remove a tree's action where no curve of the tree is left in it."""
    data = tree.animation_data
    if data is None or data.action is None or fcurves_of(data):
        return
    action = data.action
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
    if not _has_action(tree):
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
        node = tree.nodes.get(step_node(step))
        if node is None:
            continue
        sockets = [node.inputs[socket_name(step.perturbation, name)] for name in nodes_of(step).values]
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


PREVIOUS = "noisy_world_previous_compositing"
DEPTH_ADDED = "noisy_world_depth_pass_added"
SHOWN = "noisy_world_shows"
MOST_KEPT = 8  # descriptions of chains; chosen: a chain for each scene, and few files have more
_descriptions: dict[str, tuple[list[Any], Graph]] = {}  # by the chain's name, with what each is of
GROUP, SPLIT, SOURCE, OWN = "Perturbations", "Before and after", "Frame", "Own compositing"


def make_chain(
    name: str,
    steps: Sequence[Step[ColourPerturbation]],
    frames: Sequence[int],
    identifiers: Identifiers,
    *,
    index_of: Callable[[int], int] | None = None,
    now: int | None = None,
    intrinsics: Intrinsics | None = None,
    camera_state_at: CameraStateAt | None = None,
    decided_at: DecidedAt | None = None,
    lit: bool = False,
) -> bpy.types.CompositorNodeTree:
    """Make the node group of a chain with its sockets set, and keyed over `frames` where they change.

    At scene frame k the chain then shows what the generator writes as frame index_of(k), by default k, of the sequence
    with these identifiers. An existing chain of this name is replaced wherever it is used; if it has the same groups,
    only its sockets are changed, which is quick, and a user's own values, keys and links in it stay. now: the current
    scene frame, by default the first. intrinsics: of the camera, if known. stance_at: how it stands and moves at a
    frame of the sequence; without it, the camera's sockets stay as they are. decided_at: what automatics
    decided for it, as `set_values` says. lit: the scene is lit, so nothing is clipped.
    """
    old = made_before(bpy.data.node_groups, name)
    # By number, as a child that is made anew too is gone then.
    children = set() if old is None else {group.session_uid for group in _groups_in(old)}
    tree = ensure_group(_described(name, steps, lit))
    set_values(
        tree,
        steps,
        frames,
        identifiers,
        index_of=index_of,
        now=now,
        intrinsics=intrinsics,
        camera_state_at=camera_state_at,
        decided_at=decided_at,
        lit=lit,
    )
    if tree != old:
        _remove_unused(children)
    return tree


def _described(name: str, steps: Sequence[Step[ColourPerturbation]], lit: bool) -> Graph:
    """Describe a chain; the last description holds as long as the steps have the same groups, whatever their values."""
    made_from = [
        lit,
        *((step.perturbation, step_node(step), roomy_capacity_of(step), _masks_of(step)) for step in steps),
    ]
    known = _descriptions.get(name)
    if known is None or known[0] != made_from:
        while len(_descriptions) >= MOST_KEPT:
            del _descriptions[next(iter(_descriptions))]
        known = _descriptions[name] = made_from, build_chain(name, steps, lit=lit)
    return known[1]


def _masks_of(step: Step[ColourPerturbation]) -> list[str]:
    """Return what tells the mask that a step's chain is shown with from others."""
    return [] if step.share is None else [f"{mask} {sha256_of(mask)}" for mask in step.share.masks[:1]]


def _groups_in(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    groups = [getattr(node, "node_tree", None) for node in tree.nodes]
    return list(dict.fromkeys(item for item in groups if item is not None))


def _remove_unused(session_uids: set[int]) -> None:
    for group in [item for item in bpy.data.node_groups if item.session_uid in session_uids and item.users == 0]:
        remove_group(group)


def show_chain(
    scene: bpy.types.Scene,
    chain: bpy.types.CompositorNodeTree,
    *,
    image: bpy.types.Image | None = None,
    encoded: bool = False,
    reference_width_px: int | None = None,
    split: float = 0.0,
    lit: bool = False,
    after_own: bool = True,
) -> bpy.types.NodeTree:
    """Make a scene's compositor show a chain, after its render or after an image; `hide_chain` undoes this.

    encoded: the input is sRGB-encoded and the output too. reference_width_px: by default the scene's full width. split:
    the share of the picture, from the left, that shows the chain's input. lit: the chain is of a lit scene. after_own:
    whether the scene's own compositing stays in effect between its render and the chain; after an image it does not.
    """
    own = own_compositing(scene) if image is None and after_own else None
    tree = new_tree(f"Preview of {scene.name}")
    tree[SHOWN] = True
    new_socket(tree, "Image", "NodeSocketColor", output=True)
    source = _source(tree, scene, image)
    before = source.outputs["Image"]
    if own is not None:
        before = _behind(tree, own, before)
    group = new_node(tree, bpy.types.CompositorNodeGroup)
    group.name, group.node_tree, group.width = GROUP, chain, 240
    set_value(group.inputs["Encoded"], encoded)
    set_value(group.inputs["Clip"], not lit)
    set_value(group.inputs["Reference Width"], reference_width_px or scene.render.resolution_x)
    end = tree.nodes.new("NodeGroupOutput")
    for node, left in ((source, -300 if own is None else -600), (group, 0), (end, 300)):
        node.location = (left, 0)
        node.select = False
    tree.nodes.active = group
    tree.links.new(before, group.inputs["Image"])
    tree.links.new(group.outputs["Image"], end.inputs["Image"])
    set_split(tree, split)
    previous = own_compositing(scene)
    scene.compositing_node_group = tree
    scene[PREVIOUS] = previous
    needs_depth = "Depth" in group.inputs and image is None
    _set_depth_pass(scene, needed=needs_depth)
    if needs_depth:
        tree.links.new(source.outputs["Depth"], group.inputs["Depth"])
    _remove_left()  # only now, as the chain to be removed may be this one
    return tree


def _source(tree: bpy.types.NodeTree, scene: bpy.types.Scene, image: bpy.types.Image | None) -> bpy.types.Node:
    if image is not None:
        shown = new_node(tree, bpy.types.CompositorNodeImage)
        shown.name, shown.image = SOURCE, image
        return shown
    layers = new_node(tree, bpy.types.CompositorNodeRLayers)
    layers.name, layers.scene = SOURCE, scene
    return layers


def _behind(tree: bpy.types.NodeTree, own: bpy.types.NodeTree, image: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Put the scene's own compositing between the render and the chain; return its output or, without one, `image`."""
    assert isinstance(own, bpy.types.CompositorNodeTree)
    node = new_node(tree, bpy.types.CompositorNodeGroup)
    node.name, node.node_tree, node.width = OWN, own, 240
    node.location, node.select = (-300, 0), False
    entry = next((socket for socket in node.inputs if socket.type == "RGBA"), None)
    if entry is not None:
        tree.links.new(image, entry)
    return next((socket for socket in node.outputs if socket.type == "RGBA"), image)


def set_split(tree: bpy.types.NodeTree, split: float) -> None:
    """Set the share of the picture, from the left, that shows the chain's input, in what `show_chain` made."""
    node, group = tree.nodes.get(SPLIT), tree.nodes[GROUP]
    end = next(item for item in tree.nodes if item.bl_idname == "NodeGroupOutput")
    end.location = (300 if split <= 0 else 500, 0)
    if split <= 0:
        if node is not None:
            tree.nodes.remove(node)
            tree.links.new(group.outputs["Image"], end.inputs["Image"])
        return
    if node is None:
        node = tree.nodes.new("CompositorNodeSplit")
        node.name, node.location, node.select = SPLIT, (300, 0), False
        set_value(node.inputs["Rotation"], math.pi / 2)
        first, second = (socket for socket in node.inputs if socket.type == "RGBA")
        if (before := _linked_to(group.inputs["Image"])) is not None:
            tree.links.new(before, first)
        tree.links.new(group.outputs["Image"], second)
        tree.links.new(node.outputs["Image"], end.inputs["Image"])
    set_value(node.inputs["Position"], (split, 0.5))


def _linked_to(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    links = socket.links
    return links[0].from_socket if links else None


def _set_depth_pass(scene: bpy.types.Scene, *, needed: bool) -> None:
    """Make the scene render depth; when it is no longer needed, restore the scene's own choice."""
    layer = scene.view_layers[0]
    if needed and not layer.use_pass_z:
        layer.use_pass_z = True
        scene[DEPTH_ADDED] = True
    if not needed and scene.pop(DEPTH_ADDED, False):
        layer.use_pass_z = False


def _remove_left() -> None:
    for tree in [item for item in bpy.data.node_groups if item.users == 0 and SHOWN in item]:
        remove_group(tree)


def own_compositing(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """Return the scene's own compositing, whether or not a chain is shown after it."""
    tree = scene.compositing_node_group
    return scene.get(PREVIOUS) if tree is not None and SHOWN in tree else tree


def shown_chain(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """Return the chain that a scene shows; None if it shows none, or only that of the scene it was copied from."""
    tree = scene.compositing_node_group
    if tree is None or SHOWN not in tree or not {SOURCE, GROUP} <= {node.name for node in tree.nodes}:
        return None
    if not any(node.bl_idname == "NodeGroupOutput" for node in tree.nodes):
        return None  # a user has removed it
    of_another = getattr(tree.nodes[SOURCE], "scene", scene) != scene
    return None if of_another else get_node(tree, GROUP, bpy.types.CompositorNodeGroup).node_tree


def hides_compositing(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene shows a chain, or did before it was given another compositing, so that `hide_chain` acts."""
    return PREVIOUS in scene


def hide_chain(scene: bpy.types.Scene) -> None:
    """Restore the compositing that a scene had before `show_chain`; remove a chain that nothing else uses.

    If the scene was given another compositing meanwhile, that is kept.
    """
    if not hides_compositing(scene):
        return
    tree = scene.compositing_node_group
    if tree is not None and SHOWN in tree:
        scene.compositing_node_group = scene[PREVIOUS]
    del scene[PREVIOUS]
    _set_depth_pass(scene, needed=False)
    _remove_left()


def refresh_chain(
    scene: bpy.types.Scene,
    steps: Sequence[Step[ColourPerturbation]],
    identifiers: Identifiers,
    *,
    index_of: Callable[[int], int] | None = None,
    reference_width_px: int | None = None,
    split: float = 0.0,
    intrinsics: Intrinsics | None = None,
    camera_state_at: CameraStateAt | None = None,
    decided_at: DecidedAt | None = None,
    lit: bool = False,
    after_own: bool = True,
    in_place: bool = False,
) -> bpy.types.NodeTree | None:
    """Make a scene's compositor show steps of colour after its render, with the fewest changes; return the chain.

    in_place: only where no data-block has to be made or removed for that; otherwise change nothing and return None.
    index_of: the frame of the sequence that a scene frame shows; by default they have equal numbers. intrinsics: of
    the camera. stance_at: how it stands and moves at a frame of the sequence, if known. decided_at: what automatics
    decided for it, if known. lit: the scene is lit. after_own: whether its own compositing stays in effect before.
    """
    chain = shown_chain(scene)
    if chain is not None and _is_shared(chain):
        chain = None  # Blender has copied the scene with what shows its chain: now each has a list of its own
    if in_place and (chain is None or not _is_made(scene, chain, steps, lit=lit, after_own=after_own)):
        return None
    name = adopt(chain) if chain is not None else _free_name(f"Perturbations of {scene.name}")
    frames = range(scene.frame_start, scene.frame_end + 1)
    needed_depth = chain is not None and _takes_depth(chain)
    chain = make_chain(
        name,
        steps,
        frames,
        identifiers,
        index_of=index_of,
        now=scene.frame_current,
        intrinsics=intrinsics,
        camera_state_at=camera_state_at,
        decided_at=decided_at,
        lit=lit,
    )
    tree = scene.compositing_node_group
    is_as_asked = _has_own_as_asked(scene, after_own=after_own)
    if tree is None or not is_as_asked or shown_chain(scene) != chain or needed_depth != _takes_depth(chain):
        show_chain(scene, chain, reference_width_px=reference_width_px, split=split, lit=lit, after_own=after_own)
        return chain
    set_value(tree.nodes[GROUP].inputs["Clip"], not lit)
    _set(tree.nodes[GROUP].inputs["Reference Width"], reference_width_px or scene.render.resolution_x)
    set_split(tree, split)
    return chain


def _is_made(
    scene: bpy.types.Scene,
    chain: bpy.types.NodeTree,
    steps: Sequence[Step[ColourPerturbation]],
    *,
    lit: bool,
    after_own: bool,
) -> bool:
    """Tell whether the chain that a scene shows has the groups of these steps: then its values alone are to be set."""
    described = _described(described_as(chain), steps, lit)
    own_action = _has_action(chain) and action_of(chain).users == 1
    return own_action and is_made_from(chain, described) and _has_own_as_asked(scene, after_own=after_own)


def _has_own_as_asked(scene: bpy.types.Scene, *, after_own: bool) -> bool:
    tree = scene.compositing_node_group
    return tree is not None and (OWN in tree.nodes) == (after_own and own_compositing(scene) is not None)


def _is_shared(chain: bpy.types.NodeTree) -> bool:
    """Tell whether the previews of several scenes show a chain: each would rebuild it for its own list."""
    shown = [tree.nodes.get(GROUP) for tree in bpy.data.node_groups if SHOWN in tree]
    return sum(getattr(node, "node_tree", None) == chain for node in shown) > 1


def _takes_depth(chain: bpy.types.NodeTree) -> bool:
    return any(getattr(item, "name", "") == "Depth" for item in interface(chain).items_tree)


def _set(socket: bpy.types.NodeSocket, value: int) -> None:
    if get_value(socket) != value:
        set_value(socket, value)


def _free_name(name: str) -> str:
    names = {name for tree in bpy.data.node_groups for name in (tree.name, described_as(tree))}
    number = 1
    while (found := name if number == 1 else f"{name} {number}") in names:
        number += 1
    return found
