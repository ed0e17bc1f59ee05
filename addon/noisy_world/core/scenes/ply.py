# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading PLY meshes of every dialect."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .mesh import OBJECT_ID, Mesh
from .ply_colours import check_textures, read_colours, used_textures
from .ply_faces import INDEX_NAMES, Faces, read_faces
from .ply_file import DAMAGED, Element, Rows, check_finite, read_elements, read_header

_COARSE_M = 1e-4  # float32 coordinates whose resolution is coarser than this are worth a note; chosen


def read_ply(path: Path) -> Mesh:
    """Read a polygon mesh from a PLY file, ASCII or binary of either byte order.

    Vertices keep the file's precision. Colours are those of a texture, of the vertices or of the faces, in this order
    where a file has several. Normals, alpha and all other properties are skipped. Messages count from 0.

    Returns a Mesh: vertices_m (V, 3) float64 metres, colours, faces of three or more corners with none repeated in
    succession, and notes on what was dropped, guessed or lost.
    Raises InputError where the file is missing, not a PLY, cut short, damaged, or not a mesh, and where its texture is
    missing or no image.
    """
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    tables, notes = read_elements(path, header)
    face_notes: list[str] = []
    with np.errstate(invalid="ignore", over="ignore"):  # odd bit patterns are judged by the checks, not by warnings
        vertices_m = _vertices(tables["vertex"], notes)
        faces = read_faces(tables["face"], len(vertices_m), face_notes)
        colours = read_colours(path, header, tables, faces, notes)
        objects = _object_ids(tables["face"], faces)
    all_notes = tuple(notes + face_notes)
    return Mesh(
        vertices_m, colours.rgb, faces.corners, faces.starts, all_notes, colours.corner_rgb, colours.texture, objects
    )


def face_properties(path: Path) -> frozenset[str]:
    """Return the names of the numbers that each face has. Raises InputError where the file is no PLY."""
    face = read_header(path).elements.get("face")
    return frozenset() if face is None else frozenset(face.scalars)


def check_ply(path: Path) -> None:
    """Read the header only; raise InputError where the file is missing, not a PLY, not a mesh, or lacks its texture."""
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    check_textures(path, header)


def texture_files(path: Path) -> list[Path]:
    """Return the files of the textures that a mesh uses, those that are there. Raises InputError as check_ply does."""
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    return [file.path for file in used_textures(path, header) if file.found]


def _object_ids(rows: Rows, faces: Faces) -> NDArray[np.int64] | None:
    """Return the object of each kept face; None where the file tells none, or not by whole numbers."""
    if OBJECT_ID not in rows.element.scalars or rows.element.kinds[OBJECT_ID].kind not in "iu":
        return None
    return faces.of_faces(rows.values(OBJECT_ID)).astype(np.int64)


def _check_is_mesh(path: Path, elements: dict[str, Element]) -> None:
    vertex, face = elements.get("vertex"), elements.get("face")
    if vertex is None or vertex.rows == 0 or not {"x", "y", "z"} <= vertex.scalars:
        raise InputError(path, "holds no vertices with x, y and z", remedy="export it as a polygon mesh")
    if face is None or face.rows == 0:
        raise InputError(path, "holds no faces: a point cloud", remedy="mesh it first")
    if not any(name in face.lists and face.kinds[name].kind in "iu" for name in INDEX_NAMES):
        raise InputError(path, "its faces have no integer list vertex_indices", remedy="export it as a polygon mesh")


def _vertices(rows: Rows, notes: list[str]) -> NDArray[np.float64]:
    columns = [rows.values(name) for name in ("x", "y", "z")]
    vertices_m = np.stack(columns, axis=1, dtype=np.float64, casting="unsafe")
    check_finite(rows, vertices_m, "coordinate")
    farthest_m = np.float32(abs(vertices_m).max())
    if np.isinf(farthest_m):
        where = f"vertex {np.flatnonzero(np.isinf(vertices_m.astype(np.float32)).any(axis=1))[0]}"
        raise InputError(rows.body.path, "a coordinate is too large for float32", where=where, remedy=DAMAGED)
    apart_m = np.spacing(farthest_m)
    if apart_m > _COARSE_M and any(column.dtype.str[1:] == "f4" for column in columns):
        stored = f"coordinates near {farthest_m:.0f} m are stored as float32, {1000 * apart_m:.2f} mm apart"
        notes.append(f"{stored}: finer shape is lost in the file itself")
    return vertices_m
