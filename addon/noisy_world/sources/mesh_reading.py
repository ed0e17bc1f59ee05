# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading the mesh of any file: PLY by our own reader, other formats by Blender's importers."""

from functools import lru_cache
from pathlib import Path

from ..core.scenes.mesh import Mesh
from ..core.scenes.mesh_files import files_beside, imported_format
from ..core.scenes.ply import read_ply
from ..core.scenes.turning import Up, turned


def read_mesh(path: Path, up: Up | None = None) -> Mesh:
    """Read a mesh, Z up. up: the axis of the file that points up; None is what it declares, or Z.

    Raises InputError where the file is missing, damaged or no mesh, and where its textures are;
    MissingDependencyError where it takes Blender and there is none.
    """
    return _read(path, up, changed_ns(path))


def forget_meshes() -> None:
    """Keep no mesh in memory."""
    _read.cache_clear()


@lru_cache(maxsize=1)
def _read(path: Path, up: Up | None, changed: tuple[int, ...]) -> Mesh:
    if imported_format(path) is None:
        return turned(read_ply(path), "z", up or "z")
    from .imported_meshes import import_mesh

    imported = import_mesh(path, up)
    _beside[path, changed] = imported.beside
    return imported.mesh


_beside: dict[tuple[Path, tuple[int, ...]], tuple[Path, ...]] = {}
"""The files that only an importer knows, of meshes that were read: found once, they are not imported again for that."""


def changed_ns(path: Path) -> tuple[int, ...]:
    """Return when a mesh and the files beside it that it is made of were changed last."""
    return tuple(file.stat().st_mtime_ns for file in (path, *files_beside(path)))


def files_of_mesh(path: Path) -> list[Path]:
    """Return the files beside a mesh that it is made of, those that are there.

    Those of USD are known only once it is imported. Raises as read_mesh does.
    """
    found = imported_format(path)
    if found is None or not found.refers:
        return files_beside(path)
    known = (path, changed_ns(path))
    if known not in _beside:
        read_mesh(path)
    return list(_beside[known])
