# SPDX-License-Identifier: GPL-3.0-or-later
"""The base colour of imported materials, against the formulas of the glTF specification, evaluated pixel by pixel."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed")

from analytic import look_at
from cases import cases
from importing import import_here
from ray_tools import cast
import rooms_in_formats as rooms
from rooms_in_formats import glb, gltf, png

from srgb import encoded, linear
from noisy_world.core.geometry import Intrinsics
from noisy_world.sources.rendered_mesh import read_mesh

SIDE = 40
CAMERA = Intrinsics(SIDE, SIDE, SIDE, SIDE, (SIDE - 1) / 2, (SIDE - 1) / 2)
EYE = look_at([0.5, -1.0, 0.5], [0.5, 1.0, 0.5])  # sees the unit square x, z at y = 0, whole and head on
PICTURE = np.random.default_rng(1).integers(0, 256, (4, 6, 3)).astype(np.uint8)
OTHER = np.random.default_rng(2).integers(0, 256, (5, 5, 3)).astype(np.uint8)
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], float)  # x and z of two triangles


@pytest.fixture(autouse=True)
def _imports_here(monkeypatch, capfd):
    import_here(monkeypatch, capfd)


def square(folder, material, *, uv=None, colours=None, other_uv=None, **keys):
    """The mesh of a square that a glTF file holds. uv: (6, 2) as glTF has them, from the top left."""
    attributes = {"POSITION": np.stack([CORNERS[:, 0], CORNERS[:, 1], np.zeros(6)], axis=1)}  # Y up
    given = {"TEXCOORD_0": uv, "TEXCOORD_1": other_uv, "COLOR_0": colours}
    attributes |= {name: values for name, values in given.items() if values is not None}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "square.glb"
    path.write_bytes(glb(*gltf(attributes, material, **keys)))
    return read_mesh(path)


def places():
    """Where each pixel (H, W) looks at the square: x and z, 0 to 1."""
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE, (np.arange(SIDE) + 0.5) / SIDE)
    return x, 1 - y


def texel(number, count, wrap):
    if wrap == REPEAT:
        return number % count
    if wrap == CLAMP:
        return np.clip(number, 0, count - 1)
    number = number % (2 * count)
    return np.where(number < count, number, 2 * count - 1 - number)


def sampled(picture, u, v, wraps):
    """A picture's colours [0, 1] at u, v from its top left, between texels, as glTF's samplers wrap them."""
    height, width = picture.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    result = 0
    for column, row, share in (
        (left, top, (1 - x + left) * (1 - y + top)),
        (left + 1, top, (x - left) * (1 - y + top)),
        (left, top + 1, (1 - x + left) * (y - top)),
        (left + 1, top + 1, (x - left) * (y - top)),
    ):
        here = picture[texel(row, height, wraps[1]), texel(column, width, wraps[0])] / 255
        result = result + share[..., None] * here
    return result


def textured(**keys):
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **keys}}}


def rgb_of(mesh):
    return cast(mesh, EYE, CAMERA).rgb


@cases(
    "wraps", [(REPEAT, REPEAT), (CLAMP, CLAMP), (MIRROR, MIRROR), (CLAMP, REPEAT), (MIRROR, CLAMP), (REPEAT, MIRROR)]
)
def test_wraps_are_those_of_the_file(tmp_path, wraps):
    uv = np.array([-0.7, 1.9]) + CORNERS * (2.6, -2.5)
    sampler = {"wrapS": wraps[0], "wrapT": wraps[1]}
    mesh = square(tmp_path / str(wraps), textured(), uv=uv, images=[png(PICTURE)], samplers=[sampler])
    assert mesh.notes == ()
    x, z = places()
    expected = sampled(PICTURE, -0.7 + 2.6 * x, 1.9 - 2.5 * z, wraps)
    assert np.abs(rgb_of(mesh) - expected).max() < 1e-5


def test_coordinates_are_transformed_and_those_that_the_texture_names(tmp_path):
    offset, turn, scale = np.array([0.3, -0.2]), 0.7, np.array([1.5, 0.8])
    transform = {"offset": offset.tolist(), "rotation": turn, "scale": scale.tolist(), "texCoord": 1}
    material = textured(extensions={"KHR_texture_transform": transform})
    mesh = square(
        tmp_path,
        material,
        uv=CORNERS * 0,
        other_uv=CORNERS,
        images=[png(PICTURE)],
        extensionsUsed=["KHR_texture_transform"],
    )
    x, z = places()
    # KHR_texture_transform: translation * rotation * scale, which turns counter-clockwise as seen in the picture
    u = offset[0] + np.cos(turn) * scale[0] * x + np.sin(turn) * scale[1] * z
    v = offset[1] - np.sin(turn) * scale[0] * x + np.cos(turn) * scale[1] * z
    assert np.abs(rgb_of(mesh) - sampled(PICTURE, u, v, (REPEAT, REPEAT))).max() < 1e-5


def test_a_factor_acts_on_light_and_a_picture_stays_bytes(tmp_path):
    material = textured()
    material["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1.0, 0.1, 1.0]
    uv = CORNERS * (1, -1) + (0, 1)
    mesh = square(tmp_path, material, uv=uv, images=[png(np.full((2, 2, 3), (200, 90, 30), np.uint8))])
    expected = encoded(linear(np.array([200, 90, 30]) / 255) * (0.5, 1.0, 0.1))
    assert np.abs(rgb_of(mesh) - expected).max() <= 0.5 / 255 + 1e-6


def test_colours_of_vertices_are_light_times_the_factor(tmp_path):
    colours = np.tile([[0.2, 0.6, 0.05]], (6, 1))
    colours[3:] = (0.9, 0.3, 0.4)
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 1.0]}}
    mesh = square(tmp_path / "factor", material, colours=colours)
    assert mesh.notes == ()
    x, z = places()
    expected = encoded(np.where((z < x)[..., None], colours[0], colours[3]) * (0.5, 0.25, 1.0))
    off = np.abs(x - z) > 0.02
    byte = 0.5 / 255 + 1e-6  # to which Blender rounds them, display-encoded, before they are multiplied
    assert np.abs(rgb_of(mesh) - expected)[off].max() < byte
    plain = square(tmp_path / "none", None, colours=colours)
    assert np.abs(rgb_of(plain) - encoded(np.where((z < x)[..., None], colours[0], colours[3])))[off].max() < byte


def test_a_material_without_pictures_is_its_factor_and_none_is_grey(tmp_path):
    mesh = square(tmp_path / "factor", {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 1.0]}})
    assert np.abs(rgb_of(mesh) - encoded(np.array([0.5, 0.25, 1.0]))).max() < 1e-5
    grey = square(tmp_path / "none", None)
    assert grey.notes == ("no colours: shown in neutral grey",)
    assert np.abs(rgb_of(grey) - 128 / 255).max() < 1e-5


def test_an_obj_without_its_mtl_is_grey_where_nothing_else_says_a_colour(tmp_path):
    """The materials of a file that is there stay; colours of vertices are shown."""
    room = rooms.write_obj(tmp_path)
    (tmp_path / "room.mtl").unlink()
    mesh = read_mesh(room)
    np.testing.assert_allclose(mesh.rgb, 128 / 255, atol=1e-6)
    assert mesh.texture is None
    (said,) = mesh.notes
    assert "'room.mtl'" in said
    assert str(tmp_path) in said

    (tmp_path / "other.mtl").write_text("newmtl red\r\nKd 1 0 0\n")
    two = "usemtl red\nf 1 2 3\nusemtl gone\nf 4 5 6\n"
    points = [f"v {x} 0 {z}" for x, z in CORNERS.tolist()]
    room.write_text("\n".join(["mtllib other.mtl", *points, two]))
    mesh = read_mesh(room)
    np.testing.assert_allclose(mesh.rgb, [[1, 0, 0]] * 3 + [[128 / 255] * 3] * 3, atol=1e-6)
    assert "'gone'" in mesh.notes[0]
    assert "'red'" not in mesh.notes[0]

    colours = np.array([[0, 51, 102], [153, 204, 255]] * 3) / 255
    coloured = [f"{point} {r} {g} {b}" for point, (r, g, b) in zip(points, colours.tolist(), strict=True)]
    room.write_text("\n".join(["mtllib gone.mtl", *coloured, two]))
    mesh = read_mesh(room)
    np.testing.assert_allclose(mesh.rgb, colours, atol=1e-6)
    assert "'gone.mtl'" in mesh.notes[0]


def test_what_cannot_be_shown_is_told(tmp_path):
    uv, colours = CORNERS * (1, -1) + (0, 1), np.random.default_rng(0).uniform(0, 1, (6, 3))
    x, z = places()
    expected = sampled(PICTURE, x, 1 - z, (REPEAT, REPEAT))
    both = square(tmp_path / "both", textured(), uv=uv, colours=colours, images=[png(PICTURE)])
    assert np.abs(rgb_of(both) - expected).max() < 1e-5
    (note,) = both.notes
    assert "the texture is shown, and not multiplied by the colours of vertices" in note
    seen = square(
        tmp_path / "glass", textured() | {"alphaMode": "BLEND", "name": "glass"}, uv=uv, images=[png(PICTURE)]
    )
    assert seen.notes == ("'glass': transparent, and shown without transparency",)
    nearest = {"magFilter": 9728, "minFilter": 9728}
    squares = square(tmp_path / "nearest", textured(), uv=uv, images=[png(PICTURE)], samplers=[nearest])
    assert "texels are meant as squares" in squares.notes[0]
    bare = square(tmp_path / "bare", textured(), images=[png(PICTURE)])
    assert bare.texture is None
    assert "without texture coordinates" in bare.notes[0]


@cases("how", ["unlit", "emission"])
def test_unlit_materials(tmp_path, how):
    uv = CORNERS * (1, -1) + (0, 1)
    unlit = textured() | {"extensions": {"KHR_materials_unlit": {}}}
    black = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1, 1, 1]}
    material = unlit if how == "unlit" else black | {"emissiveTexture": {"index": 0}}
    used = {"extensionsUsed": ["KHR_materials_unlit"]} if how == "unlit" else {}
    mesh = square(tmp_path / how, material, uv=uv, images=[png(PICTURE)], **used)
    assert mesh.notes == ()
    x, z = places()
    assert np.abs(rgb_of(mesh) - sampled(PICTURE, x, 1 - z, (REPEAT, REPEAT))).max() < 1e-5
