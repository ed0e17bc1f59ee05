# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures of PLY files, as MeshLab and others write them: which picture, and where in it each corner lies."""

import shutil
import zlib

import cv2
import numpy as np
import pytest
from refusals import refused
from cases import cases
from ply_files import BYTES, ENCODINGS, INDICES, MIXED, POINTS, QUADS, RGB, XYZ, as_bytes, face, ply, polygons, vertex

from noisy_world.scenes.ply import check_ply, read_ply, texture_files

TEXCOORD = "list uchar float texcoord"
PIXELS = np.arange(4 * 5 * 3, dtype=np.uint8).reshape(4, 5, 3) * 4  # RGB


def png(pixels=PIXELS):
    """A PNG of RGB or RGBA bytes, made by hand: no filter, one chunk of data."""

    def chunk(kind, data):
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    height, width, channels = pixels.shape
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, {3: 2, 4: 6, 1: 0}[channels], 0, 0, 0])
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def uv_of(faces, seed=0):
    """u and v of every corner of every face: eighths, which all encodings hold exactly."""
    dice = np.random.default_rng(seed)
    return [tuple((dice.integers(0, 17, 2 * len(f)) / 8).tolist()) for f in faces]


def textured(faces, uv, declarations=(*INDICES, TEXCOORD)):
    return "face", declarations, [(f, t) for f, t in zip(faces, uv, strict=True)]


def bare():
    return vertex(XYZ, list(POINTS))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a.png").write_bytes(png())
    return tmp_path


def write(folder, data, name="mesh.ply"):
    (folder / name).write_bytes(data)
    return folder / name


def corner_uv(mesh):
    ends = 2 * np.cumsum(mesh.face_sizes)
    flat = mesh.texture.corner_uv.ravel().tolist()
    return [tuple(flat[end - 2 * size : end]) for end, size in zip(ends, mesh.face_sizes, strict=True)]


@cases("encoding", ENCODINGS)
@cases("faces", [QUADS, MIXED])
@cases("kind", ["float", "double"])
def test_coordinates_of_corners(folder, encoding, faces, kind):
    uv = uv_of(faces)
    elements = textured(faces, uv, (*INDICES, f"list uchar {kind} texcoord"))
    mesh = read_ply(write(folder, ply(encoding, bare(), elements, extra=("comment TextureFile a.png",))))
    assert polygons(mesh) == faces
    assert corner_uv(mesh) == uv
    assert mesh.texture.names == ("a.png",)
    np.testing.assert_array_equal(mesh.texture.pictures[0], PIXELS)
    assert mesh.texture.face_pictures.tolist() == [0] * len(faces)
    assert mesh.rgb is None
    assert mesh.notes == ()


@cases("encoding", ENCODINGS)
@cases("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t")])
def test_coordinates_of_vertices(folder, encoding, names):
    uv = [(i / 8, 1 - i / 4) for i in range(len(POINTS))]
    rows = [(*p, *t) for p, t in zip(POINTS, uv, strict=True)]
    data = ply(
        encoding,
        vertex((*XYZ, *(f"float {n}" for n in names)), rows),
        face(MIXED),
        extra=("comment TextureFile a.png",),
    )
    mesh = read_ply(write(folder, data))
    assert corner_uv(mesh) == [tuple(x for k in f for x in uv[k]) for f in MIXED]
    assert mesh.notes == ()


def test_coordinates_of_corners_before_those_of_vertices(folder):
    rows = [(*p, 0.5, 0.5) for p in POINTS]
    uv = uv_of(QUADS)
    data = ply(
        "ascii", vertex((*XYZ, "float s", "float t"), rows), textured(QUADS, uv), extra=("comment TextureFile a.png",)
    )
    assert corner_uv(read_ply(write(folder, data))) == uv


@cases("encoding", ENCODINGS)
def test_corners_and_faces_that_go_take_their_coordinates_along(folder, encoding):
    faces = [(0, 1), (0, 1, 1, 2), (3, 3, 3), (2, 3, 4, 5)]
    uv = [
        (9.0,) * 4,
        (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875),
        (9.0,) * 6,
        (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0),
    ]
    mesh = read_ply(write(folder, ply(encoding, bare(), textured(faces, uv), extra=("comment TextureFile a.png",))))
    assert polygons(mesh) == [(0, 1, 2), (2, 3, 4, 5)]
    # of a corner that is repeated, the last stays
    assert corner_uv(mesh) == [(0.0, 0.125, 0.5, 0.625, 0.75, 0.875), uv[3]]


@cases("encoding", ENCODINGS)
def test_several_textures(folder, encoding):
    (folder / "b c.png").write_bytes(png(255 - PIXELS))
    faces, uv = QUADS + [(0, 1, 2)] * 2, uv_of(QUADS + [(0, 1, 2)] * 2)
    rows = [(f, t, n) for f, t, n in zip(faces, uv, (1, 0, -1, 1), strict=True)]
    comments = ("comment TextureFile a.png", "comment made by hand", "comment TextureFile b c.png")
    data = ply(encoding, bare(), ("face", (*INDICES, TEXCOORD, "int texnumber"), rows), extra=comments)
    mesh = read_ply(write(folder, data))
    assert mesh.texture.names == ("a.png", "b c.png")
    assert mesh.texture.face_pictures.tolist() == [1, 0, -1, 1]
    np.testing.assert_array_equal(mesh.texture.pictures[1], 255 - PIXELS)
    assert (
        mesh.notes
        == ("1 of 4 faces have no texture: other colours are shown, or grey", "no colours: shown in neutral grey")[:1]
    )


def test_without_numbers_the_first_is_shown(folder):
    (folder / "b.png").write_bytes(png())
    comments = ("comment TextureFile a.png", "comment TextureFile b.png")
    mesh = read_ply(write(folder, ply("ascii", bare(), textured(QUADS, uv_of(QUADS)), extra=comments)))
    assert mesh.texture.names == ("a.png",)
    assert mesh.notes == ("it names 2 textures, but its faces have no texnumber: the first is shown",)


@cases("number", [2, 7, 2**31 - 1, float("nan"), 0.5])
def test_a_number_of_no_texture(folder, number):
    kind = "double" if isinstance(number, float) else "int"
    rows = [((0, 1, 2), (0.0,) * 6, number)]
    comments = ("comment TextureFile a.png", "comment TextureFile a.png")
    data = ply("binary_big_endian", bare(), ("face", (*INDICES, TEXCOORD, f"{kind} texnumber"), rows), extra=comments)
    refused(read_ply, write(folder, data), names=("face 0: texnumber ", " is none of its 2 textures"))


def test_a_texture_comes_before_other_colours(folder):
    rows = [(f, t, 1, 2, 3) for f, t in zip(QUADS, uv_of(QUADS), strict=True)]
    data = ply("ascii", vertex(), ("face", (*INDICES, TEXCOORD, *RGB), rows), extra=("comment TextureFile a.png",))
    mesh = read_ply(write(folder, data))
    assert mesh.texture is not None
    assert as_bytes(mesh) == BYTES
    assert mesh.notes == ("its texture is shown, and not the colours of its vertices and faces",)


@cases("encoding", ENCODINGS)
def test_faces_without_coordinates_show_other_colours(folder, encoding):
    rows = [(QUADS[0], uv_of(QUADS)[0]), (QUADS[1], ())]
    data = ply(encoding, vertex(), ("face", (*INDICES, TEXCOORD), rows), extra=("comment TextureFile a.png",))
    mesh = read_ply(write(folder, data))
    assert mesh.texture.face_pictures.tolist() == [0, -1]
    assert mesh.notes[0] == "1 of 2 faces have no texture: other colours are shown, or grey"


class TestWhereItLies:
    def mesh(self, folder, name, elements=None):
        data = ply("ascii", elements or bare(), textured(QUADS, uv_of(QUADS)), extra=(f"comment TextureFile {name}",))
        return write(folder, data)

    @cases("name", ["textures/a.png", "textures\\a.png", "./textures/a.png"])
    def test_in_a_folder_beside_the_mesh(self, folder, name):
        (folder / "textures").mkdir(exist_ok=True)
        (folder / "textures/a.png").write_bytes(png(255 - PIXELS))
        path = self.mesh(folder, name)
        check_ply(path)
        mesh = read_ply(path)
        np.testing.assert_array_equal(mesh.texture.pictures[0], 255 - PIXELS)
        assert mesh.notes == ()
        assert texture_files(path) == [folder / "textures/a.png"]

    @cases("name", ["/home/somebody/scans/a.png", "C:\\scans\\a.png", "../scans/a.png", "gone/a.png", "..\\a.png"])
    def test_elsewhere_is_taken_from_beside_the_mesh(self, folder, name):
        path = self.mesh(folder, name)
        check_ply(path)
        mesh = read_ply(path)
        np.testing.assert_array_equal(mesh.texture.pictures[0], PIXELS)
        assert mesh.notes == (f"its texture is named {name!r}: a.png beside the mesh was taken",)

    def test_a_link_that_leads_elsewhere_is_followed_and_said(self, folder, tmp_path_factory):
        target = tmp_path_factory.mktemp("store") / "blob"
        target.write_bytes(png(255 - PIXELS))
        (folder / "link.png").symlink_to(target)
        mesh = read_ply(self.mesh(folder, "link.png"))
        np.testing.assert_array_equal(mesh.texture.pictures[0], 255 - PIXELS)
        assert mesh.notes == (f"its file 'link.png' is a link out of the mesh's folder, to {str(target)!r}",)

    def test_a_file_elsewhere_is_not_opened(self, tmp_path):
        inner = tmp_path / "inner"
        inner.mkdir()
        (tmp_path / "secret.png").write_bytes(png())
        for name in ("../secret.png", str(tmp_path / "secret.png")):
            refused(
                read_ply,
                self.mesh(inner, name),
                names=("mesh.ply: its texture ", "is missing", "'secret.png'"),
            )

    @cases(
        "name",
        ["b.png", "x" * 5000 + ".png", ".", "..", "/", "C:\\", "a\x01b.png", "ünder.png", "a.png/b.png", "nul\x00.png"],
    )
    def test_missing_is_an_error_that_names_both_files(self, folder, name):
        path = self.mesh(folder, name)
        for function in (check_ply, read_ply):
            said = refused(function, path, names=("mesh.ply: its texture ", "is missing", "put it there"))
            assert len(said) < 1500

    @cases("elements", [vertex(), None])
    def test_missing_beside_other_colours_is_a_note(self, folder, elements):
        rows = [(f, t, 1, 2, 3) for f, t in zip(QUADS, uv_of(QUADS), strict=True)]
        faces = ("face", (*INDICES, TEXCOORD, *RGB), rows)
        path = write(folder, ply("ascii", elements or bare(), faces, extra=("comment TextureFile b.png",)))
        check_ply(path)
        mesh = read_ply(path)
        assert mesh.texture is None
        assert mesh.notes[0] == f"its texture 'b.png' is missing in {folder}: other colours are shown"
        assert texture_files(path) == []


def test_a_name_without_coordinates_is_said(folder):
    mesh = read_ply(write(folder, ply("ascii", vertex(), face(QUADS), extra=("comment TextureFile gone.png",))))
    assert mesh.notes == ("it names the texture 'gone.png', but has no texture coordinates: left out",)


@cases("encoding", ENCODINGS)
def test_damaged_coordinates(folder, encoding):
    cases_ = [
        ([(0.0,) * 8, (0.0,) * 6], "face 1: 6 texture coordinates for 4 corners"),
        ([(0.0,) * 8, (0.0,) * 7 + (float("nan"),)], "face 1: a texture coordinate is NaN or infinite"),
        ([(float("inf"),) + (0.0,) * 7, (0.0,) * 8], "face 0: a texture coordinate is NaN or infinite"),
    ]
    for uv, problem in cases_:
        data = ply(encoding, bare(), textured(QUADS, uv), extra=("comment TextureFile a.png",))
        refused(read_ply, write(folder, data), names=problem)
    rows = [(*p, 0.0, float("nan")) for p in POINTS]
    data = ply(encoding, vertex((*XYZ, "float s", "float t"), rows), face(QUADS), extra=("comment TextureFile a.png",))
    refused(read_ply, write(folder, data), names="vertex 0: a texture")


class TestPictures:
    def picture(self, folder, data):
        (folder / "a.png").write_bytes(data)
        path = write(folder, ply("ascii", bare(), textured(QUADS, uv_of(QUADS)), extra=("comment TextureFile a.png",)))
        return read_ply(path)

    def test_jpeg(self, folder):
        smooth = np.add.outer(np.arange(16), np.arange(24)).astype(np.uint8)[..., None] * np.array([1, 2, 3], np.uint8)
        data = cv2.imencode(".jpg", smooth[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
        assert np.abs(self.picture(folder, data).texture.pictures[0].astype(int) - smooth).max() <= 3

    def test_a_cameras_orientation_is_not_applied(self, folder):
        data = cv2.imencode(".jpg", np.zeros((16, 24, 3), np.uint8))[1].tobytes()
        exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"  # turned by 90 degrees
        turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
        assert self.picture(folder, turned).texture.pictures[0].shape == (16, 24, 3)

    def test_grey(self, folder):
        shown = self.picture(folder, png(PIXELS[..., :1])).texture.pictures[0]
        np.testing.assert_array_equal(shown, PIXELS[..., :1].repeat(3, axis=2))

    def test_transparency_is_said(self, folder):
        opaque = np.full((4, 5, 1), 255, np.uint8)
        assert self.picture(folder, png(np.concatenate([PIXELS, opaque], axis=2))).notes == ()
        mesh = self.picture(folder, png(np.concatenate([PIXELS, opaque // 2], axis=2)))
        np.testing.assert_array_equal(mesh.texture.pictures[0], PIXELS)
        assert mesh.notes == ("a.png is transparent in places: it is shown without transparency",)

    def test_16_bits_are_rounded(self, folder):
        deep = np.array([0, 128, 129, 257, 385, 386, 65535, 65406, 65407, 33000] * 2, np.uint16).reshape(4, 5)
        data = cv2.imencode(".png", np.stack([deep] * 3, axis=2))[1].tobytes()
        expected = np.floor(deep / 257 + 0.5)
        np.testing.assert_array_equal(self.picture(folder, data).texture.pictures[0][..., 0], expected)

    @cases(
        "data",
        [b"", b"no image", b"\x89PNG\r\n\x1a\n", png()[:60], png()[:-30], b"\xff\xd8\xff\xd9", png()[:30] + b"x" * 99],
    )
    def test_no_image(self, folder, data):
        refused(self.picture, folder, data, names="a.png: ")

    def test_a_jpeg_that_was_cut(self, folder):
        noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
        data = cv2.imencode(".jpg", noise)[1].tobytes()
        for size in (len(data) - 2, len(data) // 2, len(data) // 4):
            refused(self.picture, folder, data[:size], names="cut short")
        self.picture(folder, data)

    def test_a_folder_in_its_place(self, folder):
        (folder / "a.png").unlink()
        (folder / "a.png").mkdir()
        path = write(folder, ply("ascii", bare(), textured(QUADS, uv_of(QUADS)), extra=("comment TextureFile a.png",)))
        refused(read_ply, path, names="is missing")
        shutil.rmtree(folder / "a.png")
