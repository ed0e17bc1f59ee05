# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of a PLY file: of its vertices, its faces, or in the textures that it names."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .beside import link_notes
from .mesh import Texture
from .ply_faces import Faces
from .ply_file import DAMAGED, Element, Header, Rows, check_finite
from .textures import TextureFile, locate_texture, read_picture

_COLOUR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_COLOUR_SLACK = 1e-3  # of full scale: colours stored as floats may overshoot their range by rounding
_LEAST_OF_BYTES = 16  # floats that reach no more are hardly bytes, which would all be near black; chosen
_STORE_COLOURS = "store them as uchar, 0 to 255, or as float, 0 to 1"
_CORNER_UV = "texcoord"  # a list of each face: u and v of each corner
_VERTEX_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_PICTURE = "texnumber"  # of each face


@dataclass(frozen=True)
class Colours:
    """The colours of a Mesh, as it has them."""

    rgb: NDArray[np.float32] | None
    corner_rgb: NDArray[np.float32] | None
    texture: Texture | None


def read_colours(path: Path, header: Header, tables: dict[str, Rows], faces: Faces, notes: list[str]) -> Colours:
    """Return what is shown of a file's colours: those of vertices rather than of faces, and a texture over both.

    MeshLab chooses so too; but where it multiplies a texture by the vertices' colours, here the texture alone is shown.
    The notes say what is left out. Raises InputError where colours or textures are damaged or missing.
    """
    vertex, face = tables["vertex"], tables["face"]
    on_vertices, on_faces = _colour_names(vertex.element), _colour_names(face.element)
    rgb = _colours(vertex, on_vertices, notes) if on_vertices else None
    face_rgb = _colours(face, on_faces, notes) if on_faces and not on_vertices else None
    corner_rgb = None if face_rgb is None else faces.at_corners(face_rgb)
    texture = _texture(path, header, tables, faces, notes)
    _note_excluded(header, texture, notes)
    return Colours(rgb, corner_rgb, texture)


def used_textures(path: Path, header: Header) -> list[TextureFile]:
    """Return the files of a mesh's textures; none where it has no texture coordinates, and so does not use them."""
    has_uv = _has_corner_uv(header.elements["face"]) or _vertex_uv_names(header.elements["vertex"])
    return [locate_texture(path, name) for name in header.textures] if has_uv else []


def check_textures(path: Path, header: Header) -> None:
    """Raise InputError where a texture is missing and the mesh has no other colours."""
    missing = [file for file in used_textures(path, header) if not file.found]
    if missing and not _has_colours(header):
        problem = f"its texture {missing[0].name[:200]!r} is missing: there is no {missing[0].path.name[:200]!r}"
        raise InputError(path, f"{problem} in {missing[0].path.parent}", remedy="put it there, beside the mesh")


def _has_colours(header: Header) -> bool:
    return any(_colour_names(header.elements[name]) for name in ("vertex", "face"))


def _colour_names(element: Element) -> tuple[str, ...] | None:
    return next((names for names in _COLOUR_NAMES if element.scalars.issuperset(names)), None)


def _colours(rows: Rows, names: tuple[str, ...], notes: list[str]) -> NDArray[np.float32]:
    """Return the colours (rows, 3) in [0, 1] of the vertices or of the faces."""
    rgb = np.stack([rows.values(name) for name in names], axis=1, dtype=np.float32, casting="unsafe")
    check_finite(rows, rgb, "colour")
    lowest, highest = rgb.min(), rgb.max()
    kinds = {rows.element.kinds[name].str[1:] for name in names}
    full = {"u1": 255, "u2": 65535}.get(max(kinds)) if len(kinds) == 1 else None
    if full is None and kinds <= {"f4", "f8"} and highest <= 1 + _COLOUR_SLACK:
        full = 1
    elif full is None and kinds & {"f4", "f8"} and highest < _LEAST_OF_BYTES:
        problem = f"colours are floats up to {highest:g}, which may be of 0 to 1, too bright, or of 0 to 255, too dark"
        raise InputError(rows.body.path, problem, remedy=_STORE_COLOURS)
    elif full is None:
        full = 255
        notes.append(f"colours are not stored as bytes and reach {highest:g}: read as 0..255")
    if lowest < -_COLOUR_SLACK * full or highest > (1 + _COLOUR_SLACK) * full:
        problem = f"colours lie between {lowest:g} and {highest:g}, not 0 and {full}"
        raise InputError(rows.body.path, problem, remedy=_STORE_COLOURS)
    return np.clip(rgb / np.float32(full), 0, 1)


def _note_excluded(header: Header, texture: Texture | None, notes: list[str]) -> None:
    vertex, face = header.elements["vertex"], header.elements["face"]
    where = [name for name, element in (("vertices", vertex), ("faces", face)) if _colour_names(element)]
    if texture is not None and where:
        notes.append(f"its texture is shown, and not the colours of its {' and '.join(where)}")
    elif len(where) == 2:
        notes.append("the colours of its vertices are shown, and not those of its faces")
    elif texture is None and not where:
        notes.append("no colours: shown in neutral grey")
    if "color" in face.lists:
        notes.append("its faces' lists color, of colours of corners, are left out")
    if any(name.startswith("multi_texture") for name in header.elements):
        notes.append("its elements multi_texture are left out")
    has_uv = _has_corner_uv(face) or _vertex_uv_names(vertex)
    if has_uv and not header.textures:
        notes.append("it has texture coordinates, but no line 'comment TextureFile NAME': they are left out")
    if header.textures and not has_uv:
        notes.append(f"it names the texture {header.textures[0][:60]!r}, but has no texture coordinates: left out")


# --- textures ---


def _has_corner_uv(face: Element) -> bool:
    return _CORNER_UV in face.lists


def _vertex_uv_names(vertex: Element) -> tuple[str, str] | None:
    return next((names for names in _VERTEX_UV if vertex.scalars.issuperset(names)), None)


def _texture(path: Path, header: Header, tables: dict[str, Rows], faces: Faces, notes: list[str]) -> Texture | None:
    """Return the texture; None where the file uses none, or none is found."""
    check_textures(path, header)
    files = used_textures(path, header)
    if not files:
        return None
    corner_uv, has_uv = _corner_uv(tables, faces)
    picture_of = np.where(has_uv, faces.of_faces(_face_pictures(tables["face"], len(files), notes)), -1)
    for file in files:
        if not file.found:
            notes.append(f"its texture {file.name[:200]!r} is missing in {file.path.parent}: other colours are shown")
        elif file.moved:
            notes.append(f"its texture is named {file.name[:200]!r}: {file.path.name} beside the mesh was taken")
    notes += link_notes(path, [file.path for file in files if file.found])
    numbers, pictures = np.full(len(files), -1), []
    for number, file in enumerate(files):
        if file.found and np.any(picture_of == number):
            picture, transparent = read_picture(file.path)
            if transparent:
                notes.append(f"{file.path.name} is transparent in places: it is shown without transparency")
            numbers[number] = len(pictures)
            pictures.append(picture)
    if not pictures:
        return None
    face_pictures = np.where(picture_of >= 0, numbers[picture_of], -1).astype(np.int32)
    if (bare := np.count_nonzero(face_pictures < 0)) and all(file.found for file in files):
        notes.append(f"{bare} of {len(face_pictures)} faces have no texture: other colours are shown, or grey")
    names = tuple(file.path.name for file, number in zip(files, numbers, strict=True) if number >= 0)
    return Texture(names, tuple(pictures), corner_uv, face_pictures)


def _corner_uv(tables: dict[str, Rows], faces: Faces) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return u and v (C, 2) of the corners, and which faces (F,) have them."""
    vertex, face = tables["vertex"], tables["face"]
    if not _has_corner_uv(face.element):
        names = _vertex_uv_names(vertex.element)
        assert names is not None, "the mesh has texture coordinates"
        uv = np.stack([vertex.values(name) for name in names], axis=1, dtype=np.float32, casting="unsafe")
        check_finite(vertex, uv, "texture coordinate")
        return uv[faces.corners], np.ones(len(faces.starts), bool)
    sizes, counts = faces.stored_sizes, np.broadcast_to(face.counts(_CORNER_UV), len(faces.stored_sizes))
    bad = np.flatnonzero((counts != 2 * sizes) & (counts != 0))
    if len(bad):
        problem = f"{counts[bad[0]]} texture coordinates for {sizes[bad[0]]} corners, which take 2 each"
        raise InputError(face.body.path, problem, where=f"face {bad[0]}", remedy=DAMAGED)
    values = face.values(_CORNER_UV).astype(np.float32)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        where = f"face {np.searchsorted(np.cumsum(counts), bad[0], side='right')}"
        raise InputError(face.body.path, "a texture coordinate is NaN or infinite", where=where, remedy=DAMAGED)
    stored = np.zeros((int(sizes.sum()), 2), np.float32)
    stored[np.repeat(counts > 0, sizes)] = values.reshape(-1, 2)
    return faces.of_corners(stored), faces.of_faces(counts > 0)


def _face_pictures(face: Rows, count: int, notes: list[str]) -> NDArray[np.int64]:
    """Return the number of each face's texture among `count`; negative where a face has none."""
    if _PICTURE not in face.element.scalars:
        if count > 1:
            notes.append(f"it names {count} textures, but its faces have no {_PICTURE}: the first is shown")
        return np.zeros(face.element.rows, np.int64)
    values = face.values(_PICTURE)
    numbers = np.clip(np.nan_to_num(values.astype(np.float64), nan=count), -1, count).astype(np.int64)
    bad = np.flatnonzero((numbers >= count) | (numbers != np.maximum(values, -1)))
    if len(bad):
        problem = f"{_PICTURE} {values[bad[0]]:.15g} is none of its {count} textures"
        raise InputError(face.body.path, problem, where=f"face {bad[0]}", remedy=DAMAGED)
    return numbers
