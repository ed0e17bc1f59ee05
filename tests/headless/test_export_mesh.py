# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded room and other meshes as files for other readers."""

import subprocess
import sys

import cv2
import numpy as np
import pytest
from worlds import ROOT, write_box_ply

from noisy_world.cli import export_mesh
from noisy_world.cli.entry import Entry
from noisy_world.core.scenes.ply import read_ply


def export(*arguments):
    command = [sys.executable, ROOT / "headless" / "export_mesh.py", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("mesh", "problem"),
    [
        ("embedded:room?seed=8", "there is no 'embedded:room?seed=8'; did you mean"),
        ("embedded:room?seed=*", "embedded:room?seed=* is 8 rooms, and a file holds one; name one of them"),
    ],
)
def test_a_room_that_is_not_one_is_an_error(tmp_path, mesh, problem):
    done = export(mesh, tmp_path / "room.ply")
    assert done.returncode == 1
    assert problem in done.stderr
    assert not (tmp_path / "room.ply").exists()


def test_the_room_comes_back_as_it_is(tmp_path, monkeypatch, room):
    monkeypatch.setattr("noisy_world.core.scenes.room.build_room", lambda seed: room)
    assert export_mesh.main(["embedded:room", str(tmp_path / "room.ply")], Entry("export_mesh.py", ())) == 0
    header = (tmp_path / "room.ply").read_bytes()[:400].split(b"end_header")[0].decode().splitlines()
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    assert "property list uchar int vertex_indices" in header
    read = read_ply(tmp_path / "room.ply")
    assert np.array_equal(read.vertices_m, room.vertices_m.astype(np.float32))
    assert np.array_equal(read.rgb, room.rgb)
    assert np.array_equal(read.corner_vertices, room.corner_vertices)
    assert (read.face_sizes == 4).all()


def test_quads_become_triangles(tmp_path):
    write_box_ply(tmp_path / "box.ply")
    result = export(tmp_path / "box.ply", tmp_path / "triangles.ply", "--triangulate")
    assert result.returncode == 0
    assert "12 faces" in result.stdout
    mesh = read_ply(tmp_path / "triangles.ply")
    assert mesh.face_sizes.tolist() == [3] * 12


def write_textured(path, *, extra=""):
    """A triangle with a texture that lies beside it, by hand; extra: declarations of vertices, each 7 in the rows."""
    names = [line for line in extra.split(",") if line]
    header = ["ply", "format ascii 1.0", "comment TextureFile a.png", "element vertex 3"]
    header += [f"property float {axis}" for axis in "xyz"] + [f"property {name}" for name in names]
    header += ["element face 1", "property list uchar int vertex_indices", "property list uchar float texcoord"]
    rows = [f"{x} {y} 0" + " 7" * len(names) for x, y in ((0, 0), (1, 0), (0, 1))]
    path.write_text("\n".join([*header, "end_header", *rows, "3 0 1 2 6 0 0 1 0 0 1"]) + "\n")
    cv2.imwrite(str(path.parent / "a.png"), np.zeros((2, 2, 3), np.uint8))


def exported(capsys, *arguments):
    status = export_mesh.main([str(item) for item in arguments], Entry("export_mesh.py", ()))
    told = capsys.readouterr()
    return status, told.out, told.err


def test_a_texture_has_no_place(tmp_path, capsys):
    write_textured(tmp_path / "mesh.ply")
    status, _, err = exported(capsys, tmp_path / "mesh.ply", tmp_path / "out.ply")
    assert status == 1
    assert len(err.splitlines()) == 1
    assert "its colours are in the texture a.png, for which Replica's layout has no place; transfer them" in err
    assert not (tmp_path / "out.ply").exists()


def test_beside_a_texture_other_colours_are_written(tmp_path, capsys):
    write_textured(tmp_path / "mesh.ply", extra="uchar red,uchar green,uchar blue")
    status, out, _ = exported(capsys, tmp_path / "mesh.ply", tmp_path / "out.ply")
    assert status == 0
    assert "the texture is left out: the other colours are written" in out
    read = read_ply(tmp_path / "out.ply")
    assert read.texture is None
    assert np.rint(read.rgb * 255).tolist() == [[7] * 3] * 3


def test_colours_of_faces_stay(tmp_path, capsys):
    header = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {axis}" for axis in "xyz")]
    header += ["element face 2", "property list uchar int vertex_indices"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    rows = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "3 0 1 2 9 8 7", "3 0 2 3 1 2 3"]
    (tmp_path / "mesh.ply").write_text("\n".join([*header, "end_header", *rows]) + "\n")
    status, out, _ = exported(capsys, tmp_path / "mesh.ply", tmp_path / "out.ply")
    assert status == 0
    assert "6 vertices, 2 faces" in out
    read = read_ply(tmp_path / "out.ply")
    assert np.rint(read.rgb[read.corner_vertices] * 255).tolist() == [[9, 8, 7]] * 3 + [[1, 2, 3]] * 3


def test_mistakes_are_one_line(tmp_path):
    result = export(tmp_path / "none.ply", tmp_path / "out.ply")
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "none.ply" in result.stderr
    assert not (tmp_path / "out.ply").exists()
