# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh in Blender, ready to be rendered from any pose; the generator renders from it."""

from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.channels.surface import Surface
from ..core.channels.surface_images import SurfaceImages
from ..core.geometry import Intrinsics
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.scenes.mesh import Mesh
from ..core.scenes.recentring import recentring_m
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from .camera import add_camera, place_camera, set_intrinsics
from .engines import ENGINES, Device, EngineName, configure, enable_gpu, show_textures
from .probe import gl_version
from .render import FrameRenderer
from .scene import Decoding, add_mesh, empty_scene, set_origin, tell_faces


def blender_version() -> dict[str, str]:
    """Return Blender's version, as `renderer_versions` does."""
    return {"blender": f"{bpy.app.version_string} {bpy.app.build_hash.decode(errors='replace')}"}


def renderer_versions(engine: EngineName, device: Device = "cpu") -> dict[str, str]:
    """Return the versions that decide rendered bytes: of Blender and, where they are used, GL or the graphics cards.

    Raises MissingDependencyError where the engine cannot run here.
    """
    versions = blender_version()
    if engine != "cycles":
        return {**versions, "gl": gl_version()}
    return {**versions, "gpu": enable_gpu()} if device == "gpu" else versions


@dataclass(frozen=True)
class Shot:
    """One render of a frame: from which sensor's pose, with how many samples, and for which images.

    through: depth of what colour shows, beside that of a depth sensor with a camera of its own.
    """

    from_depth_sensor: bool
    samples: int
    rgb: bool
    depth: bool
    surface: bool = False
    through: bool = False


class Session:
    """One mesh in Blender, from its first frame to its last. It replaces Blender's file, so use one at a time."""

    notes: tuple[str, ...] = ()

    def __init__(
        self, mesh: Mesh, name: str, paths: SensorPaths, intrinsics: Intrinsics, options: RenderOptions
    ) -> None:
        """Build the scene. paths: of the sensors; the scene is recentred so that what is near them is precise."""
        self._scene = scene = empty_scene()
        self._served = _served(paths, options)
        assert options.engine != "embree", "which is not Blender's"
        self._engine = ENGINES[options.engine]
        self._options = options
        self.origin_m = recentring_m(paths.rgb)
        set_origin(scene, self.origin_m)
        # A single sample is not averaged, so its colour need not be converted to light and back.
        linear_light = options.samples > 1
        decoding: Decoding = "none" if not linear_light else "shader" if self._engine.shades else "attribute"
        self._images = SurfaceImages(options.channels, mesh)
        shown = add_mesh(scene, mesh, name, decoding=decoding, by_texels=self._engine.blurs_textures)
        configure(
            scene,
            self._engine,
            seed=options.seed,
            samples=options.samples,
            threads=options.threads,
            device=options.device,
        )
        if mesh.texture is not None:
            show_textures(scene)
        if "faces" in self._images.needs:
            tell_faces(shown)
        self._shots = self._plan_shots(two_places=paths.depth is not None)
        # Both sensors use one camera in turn: changing the scene's camera takes as long as a frame, moving it nothing.
        self._camera = add_camera(scene, "Noisy World camera")
        self._intrinsics = self._seen_through = intrinsics
        self._look_through(intrinsics)
        self._renderer = FrameRenderer(
            scene,
            (intrinsics.width_px, intrinsics.height_px),
            rgb=options.rgb,
            depth=options.depth or not options.rgb,
            encoded_colours=not linear_light,
            facts=self._images.needs,
        )

    def _look_through(self, intrinsics: Intrinsics) -> None:
        options, self._seen_through = self._options, intrinsics
        set_intrinsics(
            self._scene,
            self._camera,
            intrinsics,
            near_m=options.near_m,
            far_m=options.far_m,
            sample_offset_px=self._engine.sample_offset_px(options.samples),
        )

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        return self._served == _served(paths, options)

    def _plan_shots(self, *, two_places: bool) -> list["Shot"]:
        """Plan one render for colour and depth if they share a pose and the engine's depth allows it, else two."""
        options = self._options
        surface = bool(self._images.needs)
        along = surface and options.samples == 1  # a single sample shows the pixel's centre, as the surface has to be
        two_places = two_places or options.depth_camera is not None
        together = not two_places and (options.samples == 1 or self._engine.centre_depth)
        shots = []
        if options.rgb:
            both = options.depth and together
            shots.append(Shot(False, options.samples, rgb=True, depth=both, surface=along))
        if options.depth and not (options.rgb and together):
            shots.append(Shot(True, 1, rgb=False, depth=True, surface=surface and not options.rgb and not two_places))
        if options.depth_camera is not None and options.through_glass:
            shots.append(Shot(False, 1, rgb=False, depth=False, through=True))
        if surface and not any(shot.surface for shot in shots):
            shots.append(Shot(False, 1, rgb=False, depth=not (options.rgb or options.depth), surface=True))
        return shots

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame."""
        rgb = depth_m = behind_m = None
        others: dict[str, NDArray[Any]] = {}
        for shot in self._shots:
            seen = (self._options.depth_camera if shot.from_depth_sensor else None) or self._intrinsics
            if seen != self._seen_through:
                self._look_through(seen)
            place_camera(self._scene, self._camera, request.depth_c2w if shot.from_depth_sensor else request.rgb_c2w)
            self._engine.set_samples(self._scene, shot.samples)
            if self._images.needs:
                self._scene.update_tag()  # or Cycles would not hear of fewer samples while its camera stays
            rendered = self._renderer.render((seen.width_px, seen.height_px))
            rgb = rendered.rgb if shot.rgb else rgb
            depth_m = rendered.depth_m if shot.depth else depth_m
            behind_m = rendered.depth_m if shot.through else behind_m
            if shot.surface and rendered.world is not None:
                others = self._images.of(_in_camera(rendered.world, request.rgb_c2w))
        return RenderedFrame(rgb, depth_m, others, behind_glass_m=behind_m)

    def close(self) -> None:
        """Remove the scratch files."""
        self._renderer.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _in_camera(surface: Surface, c2w: NDArray[np.float64]) -> Surface:
    """Return the surface with its normals, of the scene's axes, in those of the camera at a pose (4, 4)."""
    if surface.normals is None:
        return surface
    return replace(surface, normals=(surface.normals @ c2w[:3, :3]).astype(np.float32))


def _served(paths: SensorPaths, options: RenderOptions) -> tuple[object, ...]:
    """Return what a session is built for: of the paths nothing but the point around which they lie, and the sensors."""
    origin_m = tuple(recentring_m(paths.rgb).tolist())
    return origin_m, paths.depth is not None, replace(options, first_frames=())
