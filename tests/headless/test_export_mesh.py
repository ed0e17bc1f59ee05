# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded room and other meshes as files for other readers."""

import subprocess
import sys

import cv2
import numpy as np
import pytest
from cases import cases
from worlds import ROOT, write_box_ply

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.scenes.ply import read_ply
from noisy_world.scenes.polygon_mesh import EMBEDDED_ROOM, ROOMS


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


@pytest.mark.parametrize("name", ["k.txt", "room", "room.obj"])
def test_only_ply_is_written(tmp_path, name, capsys):
    assert command.run("export", ["embedded:room", str(tmp_path / name)], Entry("export_mesh.py", ())) == 1
    told = capsys.readouterr().err
    assert f"{name}: its ending is not .ply, and PLY is what is written; write {name.partition('.')[0]}.ply\n" in told
    assert list(tmp_path.iterdir()) == []


def test_the_room_comes_back_as_it_is(tmp_path, room):
    assert command.run("export", ["embedded:room", str(tmp_path / "room.ply")], Entry("export_mesh.py", ())) == 0
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


def exported(capsys, *arguments):
    status = command.run("export", [str(item) for item in arguments], Entry("export_mesh.py", ()))
    told = capsys.readouterr()
    return status, told.out, told.err


@cases("triangulate", [False, True])
def test_textures_are_written_beside_it(tmp_path, capsys, triangulate):
    folder = tmp_path / str(triangulate)
    folder.mkdir()
    dice = np.random.default_rng(3)
    header = ["ply", "format ascii 1.0", "comment TextureFile a.png", "comment TextureFile b.png", "element vertex 5"]
    header += [f"property float {axis}" for axis in "xyz"] + [
        f"property uchar {name}" for name in ("red", "green", "blue")
    ]
    header += ["element face 3", "property list uchar int vertex_indices", "property list uchar float texcoord"]
    header += ["property int texnumber", "end_header"]
    rows = [f"{x} {y} 0 {x} {y} 9" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1), (2, 2))]
    rows += ["4 0 1 2 3 8 0 0 1 0 1 1 0 1 1", "3 1 2 4 6 .5 .5 1 0 .25 1 0", "3 0 3 4 0 -1", ""]
    (folder / "mesh.ply").write_text("\n".join([*header, *rows]))
    for name in "ab":
        cv2.imwrite(str(folder / f"{name}.png"), dice.integers(0, 256, (3, 4, 3)).astype(np.uint8))
    arguments = ["--triangulate"] if triangulate else []
    status, out, _ = exported(capsys, folder / "mesh.ply", folder / "out.ply", *arguments)
    assert status == 0
    assert f"wrote {folder}/out_0.png, {folder}/out_1.png: its textures" in out
    before, after = read_ply(folder / "mesh.ply"), read_ply(folder / "out.ply")
    assert after.face_sizes.tolist() == ([3] * 4 if triangulate else [4, 3, 3])
    pictures = [after.texture.names[number] if number >= 0 else "" for number in after.texture.face_pictures]
    expected = ["b.png"] * (1 + triangulate) + ["a.png", ""]
    names = {f"out_{place}.png": name for place, name in enumerate(before.texture.names)}
    assert [names.get(name, "") for name in pictures] == expected
    for here, there in zip(before.texture.pictures, after.texture.pictures, strict=True):
        assert np.array_equal(here, there)
    order = [0, 1, 2, 0, 2, 3, 4, 5, 6, 7, 8, 9] if triangulate else range(10)
    assert np.array_equal(after.corner_vertices, before.corner_vertices[order])
    assert np.array_equal(after.texture.corner_uv[:-3], before.texture.corner_uv[order][:-3])
    assert np.array_equal(after.rgb, before.rgb)


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


def test_help_names_every_room(capsys):
    with pytest.raises(SystemExit):
        command.main(["export", "--help"])
    assert f"{EMBEDDED_ROOM}?seed=0 to {ROOMS - 1}" in " ".join(capsys.readouterr().out.split())
