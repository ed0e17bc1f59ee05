# SPDX-License-Identifier: GPL-3.0-or-later
"""Documents whose parts do not lie inside one another are refused before Blender reads memory by them."""

import copy

import refusals
import rooms_in_formats as rooms
from cases import cases

from noisy_world.scenes.gltf import read_gltf_header

HUGE = 10**30


def document(sparse=False):
    whole, blob = rooms.gltf(rooms.room_attributes(), nodes=[{"children": [1]}, {"mesh": 0}])
    if sparse:
        whole["accessors"][0]["sparse"] = {
            "count": 1, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 0},
        }  # fmt: skip
    return whole, blob


def refusal(folder, whole, blob):
    (folder / "a.glb").write_bytes(rooms.glb(whole, blob))
    said = refusals.refusal(read_gltf_header, folder / "a.glb")
    assert len(said) < 190
    return said


CHANGES = [
    *(("bufferViews.0.byteStride", value) for value in (HUGE, -4, 3, "a", [], 1.5, True)),
    *(("bufferViews.0.byteOffset", value) for value in (HUGE, -4, "a", {})),
    *(("bufferViews.0.byteLength", value) for value in (HUGE, -1, None, 16)),
    *(("bufferViews.0.buffer", value) for value in (7, -1, None, [])),
    *(("accessors.0.count", value) for value in (HUGE, 10**9, -1, "a", 37, None)),
    *(("accessors.0.componentType", value) for value in (HUGE, -1, {}, [])),
    *(("accessors.0.type", value) for value in ("VEC9", {}, None, "MAT4")),
    *(("accessors.0.byteOffset", value) for value in (HUGE, -4, 4)),
    *(("accessors.0.bufferView", value) for value in (HUGE, -1, [], "a")),
    *(("accessors.0.sparse", value) for value in ([], {}, {"count": HUGE}, {"count": 1, "indices": []})),
    *(("accessors.0.sparse.indices.componentType", value) for value in (None, 1, [])),
    *(("accessors.0.sparse.values.byteOffset", value) for value in (-4, 431)),
    *(("nodes.1.children", value) for value in ([0], [1], [7], [-1], [[]], {}, "a")),
    ("nodes.0.children", [1, 1]),
    *(("meshes.0.primitives.0.attributes.POSITION", value) for value in ([], {}, "a", None, 1e300, -1, 99, True)),
    *(("meshes.0.primitives.0.indices", value) for value in (-1, 99)),
    *(("meshes.0.primitives.0", value) for value in ([], {"attributes": []})),
    ("nodes.1.mesh", -1),
    ("textures", [{"source": 0}]),
    *((name, value) for name in ("buffers", "bufferViews", "accessors", "nodes") for value in ({}, [[]], 7)),
]


@cases(("where", "value"), CHANGES)
def test_a_part_that_cannot_be(tmp_path, where, value):
    whole, blob = document(sparse="sparse." in where)
    part = whole
    *way, last = where.split(".")
    for step in way:
        part = part[int(step) if step.isdigit() else step]
    part[int(last) if last.isdigit() else last] = copy.deepcopy(value)
    refusal(tmp_path, whole, blob)


def test_zeros_beyond_measure(tmp_path):
    whole, blob = document()
    del whole["accessors"][0]["bufferView"]
    read_gltf_header(rooms_file(tmp_path, whole, blob))
    whole["accessors"][0]["count"] = 10**9
    assert "accessor 0 is 1000000000 zeros, in files of " in refusal(tmp_path, whole, blob)


def test_whole_documents(tmp_path):
    for sparse in (False, True):
        read_gltf_header(rooms_file(tmp_path, *document(sparse)))
    chain = [{"children": [number + 1]} for number in range(5000)] + [{"mesh": 0}]
    whole, blob = rooms.gltf(rooms.room_attributes(), nodes=chain)
    read_gltf_header(rooms_file(tmp_path, whole, blob))


def rooms_file(folder, whole, blob):
    (folder / "a.glb").write_bytes(rooms.glb(whole, blob))
    return folder / "a.glb"
