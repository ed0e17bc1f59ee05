# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh that Blender imported: its objects as arrays, joined to one mesh with base colours."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_array, read_text
from ..core.srgb import exact_colours, exact_light
from .ply import DAMAGED
from .polygon_mesh import NEUTRAL_GREY, Mesh, SceneObject, Texture, Up

Wrap: TypeAlias = Literal["repeat", "clamp", "mirror", "black"]
"""What a picture shows beyond its edge: itself again, its last texel, itself mirrored, or nothing."""

FACES_EXCLUDED = "faces are left out: they have vertices that are not there, fewer than three, or those of another face"
_SCENE = "imported.json"


@dataclass(frozen=True)
class ImportedImage:
    """An image, whose file lies beside the arrays. name: for messages. linear: whether its values are linear light."""

    name: str
    file: str
    linear: bool = False


@dataclass(frozen=True)
class ImportedPicture:
    """How a surface shows an image.

    image: its number. uv_map: the name of the coordinates; empty is the mesh's own choice. uv_rows: how they are
    transformed, the two rows (3,) of a matrix. wraps: to the right and up. nearest: whether the file asks for texels
    as squares.
    """

    image: int
    uv_map: str = ""
    uv_rows: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")
    nearest: bool = False


@dataclass(frozen=True)
class ImportedSurface:
    """The base colour of a material: a factor, in linear light, times a picture, times colours of vertices.

    colours: the name of the colour attribute, empty for the mesh's own choice, None where the material uses none.
    see_through: whether it is transparent. unread: what of it is not understood; empty where all is.
    """

    name: str
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    picture: ImportedPicture | None = None
    colours: str | None = None
    see_through: bool = False
    unread: str = ""


@dataclass(frozen=True)
class ImportedPart:
    """A mesh, and where it stands.

    vertices_m: (V, 3) float32. corner_vertices: (C,) int32. face_starts: (F,) int32. face_surfaces: (F,) int32, -1
    where a face has no material. placements: (K, 4, 4) float64, one for each copy. uv: (C, 2) float32 by name; the
    first is the mesh's own choice. colours: (C, 3) float32 of corners, in linear light, likewise.
    """

    vertices_m: NDArray[np.float32]
    corner_vertices: NDArray[np.int32]
    face_starts: NDArray[np.int32]
    face_surfaces: NDArray[np.int32]
    placements: NDArray[np.float64]
    uv: dict[str, NDArray[np.float32]] = field(default_factory=dict[str, NDArray[np.float32]])
    colours: dict[str, NDArray[np.float32]] = field(default_factory=dict[str, NDArray[np.float32]])


@dataclass(frozen=True)
class ImportedScene:
    """All that was imported.

    up: the axis of the file that was taken for up, None where the importer does not tell. beside: the files that were
    read beside it and that only the importer knows. notes: what a user should know. objects: of a scene that is
    rendered lit.
    """

    parts: tuple[ImportedPart, ...]
    surfaces: tuple[ImportedSurface, ...]
    images: tuple[ImportedImage, ...]
    up: Up | None = "z"
    beside: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    objects: tuple[SceneObject, ...] = ()


def write_imported(folder: Path, scene: ImportedScene) -> None:
    """Write a scene into a folder, in which the files of its images lie already."""
    for number, part in enumerate(scene.parts):
        layers = {f"uv {name}": values for name, values in part.uv.items()}
        layers |= {f"colours {name}": values for name, values in part.colours.items()}
        arrays = {"vertices_m": part.vertices_m, "corner_vertices": part.corner_vertices}
        arrays |= {"face_starts": part.face_starts, "face_surfaces": part.face_surfaces}
        arrays |= {"placements": part.placements} | {
            f"layer{place}": each for place, each in enumerate(layers.values())
        }
        for name, values in arrays.items():
            np.save(folder / f"part{number}_{name}.npy", values)
        (folder / f"part{number}.json").write_text(json.dumps(list(layers)), encoding="utf-8")
    listed = {
        "parts": len(scene.parts),
        "surfaces": [asdict(item) for item in scene.surfaces],
        "images": [asdict(item) for item in scene.images],
        "up": scene.up,
        "objects": [asdict(item) for item in scene.objects],
        "beside": list(scene.beside),
        "notes": list(scene.notes),
    }
    (folder / _SCENE).write_text(json.dumps(listed), encoding="utf-8")


def read_imported(folder: Path) -> ImportedScene | None:
    """Read a scene from a folder; None where the process that imports did not come to an end."""
    file = folder / _SCENE
    if not file.is_file():
        return None
    listed = json.loads(read_text(file))
    return ImportedScene(
        tuple(_read_part(folder, number) for number in range(listed["parts"])),
        tuple(_surface(item) for item in listed["surfaces"]),
        tuple(ImportedImage(**item) for item in listed["images"]),
        listed["up"],
        tuple(listed["beside"]),
        tuple(listed["notes"]),
        tuple(SceneObject(**item) for item in listed["objects"]),
    )


def _read_part(folder: Path, number: int) -> ImportedPart:
    def array(name: str) -> NDArray[np.float32]:
        return read_array(folder / f"part{number}_{name}.npy")

    names: list[str] = json.loads(read_text(folder / f"part{number}.json"))
    layers = {name: array(f"layer{place}") for place, name in enumerate(names)}
    return ImportedPart(
        array("vertices_m"),
        array("corner_vertices").astype(np.int32, copy=False),
        array("face_starts").astype(np.int32, copy=False),
        array("face_surfaces").astype(np.int32, copy=False),
        array("placements").astype(np.float64, copy=False),
        {name.removeprefix("uv "): values for name, values in layers.items() if name.startswith("uv ")},
        {name.removeprefix("colours "): values for name, values in layers.items() if name.startswith("colours ")},
    )


def _surface(item: dict[str, object]) -> ImportedSurface:
    """Return a surface as it was before it was JSON, which has lists for tuples."""
    picture = item["picture"]
    if isinstance(picture, dict):
        rows, wraps = picture["uv_rows"], picture["wraps"]
        item["picture"] = ImportedPicture(**{**picture, "uv_rows": tuple(map(tuple, rows)), "wraps": tuple(wraps)})
    factor = item["factor"]
    assert isinstance(factor, list)
    return ImportedSurface(**{**item, "factor": tuple(factor)})


# Bakes a texture's wrapping and colour factor into its image, as our renderers only repeat images.
#
# A picture gets a margin of what lies beyond its edges, as far as the faces reach, and texture coordinates follow.


LARGEST_PX = 32768  # a side, as of the files of textures
_MODES: dict[Wrap, Literal["edge", "symmetric", "constant"]] = {
    "clamp": "edge",
    "mirror": "symmetric",
    "black": "constant",
}  # numpy's words


@dataclass(frozen=True)
class Reach:
    """How far coordinates go along a picture's side, which is 1 long."""

    low: float
    high: float


def wrapped(
    picture: NDArray[np.uint8], wraps: tuple[Wrap, Wrap], across: Reach, up: Reach
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Return a picture that shows, repeated, what another shows with other wraps, as far as coordinates reach.

    picture: (H, W, 3), the top row first. Returns the picture, and (2,) scale and (2,) offset of its coordinates.
    Raises ValueError where it becomes too large.
    """
    sizes = (picture.shape[1], picture.shape[0])
    margins = [_margin(*side) for side in zip(sizes, wraps, (across, up), strict=True)]
    grown = [size + sum(margin) for size, margin in zip(sizes, margins, strict=True)]
    if max(grown) > LARGEST_PX:
        raise ValueError(f"reaches {max(grown)} texels with what lies beyond its edges, more than {LARGEST_PX}")
    (left, right), (below, above) = margins
    if left or right:
        picture = np.pad(picture, ((0, 0), (left, right), (0, 0)), mode=_MODES[wraps[0]])
    if below or above:  # rows are stored from the top
        picture = np.pad(picture, ((above, below), (0, 0), (0, 0)), mode=_MODES[wraps[1]])
    scale = np.array(sizes) / np.array(grown)
    offset = np.array([left, below]) / np.array(grown)
    return picture, scale, offset


def _margin(size: int, wrap: Wrap, reach: Reach) -> tuple[int, int]:
    """Return how many texels are needed before and after a side's own. Between texels' centres two are looked up."""
    if wrap == "repeat":
        return 0, 0
    if wrap == "mirror":
        return (0, size) if reach.low < 0.5 / size or reach.high > 1 - 0.5 / size else (0, 0)
    before, after = 0.5 - reach.low * size, reach.high * size + 0.5 - size
    return max(0, int(np.ceil(before))), max(0, int(np.ceil(after)))


def tinted(picture: NDArray[np.uint8], factor: tuple[float, float, float], *, linear: bool) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) multiplied by a factor, which acts on light.

    linear: whether the picture's own values are linear light; the one returned is display-encoded.
    """
    if factor == (1.0, 1.0, 1.0) and not linear:
        return picture
    values = np.arange(256) / 255
    light = values if linear else exact_light(values)
    tables = [np.rint(255 * exact_colours(np.clip(light * each, 0, 1))).astype(np.uint8) for each in factor]
    return np.stack([table[picture[..., channel]] for channel, table in enumerate(tables)], axis=-1)


# Joins the parts of an imported file, and all their copies, to one mesh with base colours.


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
            light[there] = surface.factor if number >= 0 else float(exact_light(np.float64(NEUTRAL_GREY)))
    return exact_colours(np.clip(light, 0, 1)).astype(np.float32)


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
