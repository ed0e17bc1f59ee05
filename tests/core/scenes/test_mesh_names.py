# SPDX-License-Identifier: GPL-3.0-or-later
"""Names in a stranger's mesh lead into its folder and nowhere else, whatever they say and however they are written."""

import json
import os
from functools import partial

import pytest
from refusals import refused
import refusals
from cases import cases

from noisy_world.scenes.mesh_formats import link_notes, place_inside
from noisy_world.scenes.mesh_files import check_mesh, referenced_files, imported_format

LONG = "n" * 300
AWAY = [
    "../secret",
    "a/../../secret",
    "..\\secret",
    "/etc/secret",
    "\\\\host\\share\\secret",
    "//host/share/secret",
    "C:\\secret",
    "c:secret",
    "file:///etc/secret",
    "FILE:secret",
    "file:/etc/secret",
    "smb://host/secret",
    "..",
]


def gltf(folder, **keys):
    path = folder / "a.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}} | keys))
    return path


def obj(folder, library):
    (folder / "a.obj").write_text(f"mtllib {library}\nv 0 0 0\nf 1 1 1\n")
    return folder / "a.obj"


def materials(folder, name):
    (folder / "b.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    return obj(folder, "b.mtl")


def fbx(folder, name):
    (folder / "a.fbx").write_text(f'; FBX 7.4.0\nRelativeFilename: "{name}"\n')
    return folder / "a.fbx"


refusal = partial(refusals.refusal, check_mesh)


@cases("name", AWAY)
def test_names_that_lead_away(tmp_path, name):
    assert place_inside(tmp_path, name) is None
    for kind in ("buffers", "images"):
        said = refusal(gltf(tmp_path, **{kind: [{"uri": name, "byteLength": 1}]}))
        assert "leads out of the mesh's folder; put it beside the mesh" in said or "is no file's name" in said
    assert "leads out of the mesh's folder; put it beside the mesh" in refusal(obj(tmp_path, name))


def test_names_that_stay(tmp_path):
    for name in ("a.png", "./a.png", "b/../a.png", "b\\..\\a.png", "b//../a.png"):
        assert place_inside(tmp_path, name) == tmp_path / "a.png"
    assert place_inside(tmp_path, "../a.png", "materials") == tmp_path / "a.png"
    assert place_inside(tmp_path, "../../a.png", "materials") is None
    assert place_inside(tmp_path, "wall:1.png") == tmp_path / "wall:1.png"


def test_percent_signs_hide_nothing(tmp_path):
    for uri in ("%2e%2e/secret.bin", "%2Fetc%2Fsecret", "..%5Csecret", "a%2F..%2F..%2Fsecret"):
        assert "leads out of the mesh's folder" in refusal(gltf(tmp_path, buffers=[{"uri": uri, "byteLength": 1}]))
    assert "is no file's name" in refusal(gltf(tmp_path, buffers=[{"uri": "a%00b", "byteLength": 1}]))


def test_what_lies_outside_is_neither_opened_nor_hashed(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.png").write_bytes(b"secret")
    for path in (materials(inner, "../secret.png"), materials(inner, tmp_path / "secret.png")):
        assert referenced_files(path) == [inner / "b.mtl"]
    for name in ("../secret.png", tmp_path / "secret.png"):
        assert referenced_files(fbx(inner, name)) == []
    (inner / "secret.png").write_bytes(b"beside")
    assert referenced_files(fbx(inner, "../secret.png")) == [inner / "secret.png"]
    assert referenced_files(materials(inner, "../secret.png")) == [inner / "b.mtl", inner / "secret.png"]


@cases("name", [LONG, f"{LONG}/{LONG}", "a" * 5000])
def test_names_of_any_length(tmp_path, name):
    for kind in ("buffers", "images"):
        path = gltf(tmp_path, **{kind: [{"uri": name, "byteLength": 1}]})
        assert kind == "images" or "is missing in" in refusal(path)
        assert referenced_files(path) == [] if kind == "images" else True
    assert referenced_files(obj(tmp_path, name)) == []
    for path in (obj(tmp_path, name), materials(tmp_path, name), fbx(tmp_path, name)):
        check_mesh(path)
        assert [file for file in referenced_files(path) if file.name != "b.mtl"] == []


def test_gltf_whose_header_is_of_other_types(tmp_path):
    (tmp_path / "empty.bin").write_bytes(b"")
    check_mesh(gltf(tmp_path, buffers=[{"uri": "empty.bin", "byteLength": 0}]))
    for keys in ({"asset": []}, {"asset": {"version": "9" * 5000}}, {"buffers": {"uri": 3}}, {"nodes": [7]}):
        assert len(refusal(gltf(tmp_path, **keys))) < 300


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "pipe.mtl")
    for file in ("pipe", "pipe.mtl"):
        refused(imported_format, tmp_path / file, names=(file, "is a pipe"))
    for path in (
        gltf(tmp_path, buffers=[{"uri": "pipe", "byteLength": 1}]),
        gltf(tmp_path, images=[{"uri": "pipe"}]),
        obj(tmp_path, "pipe.mtl"),
        materials(tmp_path, "pipe"),
        materials(tmp_path, tmp_path / "pipe"),
        materials(tmp_path, "-s 1 1 1 pipe"),
        fbx(tmp_path, "pipe"),
        fbx(tmp_path, tmp_path / "pipe"),
    ):
        assert "'pipe" in (said := refusal(path))
        assert "it is a pipe, not a file" in said
    os.mkfifo(tmp_path / "a.mtl")  # which Blender looks for by the mesh's name
    (tmp_path / "a.obj").write_text("v 0 0 0\nf 1 1 1\n")
    assert "'a.mtl': it is a pipe" in refusal(tmp_path / "a.obj")


def test_materials_that_have_the_meshs_name_are_part_of_it(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\nmap_Bump -bm 0.5 b.png\n")
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "a.obj").write_text("v 0 0 0\nf 1 1 1\n")
    assert [file.name for file in referenced_files(tmp_path / "a.obj")] == ["a.mtl", "a.png", "b.png"]


def test_links_out_of_the_folder_are_said(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "a.png").write_bytes(b"")
    (inner / "b.png").write_bytes(b"")
    (inner / "a.png").symlink_to(tmp_path / "a.png")
    (inner / "c.png").symlink_to("b.png")
    (note,) = link_notes(inner / "a.obj", [inner / "a.png", inner / "b.png", inner / "c.png"])
    assert note == f"its file 'a.png' is a link out of the mesh's folder, to {str(tmp_path / 'a.png')!r}"
    assert link_notes(inner / "a.obj", [inner / "b.png", inner / "c.png"]) == []
