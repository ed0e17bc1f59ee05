# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of the formats that Blender imports, changed by structure and imported, in this process.

A damaged file may end the process, which `sources.imported_meshes` would say in a line. As each mesh takes some
milliseconds here, and more than a second in a process of its own, that is left to the one who reads the findings.
"""

import functools
import json
import logging
import tempfile
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
from fuzz.mesh_headers import TASK, TEXT_RAWS, WORDS, glb, gltf_text, obj, stl
from fuzz.mutation import NUMBERS, pick
from fuzz.structure import PATHS, as_table, changed, note
from rooms_in_formats import write_picture, write_usda

from noisy_world.sources import imported_meshes
from noisy_world.sources.mesh_reading import forget_meshes, read_mesh

NODES = {
    "Vertices": "0,0,0,1,0,0,0,1,0,1,1,0", "PolygonVertexIndex": "0,1,-3,1,3,-3", "GeometryVersion": "124",
    "Materials": "0,0",
}  # fmt: skip


@functools.cache
def _room():
    with tempfile.TemporaryDirectory() as folder:
        return write_usda(Path(folder)).read_text()


def usd(rng):
    """Return mesh.usda: the room with its picture, whose words are changed."""
    rows = [line.split(" ") for line in _room().splitlines()]
    tree, told = changed(rows, rng, raws=TEXT_RAWS, words=(*WORDS, *NUMBERS, *(f"@{path}@" for path in PATHS)))
    return {"mesh.usda": as_table(tree)}, told


def fbx(rng):
    """Return mesh.fbx, as text: arrays whose numbers and counts are changed."""
    tree = {name: [values.split(",")] for name, values in NODES.items()}
    tree, told = changed(tree, rng, raws=TEXT_RAWS, words=(*WORDS, *NUMBERS))
    arrays = []
    for name in NODES:
        cells = as_table(tree.get(name, []) if isinstance(tree, dict) else tree).strip().replace(b" ", b",")
        count = pick(rng, (cells.count(b",") + 1,) * 6 + (0, 2**31, 10**30))
        arrays.append(b"  %s: *%d {\n   a: %s\n  }\n" % (name.encode(), count, cells))
    head = (
        b'; FBX 7.4.0\nFBXHeaderExtension: {\n FBXVersion: 7400\n}\nObjects: {\n Geometry: 1, "Geometry::m", "Mesh" {\n'
    )
    tail = b' }\n Model: 2, "Model::m", "Mesh" {\n }\n}\nConnections: {\n C: "OO",2,0\n C: "OO",1,2\n}\n'
    return {"mesh.fbx": head + b"".join(arrays) + tail}, told


KINDS = (obj, stl, usd, fbx, gltf_text, glb)


def write(folder, rng):
    """Write a mesh and the files that it is made of."""
    inside = folder / "in"
    write_picture(inside)
    files, told = pick(rng, KINDS)(rng)
    for name, data in files.items():
        (inside / name).write_bytes(data)
    note(folder, [*told, "as it may be"])  # Blender knows more than the headers say, so none has to be accepted
    (folder / TASK).write_text(json.dumps(next(iter(files))))


def read(folder):
    """Import the mesh."""
    forget_meshes()
    logging.getLogger("glTFImporter").setLevel(logging.CRITICAL)
    with mock.patch.object(imported_meshes, "_asked", _asked_here):
        mesh = read_mesh(folder / "in" / json.loads((folder / TASK).read_text()))
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.corner_vertices.min() >= 0
    assert mesh.corner_vertices.max() < len(mesh.vertices_m)
    return mesh


def _asked_here(order):
    from noisy_world.blender.importing import program

    return SimpleNamespace(returncode=program.main(order if isinstance(order, str) else json.dumps(order)), stdout="")


def differs(folder, meaning, peer=None):
    """Say nothing: what a changed mesh means, no other reader tells."""
    del folder, meaning, peer
    return ""
