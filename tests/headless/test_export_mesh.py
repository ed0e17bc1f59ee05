# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded room and other meshes as files for other readers."""

import subprocess
import sys

import numpy as np
from worlds import ROOT, write_box_ply

from noisy_world.cli import export_mesh
from noisy_world.cli.entry import Entry
from noisy_world.core.scenes.ply import read_ply


def export(*arguments):
    command = [sys.executable, ROOT / "headless" / "export_mesh.py", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_room_comes_back_as_it_is(tmp_path, monkeypatch, room):
    monkeypatch.setattr("noisy_world.core.scenes.room.build_room", lambda: room)
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


def test_mistakes_are_one_line(tmp_path):
    result = export(tmp_path / "none.ply", tmp_path / "out.ply")
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "none.ply" in result.stderr
    assert not (tmp_path / "out.ply").exists()
