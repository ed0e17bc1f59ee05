# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers in mesh files that are text: Blender's importers take 0 for what is none, so such files are refused."""

import contextlib
import time
from functools import partial

import refusals
from cases import cases

from noisy_world.core.errors import InputError
from noisy_world.scenes.mesh_files import check_mesh, check_numbers, declared_faces, odd_number

FACET = "facet normal 0 0 1\n outer loop\n  vertex {} 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n endloop\nendfacet\n"


def obj(folder, lines, mtl=None):
    (folder / "a.obj").write_text("\n".join(["# by hand", *lines, "f 1 2 3", ""]))
    if mtl is not None:
        (folder / "a.mtl").write_text(mtl)
    return folder / "a.obj"


def stl(folder, word, end="\n"):
    text = "solid a\n" + FACET.format("0") + FACET.format(word) + "endsolid a\n"
    (folder / "a.stl").write_bytes(text.replace("\n", end).encode())
    return folder / "a.stl"


refusal = partial(refusals.refusal, check_numbers)


ODD = [
    ("1e999", "'1e999' is too large for float32"),
    ("1e39", "'1e39' is too large for float32"),
    ("9" * 40, f"'{'9' * 40}' is too large for float32"),
    ("0,5", "'0,5' is not a number; write a decimal point"),
    ("nan", "a coordinate is NaN or infinite"),
    ("-INF", "a coordinate is NaN or infinite"),
    ("infinity", "a coordinate is NaN or infinite"),
    ("1.5x", "'1.5x' is not a number"),
    ("0x10", "'0x10' is not a number"),
    ("1_0", "'1_0' is not a number"),
    ("1.2.3", "'1.2.3' is not a number"),
    ("-", "'-' is not a number"),
]


@cases(("word", "said"), ODD)
def test_a_coordinate_that_is_no_number_is_named_with_its_line(tmp_path, word, said):
    path = obj(tmp_path, ["v 0 0 0", "v 1 0 0", f"v 0 {word} 1"])
    assert refusal(path).startswith(f"line 4: {said}")
    path = stl(tmp_path, word)
    assert refusal(path).startswith(f"line 11: {said}")
    assert refusal(stl(tmp_path, word, end="\r\n")).startswith(f"line 11: {said}")


def test_other_numbers_of_an_obj_file(tmp_path):
    path = obj(tmp_path, ["v 0 0"])
    assert refusal(path).startswith("line 2: has 2 numbers, where a coordinate takes 3")
    path = obj(tmp_path, ["v 0 0 0", "v 0 0 \\", "x"])
    assert refusal(path).startswith("line 3: 'x' is not a number")
    assert "line 2: a texture coordinate is NaN" in refusal(obj(tmp_path, ["vt 0 nan"]))
    assert "line 2: '0,5' is not a number" in refusal(obj(tmp_path, ["v 0 0 0 1 0,5 1"]))
    path = obj(tmp_path, ["v 0 0 0"], "newmtl a\nKd 0,5 0 0\n")
    assert refusal(path, named=tmp_path / "a.mtl").startswith("line 2: '0,5' is not a number")
    (tmp_path / "a.mtl").write_text("newmtl a\n\tKd 0.5\n")
    assert "line 2: has 1 numbers, where a colour takes 3" in refusal(path, named=tmp_path / "a.mtl")


def test_numbers_as_programs_write_them(tmp_path):
    lines = ["v\t1 -2. +.5e-3", "  v 1E5 2e+05 0 1 # why", "v 0 0 0 0.5 0.5 0.5\r", "v 0 \\", "0 0", "v 1e-999 0 0#"]
    check_numbers(obj(tmp_path, [*lines, "vt 0.5", "vt 0 1 0", "vn nan 0 0", "o v nan", "#v x", "v 1e38 0 0"]))
    check_numbers(stl(tmp_path, "-1.5e+00"))
    (tmp_path / "line.stl").write_text("solid a " + FACET.format("1").replace("\n", " ") * 2)
    check_numbers(tmp_path / "line.stl")


def test_faces_that_a_file_lists(tmp_path):
    assert declared_faces(obj(tmp_path, ["  f 1/2/3 2//1 3", "fo 1", "#f 1 2 3"])) == 2
    assert declared_faces(stl(tmp_path, "0")) == 2
    assert odd_number(obj(tmp_path, []), "is odd").where == ""
    (tmp_path / "a.usda").write_text('#usda 1.0\ndef "nan" {\n point3f[] p = [(0, 1e999, 0)]\n}\n')
    assert odd_number(tmp_path / "a.usda", "is odd").where == "line 3"


@cases(
    "text",
    [
        "mtllib a" + " " * 60_000 + "b\nf 1 2 3\n",
        ("mtllib" + " " * 60_000) * 2,
        "v" + " " * 60_000 + "x\nf 1 2 3",
        "v 0 0 " + "1" * 60_000 + "x\nf 1 2 3",
        "v" + " 1" * 60_000 + " x\nf 1 2 3",
        " " * 60_000 + "v\n" * 100 + "f 1 2 3",
    ],
)
def test_the_time_of_a_line_is_in_proportion_to_its_length(tmp_path, text):
    (tmp_path / "a.obj").write_text(text)
    began = time.process_time()
    for look in (check_mesh, check_numbers):
        with contextlib.suppress(InputError):
            look(tmp_path / "a.obj")
    (tmp_path / "a.obj").write_text("f 1 2 3\n")
    (tmp_path / "a.mtl").write_text("map_Kd " + "-s " * 60_000 + " " * 60_000 + "\n")
    check_mesh(tmp_path / "a.obj")
    assert time.process_time() - began < 1
