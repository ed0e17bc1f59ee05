# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing meshes as PLY with textures, which lie beside the file and are named as MeshLab names them."""

import secrets
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import StorageError
from .mesh import Mesh, Texture
from .ply_writer import colour_bytes, corners_of_triangles, split_by_colour

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
