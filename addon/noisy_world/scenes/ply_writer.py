# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing meshes as PLY: in Replica's layout, as triangles, or with textures."""

import secrets
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import StorageError
from .polygon_mesh import Mesh, Texture


def write_ply(path: Path, mesh: Mesh, *, normals: NDArray | None = None, triangulate: bool = False) -> None:
    """Write a mesh in Replica's layout: binary little-endian, float normals, byte colours, int indices.

    normals: (V, 3) unit vectors in the vertices' axes; area-weighted ones are computed where None.
    triangulate: cut each polygon into a fan of triangles, for the many readers that read nothing else.
    Colours are left out where the mesh has none, and so is a texture. A vertex whose corners differ in colour becomes
    one for each. The file is written completely or not at all.
    Raises StorageError where it cannot be written.
    """
    fan = _fan(mesh)
    normals = _vertex_normals(mesh, fan) if normals is None else normals
    if mesh.corner_rgb is not None:
        mesh, normals = split_by_colour(mesh, mesh.corner_rgb, normals)
        fan = _fan(mesh)
    fields = [("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)]
    vertices = np.empty(len(mesh.vertices_m), fields if mesh.rgb is not None else fields[:2])
    vertices["xyz"] = mesh.vertices_m
    vertices["normal"] = normals
    if mesh.rgb is not None:
        vertices["rgb"] = colour_bytes(mesh.rgb)
    corners, sizes = mesh.corner_vertices, mesh.face_sizes
    if triangulate:
        corners, sizes = fan.reshape(-1), np.full(len(fan), 3)
    length = "uchar" if sizes.max(initial=0) <= 255 else "uint"
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue") if mesh.rgb is not None]
    lines += [f"element face {len(sizes)}", f"property list {length} int vertex_indices", "end_header", ""]
    words = np.insert(corners, np.cumsum(sizes) - sizes, sizes).astype("<i4").view(np.uint8).reshape(-1, 4)
    kept = np.ones(words.shape, bool)
    kept[np.cumsum(sizes + 1) - sizes - 1, (1 if length == "uchar" else 4) :] = (
        False  # of a length, its low bytes alone
    )
    temporary = Path(f"{path}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.writelines(("\n".join(lines).encode(), vertices, words[kept]))
        temporary.replace(path)
    except OSError as error:
        raise StorageError(f"cannot be written: {error.strerror or error}", file=path) from error
    finally:
        with suppress(OSError):  # it is gone after a success
            temporary.unlink()


def _fan(mesh: Mesh) -> NDArray[np.int32]:
    """(T, 3) int32: the vertices of each polygon's triangles."""
    return mesh.corner_vertices[corners_of_triangles(mesh)]


def corners_of_triangles(mesh: Mesh) -> NDArray[np.integer]:
    """(T, 3): each polygon as the triangles of its corners (0, k, k + 1), by their places among all corners."""
    counts = mesh.face_sizes - 2
    first = np.repeat(mesh.face_starts, counts)
    step = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)


def colour_bytes(rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return colours in [0, 1] as bytes."""
    return np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


def split_by_colour(mesh: Mesh, corner_rgb: NDArray[np.float32], normals: NDArray) -> tuple[Mesh, NDArray]:
    """Return the mesh with a vertex for each colour that a vertex has at its corners, and the normals of these."""
    rgb = colour_bytes(corner_rgb).astype(np.int64)
    keys = (mesh.corner_vertices.astype(np.int64) << 24) | (rgb[:, 0] << 16) | (rgb[:, 1] << 8) | rgb[:, 2]
    _, firsts, corners = np.unique(keys, return_index=True, return_inverse=True)
    origin = mesh.corner_vertices[firsts]
    split = Mesh(mesh.vertices_m[origin], corner_rgb[firsts], corners.astype(np.int32), mesh.face_starts)
    return split, normals[origin]


def _vertex_normals(mesh: Mesh, triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """(V, 3) float64 unit vectors: the faces' normals weighted by area; 0 0 0 at a vertex without a face."""
    sizes, (a_m, b_m, c_m) = mesh.face_sizes, mesh.vertices_m[triangles.T]
    areas = np.add.reduceat(np.cross(b_m - a_m, c_m - a_m), np.cumsum(sizes - 2) - (sizes - 2), axis=0)
    weights, vertex_count = np.repeat(areas, sizes, axis=0).T, len(mesh.vertices_m)
    sums = np.stack([np.bincount(mesh.corner_vertices, column, vertex_count) for column in weights], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.zeros(sums.shape), where=lengths > 0)


# Writing meshes as PLY with textures, which lie beside the file and are named as MeshLab names them.


_MOST_IN_BYTES = 127  # corners of a face whose texture coordinates a list with a length of one byte holds


def write_textured_ply(path: Path, mesh: Mesh, texture: Texture, *, triangulate: bool = False) -> list[Path]:
    """Write a mesh with its texture: binary little-endian, texture coordinates of corners, the number of each picture.

    The pictures become NAME_0.png and so on beside NAME.ply; all are written before it. Colours of vertices are written
    too, for faces without a picture; corners that differ in colour split a vertex, as in write_ply. triangulate: cut
    each polygon into a fan of triangles. Returns the pictures' files. Raises StorageError where one cannot be written.
    """
    if mesh.corner_rgb is not None:
        mesh, _ = split_by_colour(mesh, mesh.corner_rgb, np.zeros_like(mesh.vertices_m))
    corners, sizes, pictures = np.arange(len(mesh.corner_vertices)), mesh.face_sizes, texture.face_pictures
    if triangulate:
        corners = corners_of_triangles(mesh).reshape(-1)
        pictures, sizes = np.repeat(pictures, sizes - 2), np.full(len(corners) // 3, 3)
    files = [path.with_name(f"{path.stem}_{number}.png") for number in range(len(texture.pictures))]
    fields = [("xyz", "<f4", 3), ("rgb", "u1", 3)]
    vertices = np.empty(len(mesh.vertices_m), fields if mesh.rgb is not None else fields[:1])
    vertices["xyz"] = mesh.vertices_m
    if mesh.rgb is not None:
        vertices["rgb"] = colour_bytes(mesh.rgb)
    length = "uchar" if sizes.max(initial=0) <= _MOST_IN_BYTES else "uint"
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment TextureFile {file.name}" for file in files)]
    lines += [f"element vertex {len(vertices)}", *(f"property float {name}" for name in "xyz")]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue") if mesh.rgb is not None]
    lines += [f"element face {len(sizes)}", f"property list {length} int vertex_indices"]
    lines += [f"property list {length} float texcoord", "property int texnumber", "end_header", ""]
    faces = _rows(mesh.corner_vertices[corners], texture.corner_uv[corners], sizes, pictures, length)
    for file, picture in zip(files, texture.pictures, strict=True):
        _write(file, _png(picture))
    _write(path, "\n".join(lines).encode(), vertices.tobytes(), faces.tobytes())
    return files


def _rows(
    corners: NDArray[np.int32],
    uv: NDArray[np.float32],
    sizes: NDArray[np.int32],
    pictures: NDArray[np.int32],
    length: str,
) -> NDArray[np.uint8]:
    """Return the faces' rows, one after another: all of one size are written together."""
    kind = "u1" if length == "uchar" else "<u4"
    starts = np.cumsum(sizes) - sizes
    widths = 2 * np.dtype(kind).itemsize + 12 * sizes + 4
    places = np.cumsum(widths) - widths
    written = np.empty(int(widths.sum()), np.uint8)
    for size in np.unique(sizes).tolist():
        there = np.flatnonzero(sizes == size)
        own = starts[there, None] + np.arange(size)
        fields = [("n", kind), ("corners", "<i4", (size,)), ("m", kind), ("uv", "<f4", (size, 2)), ("picture", "<i4")]
        rows = np.empty(len(there), fields)
        rows["n"], rows["corners"], rows["m"] = size, corners[own], 2 * size
        rows["uv"], rows["picture"] = uv[own], pictures[there]
        written[places[there, None] + np.arange(rows.dtype.itemsize)] = rows.view(np.uint8).reshape(len(there), -1)
    return written


def _png(picture: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    assert done
    return data.tobytes()


def _write(path: Path, *parts: bytes) -> None:
    """Write a file completely or not at all."""
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.writelines(parts)
        temporary.replace(path)
    except OSError as error:
        raise StorageError(f"cannot be written: {error.strerror or error}", file=path) from error
    finally:
        with suppress(OSError):  # it is gone after a success
            temporary.unlink()
