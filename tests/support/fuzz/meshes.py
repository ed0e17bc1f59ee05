# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated PLY files, whose vertices, colours and faces are compared with what plyfile reads."""

import itertools
import random

import numpy as np
from fuzz import ply as ply_changes
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_text, pick
from ply_files import BYTES, CODES, ENCODINGS, INDICES, MIXED, NORMAL, POINTS, QUADS, RGB, TRIANGLES, XYZ, ply, polygons

from noisy_world.core.scenes.ply import read_ply

WORDS = (
    *NUMBERS, *CODES, *ENCODINGS, "list", "property", "element", "vertex", "face", "end_header", "format", "comment",
    "obj_info", "ply", "x", "y", "z", "red", "vertex_index", "vertex_indices", "texcoord", "TextureFile a.png", "\n",
    "\r", "\r\n", " ", "1.0", "uint64",
)  # fmt: skip
POSITIONS = (XYZ, tuple(f"double {axis}" for axis in "xyz"), ("double x", "float y", "int16 z"))
COLOURS = ((), RGB, ("uchar r", "uchar g", "uchar b", "uchar alpha"), ("float red", "float green", "float blue"))
LISTS = (INDICES, ("list int uint vertex_index",), ("list uint8 int16 vertex_indices", "uchar flags"))


def _file(rng):
    """Return the bytes of a sound file of a dialect."""
    encoding = pick(rng, ENCODINGS)
    places, colours, lists = pick(rng, POSITIONS), pick(rng, COLOURS), pick(rng, LISTS)
    normals = pick(rng, ((), NORMAL))
    rows = []
    for point, colour in zip(POINTS, BYTES, strict=True):
        position = [int(value) if name.startswith("int") else value for name, value in zip(places, point, strict=True)]
        shade = [value / 255 for value in colour] if colours[:1] == ("float red",) else [*colour, 255][: len(colours)]
        rows.append((*position, *((0.0, 0.0, 1.0) if normals else ()), *(shade if colours else ())))
    faces = [(indices, 7)[: len(lists)] for indices in pick(rng, (TRIANGLES, QUADS, MIXED))]
    elements = [("vertex", (*places, *normals, *colours), rows), ("face", lists, faces)]
    if rng.integers(4) == 0:
        elements.insert(int(rng.integers(3)), ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)]))
    return ply(encoding, *elements, end=pick(rng, ("\n", "\n", "\r\n")), extra=pick(rng, ((), ("comment made here",))))


def write(folder, rng):
    """Write mesh.ply: changed as a careless program would, its header word by word, or any of its bytes."""
    data = _file(rng)
    if rng.integers(2):
        data = ply_changes.mutate(pick(rng, ply_changes.seeds()), random.Random(int(rng.integers(2**63))))
    elif rng.integers(2):
        header, mark, body = data.partition(b"end_header")
        text = mutate_text((header + mark).decode(), rng, WORDS).encode("utf-8", "surrogatepass")
        data = text + (body if rng.integers(4) else mutate_bytes(body, rng))
    else:
        data = mutate_bytes(data, rng)
    (folder / "mesh.ply").write_bytes(data)


def read(folder):
    """Read the mesh."""
    mesh = read_ply(folder / "mesh.ply")
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.corner_vertices.min() >= 0
    assert mesh.corner_vertices.max() < len(mesh.vertices_m)
    return mesh


def differs(folder, mesh, peer):
    """Return how the mesh differs from plyfile's, or "" where it does not, or plyfile refuses the file."""
    theirs = None if peer is None else peer.mesh(folder / "mesh.ply")
    if theirs is None:
        return ""
    points, faces = theirs
    points_m = np.array(points)
    # plyfile rounds the numbers of a text to the declared float32; ours keeps them as they are written.
    if not (np.array_equal(mesh.vertices_m, points_m) or np.array_equal(np.float32(mesh.vertices_m), points_m)):
        return f"other vertices: {mesh.vertices_m.tolist()[:3]} and {points[:3]}"
    whole = [corners for indices in faces if len(corners := _without_repeats(indices)) > 2]
    if polygons(mesh) != whole:
        return f"other faces: {polygons(mesh)[:4]} and {whole[:4]}"
    return ""


def _without_repeats(indices):
    """Return the corners of a face, none of which is repeated in succession."""
    corners = tuple(index for index, _ in itertools.groupby(indices))
    return corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners
