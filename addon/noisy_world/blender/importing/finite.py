# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that imported coordinates are finite, before Blender replaces those that are not by 0."""

import contextlib
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import bpy
import numpy as np


class NonFiniteMeshError(Exception):
    """A value of a mesh is NaN or infinite; the message says which."""


def check_finite(mesh: bpy.types.Mesh, *, uv: bool = False) -> None:
    """Raise NotFiniteError where a vertex is not finite. uv: or a texture coordinate."""
    vertices_m = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices_m.ravel())
    if not np.isfinite(vertices_m).all():
        raise NonFiniteMeshError("a coordinate is NaN or infinite")
    for layer in mesh.uv_layers if uv else ():
        values = np.empty((len(mesh.loops), 2), np.float32)
        layer.uv.foreach_get("vector", values.ravel())
        if not np.isfinite(values).all():
            raise NonFiniteMeshError("a texture coordinate is NaN or infinite")


@contextlib.contextmanager
def finite_gltf() -> Iterator[None]:
    """Have glTF's importer, which is a script, look at each mesh before it validates it.

    Raises NotFiniteError at the end, for the importer makes a text of every error.
    """
    module: Any = import_module("io_scene_gltf2.blender.imp.mesh")
    smooth, found = module.set_poly_smoothing, list[NonFiniteMeshError]()

    def looked_at(gltf: Any, pymesh: Any, mesh: bpy.types.Mesh, *rest: Any) -> None:  # the last step before
        try:
            check_finite(mesh, uv=True)
        except NonFiniteMeshError as error:
            found.append(error)
            raise
        smooth(gltf, pymesh, mesh, *rest)

    module.set_poly_smoothing = looked_at
    try:
        yield
    except RuntimeError:
        if not found:
            raise
    finally:
        module.set_poly_smoothing = smooth
    if found:
        raise found[0]
