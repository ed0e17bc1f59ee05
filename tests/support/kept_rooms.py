# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms, built once and kept in pytest's cache until their code changes: building one takes seconds."""

import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
from locked import locked

from noisy_world import rooms as package
from noisy_world.scenes.polygon_mesh import Mesh

KEPT = "noisy_world_rooms"  # the folder in pytest's cache


class KeptRooms:
    """Rooms in a folder of files, which hold whole micrometres and bytes, as the rooms do."""

    def __init__(self, cache: Path):
        code = Path(package.__file__).parent
        digest = hashlib.sha256(np.__version__.encode())
        for path in sorted([*code.glob("*.py"), code.parent / "scenes/polygon_mesh.py"]):
            digest.update(path.read_bytes())
        self._folder = cache / digest.hexdigest()[:16]
        for other in cache.iterdir():
            if other != self._folder:
                shutil.rmtree(other, ignore_errors=True)
        self._folder.mkdir(exist_ok=True)

    def built(self, seed: int) -> Mesh:
        """Build a room, and keep it for others."""
        mesh = package.build_room(seed)
        parts = {
            "vertices_um": np.rint(mesh.vertices_m * 1e6).astype(np.int32),
            "rgb": np.rint(mesh.rgb.astype(np.float64) * 255).astype(np.uint8),
            "corner_vertices": mesh.corner_vertices,
        }
        kept = _mesh(parts)
        for name in ("vertices_m", "rgb", "corner_vertices", "face_starts"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(mesh, name), strict=True)
        path = self._folder / f"{os.getpid()}.npz"
        np.savez(path, **parts)
        path.replace(self._path(seed))
        return mesh

    def room(self, seed: int = 0) -> Mesh:
        """Return a room that was kept, or else build it."""
        with locked(self._folder / f"room{seed}.lock"):  # another process may be building it
            if not self._path(seed).is_file():
                return self.built(seed)
        with np.load(self._path(seed)) as parts:
            return _mesh(parts)

    def _path(self, seed: int) -> Path:
        return self._folder / f"room{seed}.npz"


def _mesh(parts) -> Mesh:
    corners = parts["corner_vertices"]
    return Mesh(
        vertices_m=parts["vertices_um"].astype(np.float64) / 1e6,
        rgb=(parts["rgb"].astype(np.float64) / 255.0).astype(np.float32),
        corner_vertices=corners,
        face_starts=np.arange(0, corners.size, 4, dtype=np.int32),
    )
