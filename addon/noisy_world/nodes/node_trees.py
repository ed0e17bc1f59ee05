# SPDX-License-Identifier: GPL-3.0-or-later
"""Making node groups from descriptions: completely or not at all, reused if nothing changed, laid out to be read."""

import contextlib
import hashlib
import inspect
import json
import os
import struct
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.file_access import private_cache_folder, read_bytes, utf8_name
from ..core.node_graph import INTERFACE, Arrangement, BroughtImage, Graph, GroupInput, Node, Panel, Socket, arrange
from .datablocks import interface, linking, new_node, new_socket, new_tree, set_pixels, set_value, use_as_data

# Files of node groups that were built before: to read one takes 10 ms, to build a large group takes seconds.
#
# They lie in the asset library that is shipped, and in this user's cache. What a file is found by changes with
# everything that decides what is in it: the description, how groups are built, and what makes the images in them.
# Nothing depends on the files: what cannot be read is built, and what cannot be written is not kept.


LEAST_NODES = 40  # chosen: fewer are built in about the time that a file takes
MOST_BYTES = 2**28  # of this user's files; chosen: a thousand groups
LEFT_S = 3600.0  # what is not whole after this long is left by a process that ended
SEEKABLE = 0x8F92EAB1  # at the end of a file in Zstandard's seekable format
SHELF = Path(__file__).resolve().parents[1] / "assets" / "noisy_world_assets.blend"


@dataclass(frozen=True)
class KeptGroup:
    """A file that holds a group, and the group's name in it."""

    path: Path
    name: str


def kept_groups(graph: Graph) -> Iterator[KeptGroup]:
    """Yield the files that hold the group of a description, each as it was written."""
    key = _key(graph)
    if key is None:
        return
    if (name := _shelf().get(key)) is not None:
        yield KeptGroup(SHELF, name)
    folder = _folder() if len(graph.nodes) >= LEAST_NODES else None
    for path in () if folder is None else folder.glob(f"{_here(key)}-*.blend"):
        try:
            if _digest(path) != path.stem.partition("-")[2]:  # Blender may crash on a file that is damaged
                path.unlink()
                continue
            os.utime(path)
        except OSError:  # another process has removed it
            continue
        yield KeptGroup(path, key)


def keep_group(graph: Graph, tree: bpy.types.NodeTree) -> None:
    """Write a group that was built from a description into this user's cache, where that pays and can be done."""
    key = _key(graph) if len(graph.nodes) >= LEAST_NODES else None
    folder = None if key is None else _folder()
    if key is None or folder is None:
        return
    scratch, name = folder / f".{uuid.uuid4().hex}.blend", tree.name
    try:
        tree.name = key
        bpy.data.libraries.write(str(scratch), {tree}, fake_user=True, compress=True)
        _check_whole(read_bytes(scratch))
        _make_room(folder)
        scratch.replace(folder / f"{_here(key)}-{_digest(scratch)}.blend")
    except (OSError, RuntimeError, UnicodeError, struct.error):  # the disk is full, say: it will be built again
        with contextlib.suppress(OSError):
            scratch.unlink(missing_ok=True)
    finally:
        tree.name = name


def index_of(library: Path, names: dict[str, Graph]) -> str:
    """Return the text that stands beside an asset library and says which group of which description is in it.

    names: the descriptions, by the name of each one's group in the file.
    """
    groups = {key: name for name, graph in names.items() if (key := _key(graph)) is not None}
    return json.dumps({"sha256": _digest(library, whole=True), "groups": groups}, indent=1) + "\n"


@lru_cache(maxsize=1)
def _shelf() -> dict[str, str]:
    """Return the names of the groups in the shipped library by what they are found by; none where it is another."""
    try:
        found: Any = json.loads(read_bytes(SHELF.with_suffix(".json")))
        return found["groups"] if found["sha256"] == _digest(SHELF, whole=True) else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _key(graph: Graph) -> str | None:
    """Return what a group's files are found by; None where it cannot be told how its images are made."""
    makers = _makers(graph)
    builders = _sources((__file__, new_node.__code__.co_filename, arrange.__code__.co_filename))
    made = _sources(tuple(sorted(set(makers)))) if None not in makers else None
    if made is None or builders is None:
        return None
    return hashlib.sha256(f"{graph.stamp} {builders} {made}".encode()).hexdigest()[:40]


def _makers(graph: Graph) -> list[Any]:
    """Return the files with the functions that make a group's images; None for a function without a file."""
    found: list[Any] = []
    for node in graph.nodes:
        if node.picture is not None:
            found.append(_maker(node.picture))
        if node.group is not None:
            found += _makers(node.group)
    return found


def _maker(picture: BroughtImage) -> str | None:
    code = getattr(inspect.unwrap(picture.make), "__code__", None)  # one that caches wraps it
    return None if code is None else code.co_filename


@lru_cache(maxsize=64)
def _sources(paths: tuple[str, ...]) -> str | None:
    """Return a hash of files of code; None where one of them is not there."""
    try:
        return hashlib.sha256(b"\0".join(read_bytes(path) for path in paths)).hexdigest()
    except OSError:
        return None


def _here(key: str) -> str:
    """Return the beginning of the names of a group's files, which are for this version of Blender."""
    return hashlib.sha256(f"{key} {bpy.app.version_string}".encode()).hexdigest()[:40]


def _digest(path: Path, *, whole: bool = False) -> str:
    return hashlib.sha256(read_bytes(path)).hexdigest()[: None if whole else 40]


def _folder() -> Path | None:
    """Return the folder of this user's files; None where there can be none."""
    base = private_cache_folder()
    if base is None:
        return None
    with contextlib.suppress(OSError):
        (base / "groups").mkdir(mode=0o700, exist_ok=True)
    return base / "groups"


def _check_whole(blend: bytes) -> None:
    """Raise OSError or struct.error where a file that Blender compressed lacks a part.

    Blender does not say that a disk is full. Zstandard's seekable format ends with the sizes of all parts.
    """
    count, magic = struct.unpack("<IxI", blend[-9:])
    table = blend[-9 - 8 * count : -9]
    parts = sum(size for size, _ in struct.iter_unpack("<II", table))
    if magic != SEEKABLE or parts + 8 + len(table) + 9 != len(blend):
        raise OSError("Blender could not write the whole file")


def _make_room(folder: Path) -> None:
    """Remove what ended processes left unfinished, and the files that were not used for the longest time."""
    files = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            found = path.stat()
            if path.name.startswith(".") and time.time() - found.st_mtime > LEFT_S:
                path.unlink()
            else:
                files.append((found.st_mtime, found.st_size, path))
    size = sum(item[1] for item in files)
    for _, bytes_, path in sorted(files):
        if size <= MOST_BYTES:
            return
        with contextlib.suppress(OSError):
            path.unlink()
            size -= bytes_


T = TypeVar("T", bound=bpy.types.ID)

STAMP = "noisy_world_stamp"
MADE_AS = "noisy_world_made_as"  # of a group or image: the description's name, and the name that Blender gave
PICTURE_VERSION = "noisy_world_version"
# Chosen, at Blender's own size of text: so that names are read whole, beside a number of some digits.
LETTER_PX, VALUE_PX, LEAST_WIDTH_PX = 7, 70, 180
_SOCKET_TYPES = {
    "float": "NodeSocketFloat",
    "int": "NodeSocketInt",
    "bool": "NodeSocketBool",
    "menu": "NodeSocketMenu",
    "vector": "NodeSocketVector",
    "color": "NodeSocketColor",
}


def ensure_group(graph: Graph) -> bpy.types.CompositorNodeTree:
    """Return the node group of a description: the one in the file where it is the same, a new one in its place if not.

    A new group is read from a file that holds it, or built. It replaces the old one wherever this is used; a user's own
    group of this name stays as it is. If anything fails, the file is left as it was.
    """
    old = made_before(bpy.data.node_groups, graph.name)
    if isinstance(old, bpy.types.CompositorNodeTree) and is_made_from(old, graph):
        return old
    before: set[bpy.types.ID] = {*bpy.data.node_groups, *bpy.data.images}
    try:
        tree = _read(graph) or _built(graph)
    except BaseException:
        _remove_new(before)
        raise
    _replace(old, tree, graph.name)
    return tree


def is_made_from(tree: bpy.types.NodeTree, graph: Graph) -> bool:
    """Tell whether a group is what `ensure_group` makes of a description, with all that is in it."""
    return tree.get(STAMP) == graph.stamp and _is_whole(tree)


_whole: dict[int, tuple[int, ...]] = {}  # by a group that was whole: which groups and images the file had then


def _is_whole(item: bpy.types.ID) -> bool:
    """Tell whether nothing is missing inside a group: a user may have deleted a group or an image that it uses.

    Looking takes milliseconds, so a group is looked at again only when groups or images of the file are others.
    """
    there = tuple(each.session_uid for each in (*bpy.data.node_groups, *bpy.data.images))
    if _whole.get(item.session_uid) == there:
        return True
    left, seen = [item], {item}
    while left:
        tree = left.pop()
        for node in tree.nodes if isinstance(tree, bpy.types.NodeTree) else ():
            if isinstance(node, bpy.types.CompositorNodeGroup):
                used = node.node_tree
            elif isinstance(node, bpy.types.CompositorNodeImage):
                used = node.image
            else:
                continue
            if used is None:
                return False
            if used not in seen:
                seen.add(used)
                left.append(used)
    _whole[item.session_uid] = there
    return True


def _replace(old: bpy.types.ID | None, new: bpy.types.ID, name: str) -> None:
    """Put a group or an image in the place of an old one, and give it its description's name."""
    if old is not None:
        old.user_remap(new)
        remove_group(old) if isinstance(old, bpy.types.NodeTree) else bpy.data.batch_remove([old])
    _name(new, name)


def remove_group(tree: bpy.types.NodeTree) -> None:
    """Remove a group, and the groups, images and actions that only this one used."""
    used = _used_by(tree)
    bpy.data.node_groups.remove(tree)
    for item in used:
        with suppress(ReferenceError):  # a group inside another one may have been removed with it
            if item.users == 0:
                remove_group(item) if isinstance(item, bpy.types.NodeTree) else bpy.data.batch_remove([item])


def made_before(collection: Iterable[T], name: str) -> T | None:
    """Return what was made for a description of this name: neither a user's own of that name, nor a copy of it."""
    own = (item for item in collection if item.library is None)
    return next((item for item in own if item.get(MADE_AS) == _made_as(name, item)), None)


def described_as(tree: bpy.types.NodeTree) -> str:
    """Return the name that the description of a group has; that of the group where it is not one of ours."""
    return str(tree.get(MADE_AS, tree.name)).partition("\n")[0]


def adopt(tree: bpy.types.NodeTree) -> str:
    """Let a group of ours be found again that was renamed or is an earlier version's; return its description's name."""
    name = described_as(tree)
    if tree.get(MADE_AS) != _made_as(name, tree):
        tree[MADE_AS] = _made_as(name, tree)
    return name


def _name(item: bpy.types.ID, name: str) -> None:
    item.name = name
    item[MADE_AS] = _made_as(name, item)


def _made_as(name: str, item: bpy.types.ID) -> str:
    return f"{name}\n{item.name}"


def _remove_new(before: set[bpy.types.ID]) -> None:
    for tree in [tree for tree in bpy.data.node_groups if tree not in before]:
        bpy.data.node_groups.remove(tree)
    for image in [image for image in bpy.data.images if image not in before]:
        bpy.data.images.remove(image)


def _used_by(tree: bpy.types.NodeTree) -> list[bpy.types.ID]:
    used = [getattr(node, name, None) for node in tree.nodes for name in ("node_tree", "image")]
    if tree.animation_data is not None:
        used.append(tree.animation_data.action)
    return list(dict.fromkeys(item for item in used if item is not None))


# --- reading what was built before ---


def _read(graph: Graph) -> bpy.types.CompositorNodeTree | None:
    """Return the group of a description out of a file that holds it; None where none does."""
    for kept in kept_groups(graph):
        for tree in _read_from(kept.path, {kept.name: graph}).values():
            return tree
    return None


def _read_together(graphs: Iterable[Graph]) -> None:
    """Read those of several groups that the shipped library holds and the file does not: opening it takes the time."""
    wanted: dict[str, Graph] = {}
    before: dict[str, bpy.types.ID | None] = {}
    for graph in graphs:
        old = made_before(bpy.data.node_groups, graph.name)
        name = _shelf().get(_key(graph) or "")
        if name is not None and not (old is not None and is_made_from(old, graph)):
            wanted[name], before[name] = graph, old
    if len(wanted) > 1:
        for name, tree in _read_from(SHELF, wanted).items():
            _replace(before[name], tree, wanted[name].name)


def _read_from(path: Path, wanted: Mapping[str, Graph]) -> dict[str, bpy.types.CompositorNodeTree]:
    """Return a file's groups as the open file's own, without those that it does not hold as they are described.

    wanted: the descriptions, by the names in the file. They are linked and made local, not appended: Blender would
    write the path of what it appends into the user's file.
    """
    if any(Path(bpy.path.abspath(library.filepath)) == path for library in bpy.data.libraries):
        return {}  # the user has linked groups of the asset library, which stay linked
    try:
        with linking(str(path)) as (source, target):
            names = [name for name in source.node_groups if name in wanted]
            target.node_groups = list(names)
    except (OSError, UnicodeError):  # it is gone, or Blender has no words for the names of its folders
        return {}
    library = next(item for item in bpy.data.libraries if Path(item.filepath) == path)
    found: dict[str, bpy.types.CompositorNodeTree] = {}
    try:
        for name, tree in zip(names, target.node_groups, strict=True):
            if isinstance(tree, bpy.types.CompositorNodeTree) and tree.get(STAMP) == wanted[name].stamp:
                own = _made_local(tree)
                assert isinstance(own, bpy.types.CompositorNodeTree)
                found[name] = own
    finally:
        bpy.data.libraries.remove(library)
    return found


def _made_local(item: bpy.types.ID) -> bpy.types.ID:
    """Make a linked group or image the open file's own, with what it uses, of which the file holds each once."""
    own = item.make_local()
    if isinstance(own, bpy.types.Image) and own.filepath_raw:
        own.filepath_raw = utf8_name(f"//{Path(own.filepath_raw).name}")
    if isinstance(own, bpy.types.NodeTree) and own.preview is not None:
        nothing: Any = (0, 0)
        own.preview.image_size = own.preview.icon_size = nothing  # the asset browser's picture doubles a file's size
    for used in _used_by(own) if isinstance(own, bpy.types.NodeTree) else ():
        if used.library is None:
            continue
        is_group = isinstance(used, bpy.types.NodeTree)
        name, version = str(used[MADE_AS]).partition("\n")[0], STAMP if is_group else PICTURE_VERSION
        there: Iterable[bpy.types.ID] = bpy.data.node_groups if is_group else bpy.data.images
        old = made_before(there, name)
        if old is not None and old.get(version) == used.get(version) and _is_whole(old):
            used.user_remap(old)
        else:
            _replace(old, _made_local(used), name)
    return own


# --- building ---


def _built(graph: Graph) -> bpy.types.CompositorNodeTree:
    tree = _build(graph)
    keep_group(graph, tree)
    return tree


def _build(graph: Graph) -> bpy.types.CompositorNodeTree:
    _read_together(node.group for node in graph.nodes if node.group is not None)
    children = {number: ensure_group(node.group) for number, node in enumerate(graph.nodes) if node.group is not None}
    tree = new_tree(f"{graph.name} (unfinished)")
    tree.description = graph.description
    tree.color_tag = "FILTER"
    tree.default_group_node_width = width_of(graph)
    panels = {item: _add_panel(tree, item) for item in dict.fromkeys(item.panel for item in graph.inputs) if item}
    identifiers = {item.name: _add_input(tree, item, panels) for item in graph.inputs}
    for item in graph.outputs:
        socket = new_socket(tree, item.name, _SOCKET_TYPES[item.kind], output=True)
        socket.description = item.description
    plan = arrange(graph)
    frames = _frames(tree, plan)
    entries = _entries(tree, plan, frames)
    # Blender updates the whole group with each change, which takes the longer the more nodes and links there are: so
    # each node is finished before the next one is made.
    made: dict[int, bpy.types.Node] = {}
    for number in sorted(plan.positions):
        item = graph.nodes[number]
        made[number] = node = _add_node(tree, item, children.get(number))
        _put_at(node, plan.positions[number], frames.get(item.section))
        for name, value in item.inputs.items():
            if isinstance(value, Socket):
                source = _source(value, made, entries.get(item.section), identifiers)
                tree.links.new(source, _input(node, name))
            else:
                set_value(_input(node, name), value)
    end = new_node(tree, bpy.types.NodeGroupOutput)
    end.is_active_output = True
    end.location = plan.output
    for item in graph.outputs:
        tree.links.new(_source(item.socket, made, entries.get(""), identifiers), end.inputs[item.name])
    _set_menus(tree, graph)
    _tidy(tree)
    tree[STAMP] = graph.stamp
    return tree


def width_of(graph: Graph) -> int:
    """Return a width of a group's node at which its name and those of its sockets are read whole, in pixels."""
    sockets = [len(item.name) * LETTER_PX + VALUE_PX for item in graph.inputs]
    return max(LEAST_WIDTH_PX, len(graph.name) * LETTER_PX + VALUE_PX // 2, *sockets)


def _add_panel(tree: bpy.types.NodeTree, panel: Panel) -> bpy.types.NodeTreeInterfacePanel:
    return interface(tree).new_panel(panel.name, description=panel.description, default_closed=panel.closed)


def _set_menus(tree: bpy.types.NodeTree, graph: Graph) -> None:
    """Set the defaults of menus, which have items only when they are linked."""
    defaults = {item.name: item.default for item in graph.inputs if item.kind == "menu"}
    for socket in interface(tree).items_tree if defaults else ():
        if isinstance(socket, bpy.types.NodeTreeInterfaceSocketMenu):
            socket.default_value = defaults[socket.name]


def _add_input(
    tree: bpy.types.NodeTree, item: GroupInput, panels: Mapping[Panel, bpy.types.NodeTreeInterfacePanel]
) -> str:
    panel = None if item.panel is None else panels[item.panel]
    socket = new_socket(tree, item.name, _SOCKET_TYPES[item.kind], output=False, panel=panel)
    socket.description = item.description
    if item.toggles:
        socket.is_panel_toggle = True
    if item.kind == "menu":
        return socket.identifier
    properties: dict[str, Any] = {}
    if item.kind in ("float", "int"):
        properties["subtype"] = item.subtype
        if item.minimum is not None:
            properties["min_value"] = item.minimum
        if item.maximum is not None:
            properties["max_value"] = item.maximum
    for name, value in (properties | {"default_value": item.default}).items():
        setattr(socket, name, value)
    return socket.identifier


def _frames(tree: bpy.types.NodeTree, plan: Arrangement) -> dict[str, bpy.types.Node]:
    frames = {}
    for label in plan.sections:
        frame = new_node(tree, bpy.types.NodeFrame)
        frame.label = frame.name = label
        frame.shrink = True
        frames[label] = frame
    return frames


def _add_node(tree: bpy.types.NodeTree, item: Node, child: bpy.types.NodeTree | None) -> bpy.types.Node:
    node = tree.nodes.new(item.idname)
    properties: dict[str, Any] = {}
    if child is not None:
        properties |= {"node_tree": child, "width": child.default_group_node_width}
    if item.picture is not None:
        properties["image"] = ensure_picture(item.picture)
    properties |= item.properties
    items = properties.pop("items", None)
    for name, value in properties.items():
        setattr(node, name, value)
    if items is not None:
        _add_items(node, items)
    if item.follows is not None:
        _follow(node.outputs[0], *item.follows)
    if item.label:
        node.label = item.label
    if item.name:
        node.name = item.name
    return node


def _follow(socket: bpy.types.NodeSocket, path: str, otherwise: float) -> None:
    """Let a value follow a property of whichever scene is composited: a driver of the context needs neither a script
    nor an object, so it goes with the group into any file.
    """
    set_value(socket, otherwise)
    curve: Any = socket.driver_add("default_value")
    curve.driver.type = "AVERAGE"
    variable = curve.driver.variables.new()
    variable.type = "CONTEXT_PROP"
    target = variable.targets[0]
    target.context_property, target.data_path = "ACTIVE_SCENE", path
    target.use_fallback_value, target.fallback_value = True, otherwise


def _add_items(node: bpy.types.Node, items: int | tuple[str, ...]) -> None:
    """Give a switch its items; Blender makes it with two. items: how many, or their names."""
    if isinstance(items, int):
        assert isinstance(node, bpy.types.GeometryNodeIndexSwitch)
        for _ in range(len(node.index_switch_items), items):
            node.index_switch_items.new()
        return
    assert isinstance(node, bpy.types.GeometryNodeMenuSwitch)
    known = len(node.enum_items)
    for place, name in enumerate(items):
        if place < known:
            node.enum_items[place].name = name
        else:
            node.enum_items.new(name)


def _entries(
    tree: bpy.types.NodeTree, plan: Arrangement, frames: Mapping[str, bpy.types.Node]
) -> dict[str, bpy.types.Node]:
    """Add a Group Input for each section that uses the group's inputs: short links are easier to read."""
    entries = {}
    for section, position in plan.entries.items():
        entry = tree.nodes.new("NodeGroupInput")
        _put_at(entry, position, frames.get(section))
        entries[section] = entry
    return entries


def _put_at(node: bpy.types.Node, position: tuple[float, float], frame: bpy.types.Node | None) -> None:
    node.parent = frame
    node.location = position


def _input(node: bpy.types.Node, name: str) -> bpy.types.NodeSocket:
    """Return a node's input by its identifier or, of a group node, by its name."""
    if node.bl_idname == "CompositorNodeGroup":
        return node.inputs[name]
    found = next((item for item in node.inputs if item.identifier == name), None)
    if found is None:
        raise KeyError(f"{node.bl_idname} has no input {name!r}")
    return found


def _source(
    socket: Socket,
    made: Mapping[int, bpy.types.Node],
    entry: bpy.types.Node | None,
    identifiers: Mapping[str, str],
) -> bpy.types.NodeSocket:
    if socket.node == INTERFACE:
        assert entry is not None
        return next(item for item in entry.outputs if item.identifier == identifiers[socket.output])
    node = made[socket.node]
    if node.bl_idname == "CompositorNodeGroup":
        return node.outputs[socket.output]
    found = next((item for item in node.outputs if item.identifier == socket.output), None)
    if found is None:
        raise KeyError(f"{node.bl_idname} has no output {socket.output!r}")
    return found


def _tidy(tree: bpy.types.NodeTree) -> None:
    """Hide the unlinked sockets of Group Inputs and the unused outputs of all nodes."""
    for node in tree.nodes:
        node.select = False
        for socket in node.outputs:
            if not socket.is_linked:
                socket.hide = True


# --- pictures ---


def ensure_picture(picture: BroughtImage) -> bpy.types.Image:
    """Return the image of a picture, packed into the file; it is made again if its version differs."""
    old = made_before(bpy.data.images, picture.name)
    if old is not None and old.get(PICTURE_VERSION) == picture.version:
        return old
    made = picture.make()
    image = _packed_file(made) if isinstance(made, Path) else _packed_pixels(picture.name, made)
    image[PICTURE_VERSION] = picture.version
    _replace(old, image, picture.name)
    return image


def _packed_file(path: Path) -> bpy.types.Image:
    image = bpy.data.images.load(utf8_name(path))
    use_as_data(image)
    image.pack()
    # The name alone: no path of this machine goes into the user's file.
    image.filepath_raw = utf8_name(f"//{path.name}")
    return image


def _packed_pixels(name: str, pixels: NDArray[Any]) -> bpy.types.Image:
    height, width = pixels.shape[:2]
    is_float = pixels.dtype == np.float32
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=is_float)
    use_as_data(image)
    values = np.ones((height, width, 4), dtype=np.float32)
    values[..., :3] = (pixels if is_float else pixels / np.float32(255)).reshape(height, width, -1)[::-1]
    set_pixels(image, values)
    image.pack()
    return image
