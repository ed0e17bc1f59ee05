# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of a mesh file rendered lit: with the file's own lights and materials, along the path of the mesh."""

import contextlib
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Many
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.optics import Optics
from ..core.planning.source import Gives, OwnRendering, RenderOptions
from ..core.presets.preset import Preset
from ..core.scenes.mesh import Mesh
from ..core.scenes.mesh_files import imported_format
from ..core.scratch import ScratchFolder
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.stamps import FrameStamps
from ..core.trajectories.trajectory import Axes, Trajectory
from .blend import OpenBlend
from .imported_meshes import write_lit_file
from .mesh import MeshSource

if TYPE_CHECKING:
    from ..blender.own_scene import OwnSceneSession

T = TypeVar("T")

LIT_SAMPLES = 64  # chosen: of a pixel, where the preset says none
DEPTH_ALPHA = 0.5  # what is less opaque does not stop depth, as by default of a .blend
SCENE = "Scene"  # as Blender's empty file names its scene
_ROOM_FOR_EACH_BYTE = 4  # chosen: a .blend takes more than the mesh's file


@dataclass(frozen=True)
class LitMeshSource:
    """A mesh with a path, rendered with the lights and materials of its file. plain: the same mesh, unlit."""

    plain: MeshSource
    rendering: OwnRendering

    @property
    def location(self) -> str:
        """The mesh."""
        return self.plain.location

    @property
    def gives(self) -> Gives:
        """Rendered frames from any pose, by settings of its own."""
        return replace(self.plain.gives, own=self.rendering, surface=False)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path in seconds."""
        return self.plain.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the path."""
        return self.plain.frame_stamps

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses."""
        return self.plain.robot_axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics asked for: a mesh can be rendered through any camera."""
        return asked

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        return self.plain.optics(camera)

    def trajectory(self) -> Trajectory:
        """Return the path that was read, or generate one through the mesh."""
        return self.plain.trajectory()

    @property
    def mesh(self) -> Callable[[], Mesh]:
        """Returns the mesh: it is read."""
        return self.plain.mesh

    def hashes(self) -> dict[str, Any]:
        """Return those of the mesh and its path, and how it is rendered."""
        own = self.rendering
        how = {"engine": own.engine, "samples": own.samples, "near_m": own.near_m, "far_m": own.far_m}
        return {**self.plain.hashes(), "light": "scene", **how}

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["PreparedLitMesh"]:
        """Prepare to render frames; the file is imported when the first path is opened."""
        with contextlib.ExitStack() as closing:
            yield PreparedLitMesh(self, camera, note, closing)


class PreparedLitMesh:
    """A mesh with its lights that Blender opens once, for all paths through it that the same session can serve."""

    def __init__(
        self, source: LitMeshSource, camera: Intrinsics, note: Callable[[str], None], closing: contextlib.ExitStack
    ) -> None:
        """Keep what is needed to open it. closing: closes the session in the end."""
        self._source = source
        self._camera = camera
        self._note = note
        self._closing = closing
        self._session: OwnSceneSession | None = None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> OpenBlend:
        """Return the mesh ready to be rendered along the paths. Raises InputError where its file holds no lights."""
        del note  # all is said already
        from ..blender.own_scene import OwnSceneFile, OwnSceneSession

        plain = self._source.plain
        if self._session is None or not self._session.serves(paths, options):
            self._closing.close()
            assert plain.mesh_path is not None
            scratch = ScratchFolder(_ROOM_FOR_EACH_BYTE * plain.mesh_path.stat().st_size)
            self._closing.callback(scratch.remove)
            lit = scratch.path / "lit.blend"
            for text in (*write_lit_file(plain.mesh_path, lit, plain.up), *plain.trajectory().notes):
                self._note(text)
            session = OwnSceneSession(file_of(lit, plain.stamps_s.tolist(), OwnSceneFile), paths, self._camera, options)
            self._session = self._closing.enter_context(session)
        return OpenBlend(self._session, plain.beginning(paths, options.first_frames))


def file_of(lit: Path, stamps_s: Many[float], kind: Callable[..., T]) -> T:
    """Return what of the file is rendered: one frame of its scene, through plain cameras, at the path's stamps."""
    count = len(stamps_s)
    return kind(
        path=lit,
        scene=SCENE,
        frames=(1.0,) * count,
        stamps_s=tuple(stamps_s),
        fps=0.0,
        cameras=(None,) * count,
        riding=False,
        lens_given=True,
        sampled=True,
        keep_compositor=False,
        depth_alpha=DEPTH_ALPHA,
    )


def lit_mesh(preset: Preset, plain: MeshSource) -> LitMeshSource:
    """Return the source of a mesh that is rendered lit. Raises InputError where it cannot be."""
    assert plain.mesh_path is not None
    found = imported_format(plain.mesh_path)
    if found is None or found.name == "STL":
        name = "a PLY file" if found is None else "an STL file"
        raise plain.place.at("light").error(f"is scene, but {name} holds no lights", "leave it out")
    told, given = preset.spec.render, preset.document.get("render") or {}
    engine = told.engine if "engine" in given else "cycles"
    if engine == "embree":
        problem = "is embree, which knows no lights"
        raise preset.place("render.engine").error(problem, "leave light: scene out, or use cycles")
    camera = preset.spec.mesh_camera
    samples = told.samples if "samples" in given else LIT_SAMPLES
    return LitMeshSource(plain, OwnRendering(engine, samples, camera.near_m, camera.far_m))
