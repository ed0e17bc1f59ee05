# SPDX-License-Identifier: GPL-3.0-or-later
"""Files changed at random are read or refused in one line; what is read agrees with plyfile, where that is installed.

`NOISY_WORLD_FUZZ=3000` makes as many files instead of a few.
"""

import importlib.util
import os
import random
import time
import warnings

import numpy as np
import pytest
from fuzz.ply import mutate, seeds

from noisy_world.core.errors import InputError
from noisy_world.core.scenes.ply import read_ply

COUNT = int(os.environ.get("NOISY_WORLD_FUZZ", "400"))
SLOW_S = 10.0
COLOURS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import cv2

    path = tmp_path_factory.mktemp("fuzz")
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(path / name), np.arange(12, dtype=np.uint8).reshape(2, 2, 3))
    return path


def outcome(path):
    """The mesh, or None where the file is refused, in one line and at once."""
    begin_s, said = time.process_time(), str(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            mesh = read_ply(path)
        except InputError as error:
            mesh, said = None, str(error)
    assert "\n" not in said
    assert str(path.parent) in said
    assert time.process_time() - begin_s < SLOW_S
    return mesh


def check(mesh):
    """A mesh is whole: every number is finite and in range, every array as long as it should be."""
    corners, faces = len(mesh.corner_vertices), len(mesh.face_starts)
    assert np.isfinite(mesh.vertices_m).all()
    assert 0 <= mesh.corner_vertices.min() <= mesh.corner_vertices.max() < len(mesh.vertices_m)
    assert mesh.face_sizes.min() >= 3
    for rgb, count in ((mesh.rgb, len(mesh.vertices_m)), (mesh.corner_rgb, corners)):
        assert rgb is None or (rgb.shape == (count, 3) and rgb.min() >= 0 and rgb.max() <= 1)
    if mesh.texture is not None:
        assert mesh.texture.corner_uv.shape == (corners, 2)
        assert np.isfinite(mesh.texture.corner_uv).all()
        assert mesh.texture.face_pictures.shape == (faces,)
        assert -1 <= mesh.texture.face_pictures.min() <= mesh.texture.face_pictures.max() < len(mesh.texture.pictures)
    assert all("\n" not in note for note in mesh.notes)


def without_repeats(indices):
    """The positions of a face's corners without those whose next one is the same."""
    return [k for k in range(len(indices)) if indices[k] != indices[(k + 1) % len(indices)]]


def compare(mesh, data):
    """The mesh holds what plyfile reads from the file: points, faces, and colours and coordinates in their places."""
    vertex, face = data["vertex"], data["face"]
    points = np.stack([vertex[name].astype(float) for name in "xyz"], axis=1)
    np.testing.assert_allclose(mesh.vertices_m, points, rtol=1e-6 if data.text else 0)  # it rounds text to float32
    names = {item.name for item in face.properties}
    lists = [list(map(int, f)) for f in face["vertex_indices" if "vertex_indices" in names else "vertex_index"]]
    kept = [(k, without_repeats(f)) for k, f in enumerate(lists) if len(without_repeats(f)) >= 3]
    expected = [[lists[k][c] for c in places] for k, places in kept]
    assert mesh.corner_vertices.tolist() == [corner for corners in expected for corner in corners]
    assert mesh.face_sizes.tolist() == list(map(len, expected))
    scale = next((note for note in mesh.notes if "read as 0..255" in note), None)
    for rgb, element, rows in (
        (mesh.rgb, vertex, slice(None)),
        (mesh.corner_rgb, face, [k for k, places in kept for _ in places]),
    ):
        if rgb is not None:
            here = {item.name for item in element.properties}
            columns = [element[name] for name in next(names for names in COLOURS if here.issuperset(names))]
            kind = columns[0].dtype
            full = 255 if scale else {"u1": 255, "u2": 65535}.get(kind.str[1:], 1)
            stored = np.stack([column.astype(np.float64) for column in columns], axis=1)[rows]
            np.testing.assert_allclose(rgb, np.clip(stored / full, 0, 1), atol=1e-6)
    if mesh.texture is not None and "texcoord" in names:
        shown = np.repeat(mesh.texture.face_pictures >= 0, mesh.face_sizes)
        stored = [face["texcoord"][k] for k, _ in kept]
        uv = [
            t[2 * c : 2 * c + 2] if len(t) else (0, 0)
            for t, (_, places) in zip(stored, kept, strict=True)
            for c in places
        ]
        np.testing.assert_allclose(mesh.texture.corner_uv[shown], np.array(uv, np.float64)[shown], rtol=1e-6)


def test_changed_files(folder):
    plyfile = importlib.import_module("plyfile") if importlib.util.find_spec("plyfile") else None
    counts = {"refused": 0, "read": 0, "compared": 0}
    originals = seeds()
    for number in range(COUNT):
        rng = random.Random(number)
        data = mutate(rng.choice(originals), rng)
        path = folder / "mesh.ply"
        path.write_bytes(data)
        mesh = outcome(path)
        counts["refused" if mesh is None else "read"] += 1
        if mesh is None:
            continue
        check(mesh)
        if plyfile is not None:
            try:
                peer = plyfile.PlyData.read(str(path), mmap=False)
            except Exception as error:  # noqa: BLE001 - whatever stops it, there is nothing to compare with
                counts[type(error).__name__] = counts.get(type(error).__name__, 0) + 1
                continue
            counts["compared"] += 1
            compare(mesh, peer)
    print(counts)
    assert counts["read"] > COUNT / 10
    assert counts["refused"] > COUNT / 10


def test_the_files_to_begin_with_are_whole(folder):
    for data in seeds():
        (folder / "mesh.ply").write_bytes(data)
        check(outcome(folder / "mesh.ply"))
