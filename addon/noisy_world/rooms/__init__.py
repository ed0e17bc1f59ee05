# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms: furnished scenes as one mesh of quads with light and texture in its vertex colours.

Building one takes seconds, so it is kept in the folder of the user's caches until its code changes.
"""

import contextlib
import hashlib
import importlib
import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import write_atomic
from ..core.errors import StorageError
from ..core.file_access import alone_in, private_cache_folder, read_bytes
from ..scenes import polygon_mesh
from ..scenes.polygon_mesh import Mesh

if TYPE_CHECKING:
    from .light import Lighting
    from .surfaces import Piece

_ROOMS = (  # modules, each with a function of its name; the first is room 0
    "living_room",
    "bedroom",
    "l_shape",
    "corridor",
    "two_rooms",
    "open_office",
    "small_office",
    "meeting_room",
)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A room in whole numbers, which files hold exactly: its sheets of vertices one after the other.

    vertices_um: (V, 3) int32, as the last bits of a sine differ between processors. codes: (V, 3) uint8, of the
    colours. shapes: (S, 2) int32, the rows and columns of each sheet. objects: (S,) int32, the thing that it is a part
    of, from 1 on; 0 of none. classes: (O,) int32, of each thing.
    """

    vertices_um: NDArray[np.int32]
    codes: NDArray[np.uint8]
    shapes: NDArray[np.int32]
    objects: NDArray[np.int32]
    classes: NDArray[np.int32]

    def mesh(self) -> Mesh:
        from .surfaces import CLASSES

        corners: list[NDArray[np.int32]] = []
        first = 0
        for rows, columns in self.shapes.tolist():
            at = first + (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
            corners.append(np.stack([at, at + 1, at + columns + 1, at + columns], -1).astype(np.int32))
            first += rows * columns
        quads = np.concatenate(corners)
        return Mesh(
            vertices_m=self.vertices_um / 1e6,
            rgb=np.divide(self.codes, 255, dtype=np.float32),
            corner_vertices=quads.ravel(),
            face_starts=np.arange(0, quads.size, 4, dtype=np.int32),
            object_ids=np.repeat(self.objects.astype(np.int64), np.prod(self.shapes - 1, axis=1)),
            object_classes=tuple((number, CLASSES[number - 1]) for number in self.classes.tolist()),
        )


def build_room(seed: int = 0) -> Mesh:
    """The room of a seed, built here and now, the same to the byte on every call.

    Metres, Z up, floor at z = 0; what is seen through windows lies outside of the rooms. All faces are quads; vertices
    are whole micrometres, and colours are display-encoded multiples of 1/255. Raises ValueError for a seed that has no
    room.
    """
    return _draw(seed).mesh()


def kept_room(seed: int = 0) -> Mesh:
    """The room of a seed, as `build_room` returns it: read where it was kept, else built and kept for the next time."""
    folder = private_cache_folder()
    if folder is None:
        return build_room(seed)
    path = folder / f"room{seed}-{_digest()}.npz"
    if (kept := _read(path)) is not None:
        return kept.mesh()
    with alone_in(folder):  # of several workers one builds
        return (_read(path) or _keep(_draw(seed), path, seed)).mesh()


def _read(path: Path) -> _Drawn | None:
    """Return a room that was kept; None where there is none, or not all of it."""
    try:
        with np.load(io.BytesIO(read_bytes(path, largest_bytes=None))) as parts:
            return _Drawn(**parts)
    except (OSError, EOFError, ValueError, TypeError, zipfile.BadZipFile):
        return None


def _keep(drawn: _Drawn, path: Path, seed: int) -> _Drawn:
    """Write a room to a file, in the place of what older code built; a full disk is no reason to fail."""
    with contextlib.suppress(OSError, StorageError):
        for outdated in path.parent.glob(f"*room{seed}-*"):
            outdated.unlink(missing_ok=True)
        file = io.BytesIO()
        np.savez(file, **vars(drawn))
        write_atomic(path, file.getvalue(), path.parent)
    return drawn


def _draw(seed: int) -> _Drawn:
    if not 0 <= seed < len(_ROOMS):
        raise ValueError(f"there are rooms 0 to {len(_ROOMS) - 1}, not {seed}")
    from .light import lit

    furnished: Callable[[], tuple[Piece, Lighting]] = getattr(
        importlib.import_module(f".{_ROOMS[seed]}", __name__), _ROOMS[seed]
    )
    piece, lighting = furnished()
    vertices_m = np.concatenate([sheet.points_m.reshape(-1, 3) for sheet in piece.sheets], dtype=np.float64)
    return _Drawn(
        np.rint(vertices_m * 1e6).astype(np.int32),
        np.rint(lit(piece, lighting) * 255).astype(np.uint8),
        np.array([sheet.points_m.shape[:2] for sheet in piece.sheets], dtype=np.int32),
        *_things(piece),
    )


def _things(piece: "Piece") -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return which thing each sheet is a part of, from 1 on and 0 for none, and the class of each thing."""
    from .surfaces import CLASSES, Thing

    numbers: dict[Thing, int] = {}
    objects = [0 if s.thing is None else numbers.setdefault(s.thing, len(numbers) + 1) for s in piece.sheets]
    classes = [CLASSES.index(found.category) + 1 for found in numbers]
    return np.array(objects, dtype=np.int32), np.array(classes, dtype=np.int32)


def _digest() -> str:
    """Return what stands for all that rooms are made of."""
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(polygon_mesh.__file__)]
    made_of = hashlib.sha256(np.__version__.encode())
    for file in files:
        made_of.update(read_bytes(file))
    return made_of.hexdigest()[:16]
