# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of node groups that were built before: to read one takes 10 ms, to build a large group takes seconds.

They lie in the asset library that is shipped, and in this user's cache. What a file is found by changes with everything
that decides what is in it: the description, how groups are built, and what makes the images in them. Nothing depends on
the files: what cannot be read is built, and what cannot be written is not kept.
"""

import contextlib
import hashlib
import inspect
import json
import os
import struct
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..core.home import private_cache_folder
from ..core.node_graphs.graph import BroughtImage, Graph
from ..core.regular_files import read_bytes

LEAST_NODES = 40  # chosen: fewer are built in about the time that a file takes
MOST_BYTES = 2**28  # of this user's files; chosen: a thousand groups
LEFT_S = 3600.0  # what is not whole after this long is left by a process that ended
SEEKABLE = 0x8F92EAB1  # at the end of a file in Zstandard's seekable format
SHELF = Path(__file__).resolve().parents[1] / "assets" / "noisy_world_assets.blend"
BUILDERS = ("kept_groups.py", "nodes.py", "typed.py", "../core/node_graphs/node_layout.py")  # of groups


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
    builders = _sources(tuple(str(Path(__file__).parent / name) for name in BUILDERS))
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
