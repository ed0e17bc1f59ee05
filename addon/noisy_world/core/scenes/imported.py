# SPDX-License-Identifier: GPL-3.0-or-later
"""An imported mesh as arrays: written by the process in which Blender imported it, read by ours."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..regular_files import read_array, read_text
from .scene_object import SceneObject
from .turning import Up

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
