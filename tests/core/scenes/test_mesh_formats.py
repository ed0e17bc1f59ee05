# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of other formats are named, by what is in them or else by their suffix."""

import json
import struct

import refusals
from cases import cases

from noisy_world.scenes.mesh_files import check_mesh, imported_format
from noisy_world.scenes.ply import check_ply

GLB = struct.pack("<4sIIII", b"glTF", 2, 36, 16, 0x4E4F534A) + b'{"asset":{"version":"2.0"}}'
GLTF = json.dumps({"asset": {"version": "2.0"}, "scenes": []}, indent=2).encode()
OBJ = b"# made by hand\r\nmtllib a.mtl\r\no thing\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nvt 0 0\r\nf 1/1 2/1 3/1\r\n"
STL_TEXT = b"solid thing\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n"
STL_BINARY = b"solid by name only".ljust(80, b"\0") + struct.pack("<I", 2) + b"\0" * 100
FBX = b"Kaydara FBX Binary  \x00\x1a\x00" + b"\0" * 100
DAE = b'<?xml version="1.0" encoding="utf-8"?>\n<COLLADA xmlns="http://www.collada.org">\n'
IMPORTED = {
    "glTF": [GLB, GLTF, b"\xef\xbb\xbf" + GLTF],
    "OBJ": [OBJ, b"v 0 0 0\n" * 2000, b"g thing\nv 0 0 0 1 1 1\n"],
    "STL": [STL_TEXT, STL_BINARY],
    "FBX": [FBX, b"; FBX 7.3.0 project file\n"],
    "USD": [b"#usda 1.0\n(\n)\n", b"PXR-USDC\0\x08\0"],
}
OTHER = {"COLLADA (DAE)": [DAE], "OFF": [b"OFF\n3 1 0\n", b"COFF 3 1 0\n", b"STOFF\n"]}
SUFFIXES = {
    "glTF": ("gltf", "glb", "GLB"), "OBJ": ("obj",), "STL": ("stl",), "FBX": ("fbx",),
    "USD": ("usd", "usda", "usdc", "usdz"), "COLLADA (DAE)": ("dae",), "OFF": ("off",),
}  # fmt: skip


def refusal(path, data, check=check_ply):
    path.write_bytes(data)
    return refusals.refusal(check, path)


@cases("name", list(IMPORTED))
def test_what_blender_imports_is_told_by_its_content_or_else_by_its_name(tmp_path, name):
    written = "; 'noisy-world export' writes it as PLY"
    for data in IMPORTED[name]:
        assert refusal(tmp_path / "mesh.ply", data) == f"not a PLY file, but {name}{written}"
        assert imported_format(tmp_path / "mesh.ply").name == name
    for suffix in SUFFIXES[name]:
        path = tmp_path / f"mesh.{suffix}"
        path.write_bytes(b"\x01\x02")
        assert imported_format(path).name == name


@cases("name", list(OTHER))
def test_what_blender_does_not_import_either(tmp_path, name):
    for data in OTHER[name]:
        assert refusal(tmp_path / "mesh.ply", data) == f"not a PLY file, but {name}; export it as PLY"
        assert (
            refusal(tmp_path / "mesh.ply", data, check_mesh)
            == f"is {name}, which is not read; export it as PLY or glTF"
        )
    for suffix in SUFFIXES[name]:
        assert refusal(tmp_path / f"mesh.{suffix}", b"") == f"not a PLY file, but {name}; export it as PLY"


@cases(
    "data",
    [
        b"v\n",
        b"{}",
        b"solid ground",
        b"a text\nof words\n",
        b"<html>",
        b"\0" * 84 + b"x",
        b"f(x)\n",
        b"o",
        b"# only\n",
    ],
)
def test_anything_else(tmp_path, data):
    assert refusal(tmp_path / "mesh.ply", data) == "not a PLY file; the first line of a PLY file reads 'ply'"
    known = "no mesh file that is known: PLY, glTF, FBX, USD, STL, OBJ; export it as one of these"
    assert refusal(tmp_path / "mesh.ply", data, check_mesh) == known


def test_an_empty_file(tmp_path):
    assert refusal(tmp_path / "mesh.ply", b"", check_mesh) == "is empty; copy or export it again"


def test_content_counts_more_than_the_name(tmp_path):
    (tmp_path / "mesh.obj").write_bytes(GLB)
    assert imported_format(tmp_path / "mesh.obj").name == "glTF"


def test_a_ply_under_another_name_is_read(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    check_ply(path)
