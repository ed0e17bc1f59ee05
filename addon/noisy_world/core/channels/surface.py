# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels that tell of the surface which a pixel's centre sees: whatever renders it says the same of it."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..scenes.mesh import Mesh
from ..scenes.scene_object import SceneObject
from .channel import Channel, FileKind

Fact: TypeAlias = Literal["normals", "faces", "objects"]
"""What a renderer can tell of a surface: its direction, which face of the mesh it is, or the number of its object."""


@dataclass(frozen=True)
class Surface:
    """What the centres of a frame's pixels see of a mesh or a scene, through the colour camera.

    normals: (H, W, 3) float32, of unit length, on the side that is seen, in OpenCV camera axes, zero where nothing is
    seen: of a mesh those of the face itself, of a scene in Blender as its materials shade it. faces: (H, W) int32,
    which face of the mesh; -1 where nothing is seen. objects: (H, W) uint16, the number of the object; 0 where nothing
    is seen, or of no known one. Each is None where no channel asked for it.
    """

    normals: NDArray[np.float32] | None = None
    faces: NDArray[np.int32] | None = None
    objects: NDArray[np.uint16] | None = None


class SurfaceChannel(Channel):
    """A channel that is computed from what a frame sees of a mesh or a scene, by any engine that can tell it.

    needs: what it is computed from. has_content: whether its values have meanings of each scene's own. It is written as
    PNG of 16 bits unless a preset asks for another kind, and never perturbed.
    """

    needs: ClassVar[frozenset[Fact]]
    has_content: ClassVar[bool] = False
    kinds: ClassVar[tuple[FileKind, ...]] = ("png", "exr", "npy")

    def problem(self, mesh: str) -> str:
        """Return why a mesh cannot give it, or ""; nothing but its file's head is read. mesh: as a scene names it."""
        del mesh
        return ""

    def files(self, mesh: str) -> tuple[Path, ...]:
        """Return the files beside a mesh's that decide what `content` says."""
        del mesh
        return ()

    def content(self, mesh: Mesh, path: str) -> dict[str, Any]:
        """Return what its values mean in this scene, for a file NAME.json of each sequence, if it has such.

        path: of the mesh, as a scene names it. Raises InputError where a file beside it is damaged.
        """
        del mesh, path
        return {}

    def content_of(self, objects: Sequence[SceneObject]) -> dict[str, Any]:
        """Return the same for a scene in Blender with some objects."""
        del objects
        return {}

    @abstractmethod
    def of_mesh(self, mesh: Mesh | None) -> Callable[[Surface], NDArray[Any]]:
        """Return what makes its image, of `dtype` and `components`, of what a frame sees of a mesh.

        mesh: None for a scene in Blender, which has normals and objects, and no faces.

        What it keeps of the mesh stays in memory while that is rendered. Raises ValueError, saying why, where the mesh
        cannot give it.
        """
