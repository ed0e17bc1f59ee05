# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins the parts of an imported file, and all their copies, to one mesh with base colours."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .imported import ImportedPart, ImportedPicture, ImportedScene, ImportedSurface
from .mesh import NEUTRAL_GREY, Mesh, Texture
from .ply_file import DAMAGED
from .srgb import decoded, encoded
from .wrapped_pictures import Reach, tinted, wrapped

COARSE_M = 1e-4  # float32 coordinates whose resolution is coarser than this are worth a note; chosen, as for PLY
_NO_SURFACE = ImportedSurface("")


def joined(path: Path, scene: ImportedScene, read_picture: Callable[[int], NDArray[np.uint8]]) -> Mesh:
    """Return the mesh of what was imported from a file. read_picture: gives an image (H, W, 3) by its number.

    A face shows its material's picture, else the colours of the mesh's corners, else its material's colour. Raises
    InputError where there is no face, a value is not finite, or a picture is missing or damaged.
    """
    copies = [(part, placement) for part in scene.parts for placement in part.placements if len(part.face_starts)]
    if not copies:
        raise InputError(path, "holds no faces", remedy="export its objects as polygon meshes")
    notes = list(scene.notes)
    surfaces = _used_surfaces(scene, notes)
    coloured = [_corner_light(part, surfaces) for part in scene.parts]
    vertices_m = np.concatenate([_placed(part, placement) for part, placement in copies])
    _check_finite(path, vertices_m, "coordinate")
    _note_coarse(vertices_m, notes)
    vertex_starts = _starts([len(part.vertices_m) for part, _ in copies])
    corner_starts = _starts([len(part.corner_vertices) for part, _ in copies])
    turned = [_turned_corners(part, placement) for part, placement in copies]
    corner_vertices = np.concatenate(
        [
            part.corner_vertices[order] + start
            for (part, _), order, start in zip(copies, turned, vertex_starts, strict=True)
        ]
    ).astype(np.int32)
    face_starts = np.concatenate(
        [part.face_starts + start for (part, _), start in zip(copies, corner_starts, strict=True)]
    ).astype(np.int32)
    numbers = {id(part): number for number, part in enumerate(scene.parts)}

    def of_corners(values: list[NDArray[np.float32]]) -> NDArray[np.float32]:
        return np.concatenate(
            [values[numbers[id(part)]][order] for (part, _), order in zip(copies, turned, strict=True)]
        )

    mesh = Mesh(vertices_m, None, corner_vertices, face_starts)
    looks = _Looks(path, scene, surfaces, read_picture)
    if bare := _without_coordinates(scene):
        notes.append(f"{listed(bare)}: without texture coordinates on some faces, where no texture is shown")
    placed = [looks.coordinates(part) for part in scene.parts]
    face_pictures = np.concatenate([placed[numbers[id(part)]][1] for part, _ in copies])
    texture = None
    if (face_pictures >= 0).any():
        texture = Texture(looks.names, looks.pictures, of_corners([uv for uv, _ in placed]), face_pictures)
    rgb = corner_rgb = None
    if (face_pictures < 0).any():
        lines = [item for item in coloured if item is not None]
        if lines:
            grey = [
                np.full((len(part.corner_vertices), 3), NEUTRAL_GREY, np.float32) if item is None else item
                for part, item in zip(scene.parts, coloured, strict=True)
            ]
            bare = np.repeat(face_pictures < 0, mesh.face_sizes)
            rgb, corner_rgb = _on_vertices(of_corners(grey), mesh, bare)
        elif texture is None:
            notes.append("no colours: shown in neutral grey")
    return Mesh(vertices_m, rgb, corner_vertices, face_starts, tuple(notes), corner_rgb, texture)


def _starts(sizes: list[int]) -> list[int]:
    return [0, *np.cumsum(sizes[:-1]).tolist()]


def _placed(part: ImportedPart, placement: NDArray[np.float64]) -> NDArray[np.float64]:
    return part.vertices_m.astype(np.float64) @ placement[:3, :3].T + placement[:3, 3]


def _turned_corners(part: ImportedPart, placement: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the order of a part's corners in a copy: each face's are reversed where the copy is mirrored."""
    count = len(part.corner_vertices)
    if np.linalg.det(placement[:3, :3]) >= 0:
        return np.arange(count)
    sizes = np.diff(part.face_starts, append=count)
    return np.repeat(2 * part.face_starts.astype(np.intp) + sizes - 1, sizes) - np.arange(count)


def _check_finite(path: Path, values: NDArray[np.float64] | NDArray[np.float32], what: str) -> None:
    if not np.isfinite(values).all():
        raise InputError(path, f"a {what} is NaN or infinite", remedy=DAMAGED)


def _note_coarse(vertices_m: NDArray[np.float64], notes: list[str]) -> None:
    farthest_m = np.float32(np.abs(vertices_m).max())
    apart_m = np.spacing(farthest_m)
    if apart_m > COARSE_M:
        near = f"coordinates near {farthest_m:.0f} m were imported as float32, {1000 * apart_m:.2f} mm apart"
        notes.append(f"{near}: finer shape is lost; a PLY file with doubles keeps it")


# --- colours ---


def _used_surfaces(scene: ImportedScene, notes: list[str]) -> tuple[ImportedSurface, ...]:
    """Return the surfaces, and tell of those that faces have what is not shown."""
    used = np.unique(np.concatenate([part.face_surfaces for part in scene.parts])).tolist()
    seen = [scene.surfaces[number] for number in used if number >= 0]
    if any(item.see_through for item in seen):
        names = listed([item.name for item in seen if item.see_through])
        notes.append(f"{names}: transparent, and shown without transparency")
    if any(item.unread for item in seen):
        what = listed(sorted({item.unread for item in seen if item.unread}))
        names = listed([item.name for item in seen if item.unread])
        notes.append(f"{names}: the base colour is mixed by {what}, which is left out")
    if any(item.picture is not None and item.colours is not None for item in seen):
        names = listed([item.name for item in seen if item.picture is not None and item.colours is not None])
        notes.append(f"{names}: the texture is shown, and not multiplied by the colours of vertices")
    if any(item.picture is not None and item.picture.nearest for item in seen):
        names = listed([item.name for item in seen if item.picture is not None and item.picture.nearest])
        notes.append(f"{names}: texels are meant as squares, and shown with colours between them")
    return scene.surfaces


def listed(names: list[str]) -> str:
    """Return the first of some names, and how many more there are, for a note."""
    shown = ", ".join(repr(name[:60]) for name in names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"


def _corner_light(part: ImportedPart, surfaces: tuple[ImportedSurface, ...]) -> NDArray[np.float32] | None:
    """Return the colours (C, 3) of a part's corners, display-encoded; None where nothing says any."""
    sizes = np.diff(part.face_starts, append=len(part.corner_vertices))
    own = next(iter(part.colours.values()), None)
    if own is not None and len(own) and np.ptp(own, axis=0).max() == 0:
        own = None  # colours that are the same everywhere say nothing
    if own is None and not (part.face_surfaces >= 0).any():
        return None
    light = np.empty((len(part.corner_vertices), 3), np.float32)
    for number in np.unique(part.face_surfaces).tolist():
        surface = surfaces[number] if number >= 0 else _NO_SURFACE
        there = np.repeat(part.face_surfaces == number, sizes)
        meant = _attribute(part, surface.colours)
        if meant is not None:
            light[there] = meant[there] * np.array(surface.factor, np.float32)
        elif own is not None:
            light[there] = own[there]
        else:
            light[there] = surface.factor if number >= 0 else float(decoded(np.float64(NEUTRAL_GREY)))
    return encoded(np.clip(light, 0, 1)).astype(np.float32)


def _attribute(part: ImportedPart, name: str | None) -> NDArray[np.float32] | None:
    if name is None:
        return None
    return next(iter(part.colours.values()), None) if not name else part.colours.get(name)


def _on_vertices(
    corner_rgb: NDArray[np.float32], mesh: Mesh, bare: NDArray[np.bool_]
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return colours as those of vertices where all corners at a vertex agree, else as those of corners.

    bare: (C,) the corners of faces without a picture, whose colours alone are seen.
    """
    rgb = np.full((len(mesh.vertices_m), 3), NEUTRAL_GREY, np.float32)
    rgb[mesh.corner_vertices[bare]] = corner_rgb[bare]
    agree = np.array_equal(rgb[mesh.corner_vertices[bare]], corner_rgb[bare])
    return (rgb, None) if agree else (None, corner_rgb)


# --- pictures ---


@dataclass(frozen=True)
class _ShownPicture:
    """A picture as a surface shows it: the same image under another factor, or wrapped otherwise, is another one."""

    picture: ImportedPicture
    factor: tuple[float, float, float]


class _Looks:
    """The pictures of all surfaces, and where the corners of faces lie in them."""

    def __init__(
        self,
        path: Path,
        scene: ImportedScene,
        surfaces: tuple[ImportedSurface, ...],
        read_picture: Callable[[int], NDArray[np.uint8]],
    ) -> None:
        """Read and make the pictures that any face shows."""
        self._surfaces = surfaces
        self._reaches: dict[_ShownPicture, list[NDArray[np.float64]]] = {}
        for part in scene.parts:
            for shown_picture, there in self._shown(part):
                uv = _transformed(part, shown_picture.picture)[there]
                _check_finite(path, uv, "texture coordinate")
                self._reaches.setdefault(shown_picture, []).append(np.stack([uv.min(axis=0), uv.max(axis=0)]))
        self._numbers: dict[_ShownPicture, int] = {}
        self._places: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        pictures: list[NDArray[np.uint8]] = []
        names: list[str] = []
        for shown_picture, reached in self._reaches.items():
            low, high = np.min(reached, axis=(0, 1)), np.max(reached, axis=(0, 1))
            image = scene.images[shown_picture.picture.image]
            shown = tinted(read_picture(shown_picture.picture.image), shown_picture.factor, linear=image.linear)
            across, up = Reach(low[0], high[0]), Reach(low[1], high[1])
            try:
                shown, scale, offset = wrapped(shown, shown_picture.picture.wraps, across, up)
            except ValueError as error:
                remedy = "let the texture repeat, or its coordinates stay nearer to it"
                raise InputError(path, f"its texture {image.name[:200]!r} {error}", remedy=remedy) from error
            self._numbers[shown_picture] = len(pictures)
            self._places.append((scale, offset))
            pictures.append(shown)
            names.append(image.name)
        self.pictures, self.names = tuple(pictures), tuple(names)

    def _shown(self, part: ImportedPart) -> list[tuple[_ShownPicture, NDArray[np.bool_]]]:
        """Return the pictures of a part, each with the corners (C,) of the faces that show it."""
        sizes = np.diff(part.face_starts, append=len(part.corner_vertices))
        found = []
        for number in np.unique(part.face_surfaces).tolist():
            surface = self._surfaces[number] if number >= 0 else _NO_SURFACE
            if surface.picture is not None and _coordinates(part, surface.picture) is not None:
                there = np.repeat(part.face_surfaces == number, sizes)
                found.append((_ShownPicture(surface.picture, surface.factor), there))
        return found

    def coordinates(self, part: ImportedPart) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return where a part's corners (C, 2) lie, and the picture (F,) of each face, -1 where it has none."""
        corner_uv = np.zeros((len(part.corner_vertices), 2), np.float32)
        corner_pictures = np.full(len(part.corner_vertices), -1, np.int32)
        for shown_picture, there in self._shown(part):
            uv = _transformed(part, shown_picture.picture)[there]
            number = self._numbers[shown_picture]
            scale, offset = self._places[number]
            corner_uv[there] = uv * scale + offset
            corner_pictures[there] = number
        return corner_uv, corner_pictures[part.face_starts]


def _without_coordinates(scene: ImportedScene) -> list[str]:
    """Return the names of materials with a picture that some part has no coordinates for."""
    found: dict[str, None] = {}
    for part in scene.parts:
        for number in np.unique(part.face_surfaces[part.face_surfaces >= 0]).tolist():
            picture = scene.surfaces[number].picture
            if picture is not None and _coordinates(part, picture) is None:
                found[scene.surfaces[number].name] = None
    return list(found)


def _coordinates(part: ImportedPart, picture: ImportedPicture) -> NDArray[np.float32] | None:
    return part.uv.get(picture.uv_map) if picture.uv_map else next(iter(part.uv.values()), None)


def _transformed(part: ImportedPart, picture: ImportedPicture) -> NDArray[np.float64]:
    """Return a part's texture coordinates (C, 2) as a picture takes them."""
    uv = _coordinates(part, picture)
    assert uv is not None
    rows = np.array(picture.uv_rows)
    return uv.astype(np.float64) @ rows[:, :2].T + rows[:, 2]
