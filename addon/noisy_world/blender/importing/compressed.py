# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether this Blender can read compressed glTF: the libraries for it are missing in the bpy package."""

from importlib import import_module

_BRIDGES = {"Draco": "bf_extern_draco", "meshopt": "bf_intern_meshopt_bridge"}


def compression_problem(kind: str) -> str:
    """Return the problem with reading meshes of a compression, Draco or meshopt; empty where there is none."""
    if not kind:
        return ""
    library = import_module("io_scene_gltf2.io.com.library")
    path = library.dll_path(_BRIDGES[kind], kind)
    if path is not None and path.is_file():
        return ""
    return f"its meshes are compressed with {kind}, which this Blender cannot read; export it without compression"
