# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of a mesh file rendered lit: with the file's own lights and materials, along the path of the mesh."""

import contextlib
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Many
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..core.geometry import Intrinsics
from ..core.planning.source import OwnRendering, RenderOptions, SourceCapabilities
from ..core.presets.preset import Preset
from ..core.scenes.mesh_files import imported_format
from ..core.scenes.scene_object import SceneObject
from ..core.scratch import ScratchFolder
from ..core.trajectories.sensor_paths import SensorPaths
from .bending import check_light_lens
from .blend_source import PERTURBED_LIGHT, SEEN, PreparedBlend, lines_of  # noqa: TID253 - it is one itself
from .imported_meshes import write_lit_file  # noqa: TID253 - with light, it is imported
from .mesh_source import MeshSource

if TYPE_CHECKING:
    from ..blender.own_scene import OwnSceneSession

T = TypeVar("T")

LIT_SAMPLES = 64  # chosen: of a pixel, where the preset says none
DEPTH_ALPHA = 0.5  # what is less opaque does not stop depth, as by default of a .blend
SCENE = "Scene"  # as Blender's empty file names its scene
_ROOM_FOR_EACH_BYTE = 4  # chosen: a .blend takes more than the mesh's file


@dataclass(frozen=True, kw_only=True)
class LitMeshSource(MeshSource):
    """A mesh with a path, rendered with the lights and materials of its file."""

    rendering: OwnRendering

    @property
    def capabilities(self) -> SourceCapabilities:
        """Rendered frames from any pose, by settings of its own."""
        at_once = lines_of(self.rendering.engine)
        return replace(
            super().capabilities,
            own=self.rendering,
            casts_rays=not at_once,
            at_once=at_once,
            surface=SEEN,
            objects=lambda: self._objects,
            lit=True,
            depth_cameras=False,
        )

    @cached_property
    def _objects(self) -> tuple[SceneObject, ...]:
        """Its objects, which an importer has to tell."""
        assert self.mesh_path is not None
        scratch = _room_for(self.mesh_path)
        try:
            return write_lit_file(self.mesh_path, scratch.path / "lit.blend", self.up)[1]
        finally:
            scratch.remove()

    def hashes(self) -> dict[str, Any]:
        """Return those of the mesh and its path, and how it is rendered."""
        own = self.rendering
        how = {"engine": own.engine, "samples": own.samples, "near_m": own.near_m, "far_m": own.far_m}
        return {**super().hashes(), "light": "scene", **how, **PERTURBED_LIGHT}

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator[PreparedBlend]:
        """Prepare to render frames; the file is imported when the first path is opened."""

        lens = self.lens(camera)

        def opened(paths: SensorPaths, options: RenderOptions, closing: contextlib.ExitStack) -> "OwnSceneSession":
            from ..blender.own_scene import OwnSceneFile, OwnSceneSession

            assert self.mesh_path is not None
            scratch = _room_for(self.mesh_path)
            closing.callback(scratch.remove)
            lit = scratch.path / "lit.blend"
            notes, _ = write_lit_file(self.mesh_path, lit, self.up)
            for text in (*notes, *self.trajectory().notes):
                note(text)
            file = file_of(lit, self.stamps_s.tolist(), OwnSceneFile)
            return OwnSceneSession(file, paths, camera, options, lens=lens)

        with contextlib.ExitStack() as closing:
            yield PreparedBlend(opened, self.beginning, closing)


def _room_for(mesh: Path) -> ScratchFolder:
    return ScratchFolder(_ROOM_FOR_EACH_BYTE * mesh.stat().st_size)


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
        follows=False,
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
    render_spec, given = preset.spec.render, preset.document.get("render") or {}
    engine = render_spec.engine if "engine" in given else "cycles"
    if engine == "embree":
        problem = "is embree, which knows no lights"
        raise preset.place("render.engine").error(problem, "leave light: scene out, or use cycles")
    camera = preset.spec.mesh_camera
    check_light_lens(preset)
    samples = render_spec.samples if "samples" in given else LIT_SAMPLES
    rendering = OwnRendering(engine, samples, camera.near_m, camera.far_m)
    return LitMeshSource(**{item.name: getattr(plain, item.name) for item in fields(plain)}, rendering=rendering)
