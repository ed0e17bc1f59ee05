# SPDX-License-Identifier: GPL-3.0-or-later
"""A session on a scene of a .blend: frames rendered as its artist set it up, from any pose."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels.surface_images import SurfaceImages
from ..core.errors import InputError
from ..core.frame_request import AT_ONCE, FrameRequest, SensorPaths, Shutter
from ..core.geometry import Intrinsics
from ..core.lens import Bending, Distortion, overscanned
from ..core.travel import travel_px
from ..nodes.datablocks import camera_of
from ..nodes.datablocks import cycles as cycles_of
from ..perturbations.groups import BRIGHTEST
from .engines import FILTER_MIDDLE, Band, RenderFile, bands_of, behind_lens, joined, whole, without_void
from .own_depth import DepthScene, may_be_seen_through, panes_of, set_frame, volumes_of
from .own_view import (
    RenderCamera,
    ShownColour,
    make_repeatable,
    numbered_objects,
    rendered_layer,
    show_frame,
    show_numbers,
)
from .scene_dependencies import blocks_of
from .scene_inspection import open_file, show_scene
from .source import Motion, RenderedFrame, RenderOptions, SceneLight, surfaces_bent

COMPOSITE = "Composite"  # the layer of what the compositor makes
LOOKS = 33  # poses at which the path is looked at while lines are read; chosen, as for a blur


@dataclass(frozen=True)
class OwnSceneFile:
    """Which scene of which .blend is rendered, and how.

    frames: the scene's frame of each of the path's, whole or not. stamps_s: when each of them is, on the path's clock.
    fps: frames a second between these; 0 where nothing moves. cameras: the object that sees each; None for a plain
    camera, and one for all where frames between these are asked for. follows: whether the path is these cameras' own,
    so that motion blur shows their motion. lens_given: whether the preset gives the intrinsics. sampled: whether it
    gives the samples. keep_compositor: whether the scene's compositor is used. depth_alpha: what is less opaque does
    not stop depth.
    """

    path: Path
    scene: str
    frames: tuple[float, ...]
    stamps_s: tuple[float, ...]
    fps: float
    cameras: tuple[str | None, ...]
    follows: bool
    lens_given: bool
    sampled: bool
    keep_compositor: bool
    depth_alpha: float

    def at(self, time_s: float) -> tuple[float, str | None]:
        """Return the scene's frame at a time on the path's clock, and the camera that sees it."""
        row = bisect_right(self.stamps_s, time_s) - 1
        if row < 0 or self.stamps_s[row] != time_s:
            return self.frames[0] + (time_s - self.stamps_s[0]) * self.fps, self.cameras[max(row, 0)]
        return self.frames[row], self.cameras[row]


class OwnSceneSession:
    """One scene of a .blend in Blender, from its first frame to its last. It replaces Blender's file."""

    def __init__(
        self,
        file: OwnSceneFile,
        paths: SensorPaths,
        intrinsics: Intrinsics,
        options: RenderOptions,
        *,
        scene: bpy.types.Scene | None = None,
        lens: Distortion | None = None,
    ) -> None:
        """Open the file and prepare the scene. scene: of the open file, which is then kept; it is changed.

        lens: that distorts what it sees: a pinhole that sees more is rendered and bent, colour as light.
        """
        self._bending = None if lens is None else Bending(overscanned(intrinsics, lens), intrinsics, lens)
        if self._bending is not None:
            intrinsics = self._bending.pinhole
        self._served = _served(paths, options)
        self._file = file
        if scene is None:
            open_file(str(file.path))
            scene = bpy.data.scenes[file.scene]
            show_scene(scene)
        if file.keep_compositor and scene.compositing_node_group is None:
            problem = f"the scene {scene.name!r} has no compositor"
            raise InputError(file.path, problem, where="compositor: keep", remedy="leave the key out, or add them")
        self.blurs, self.denoises = scene.render.use_motion_blur, cycles_of(scene).use_denoising
        make_repeatable(scene, options, sampled=file.sampled, keep_compositor=file.keep_compositor)
        blocks = blocks_of(scene)
        masked = may_be_seen_through(blocks)
        alone = paths.depth is None and not masked and not volumes_of(blocks).any and not file.keep_compositor
        together = options.rgb and options.depth and alone and _shows_centre(scene, file)
        self._images = SurfaceImages(options.channels, None, numbered_objects(blocks) if options.channels else ())
        facts = self._images.needs
        if "objects" in facts:
            show_numbers(blocks)
        self._motion: DepthScene | None = None
        self._glance: DepthScene | None = None  # at how far things are, before lines are read
        self._camera = intrinsics if self._bending is None else self._bending.camera
        self._depth_scene = partial(DepthScene, scene, intrinsics, options, alpha=file.depth_alpha, masked=masked)
        # Copied before colour's cameras and file settings are made.
        self._apart = options.depth and not together
        self._depth = None
        if self._apart or facts:
            self._depth = self._depth_scene(facts=facts)
        panes = panes_of(blocks)
        self._seen = None
        if options.through_glass and panes.any:
            self._seen = self._depth_scene(panes=panes)
        self._colour = (
            _Colour(scene, file, intrinsics, options, depth=together, bending=self._bending) if options.rgb else None
        )

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        return self._served == _served(paths, options)

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame, at once or line by line as the request says."""
        if request.rays.readout is not None:
            return self._read(request, request.rays.readout)
        rgb = depth_m = seen_m = light = None
        others: dict[str, NDArray[Any]] = {}
        depth_asked = request.looks_at("depth")
        if self._colour is not None and (request.looks_at("rgb") or (depth_asked and not self._apart)):
            rgb, depth_m, light = self._colour.render(request)
        at = self._file.at(request.time_s)[0]
        if self._depth is not None and self._images.needs:
            seen_m, surface = self._depth.render(request.rgb_c2w, at)
            others = self._images.of(surface)
        if self._depth is not None and self._apart and depth_asked:
            same = seen_m is not None and np.array_equal(request.rgb_c2w, request.depth_c2w)
            depth_m = seen_m if same else self._depth.render(request.depth_c2w, at)[0]
        behind_m = None if self._seen is None or not depth_asked else self._seen.render(request.rgb_c2w, at)[0]
        frame = RenderedFrame(rgb, depth_m, others, light=light, behind_glass_m=behind_m)
        return frame if self._bending is None else surfaces_bent(frame, self._bending)

    def _read(self, request: FrameRequest, readout: Shutter) -> RenderedFrame:
        """Render a frame whose lines are read one after another, each at its own moment."""
        bending, at_once = self._bending, replace(request, rays=AT_ONCE)
        size_px = (self._camera.width_px, self._camera.height_px)
        depth_scene, behind = self._depth if self._apart else None, self._seen
        bands = bands_of(readout, size_px, self._travel_px(at_once, readout))
        rolls = request.rays.depth_rolls
        of_depth = bands if rolls else [whole(size_px)]

        def seen_from(band: Band) -> tuple[NDArray[np.float64], float]:
            there = at_once.after(band.after_s)
            return there.depth_c2w, self._file.at(there.time_s)[0]

        rgb = depth_m = behind_m = light = None
        depth_asked = request.looks_at("depth")
        if self._colour is not None and (request.looks_at("rgb") or (depth_asked and depth_scene is None)):
            rgb, depth_m, light = self._colour.read(at_once, bands)
            if not rolls and depth_m is not None:
                depth_m = self._colour.render(at_once)[1]
                assert depth_m is not None, "it gives depth"
                depth_m = depth_m if bending is None else bending.depth_m(depth_m)
        if depth_scene is not None and depth_asked:
            depth_m = depth_scene.read(of_depth, seen_from, bending)
        if behind is not None and depth_asked:
            behind_m = behind.read(of_depth, seen_from, bending)
        return RenderedFrame(rgb, depth_m, light=light, behind_glass_m=behind_m)

    def _travel_px(self, request: FrameRequest, readout: Shutter) -> float:
        """Return how far anything goes on the image while it is read, at most."""
        times_s = np.sort(readout.line_times_s(LOOKS))
        first, *_, last = (request.after(float(time_s)) for time_s in times_s)
        if self._glance is None:
            self._glance = self._depth or self._depth_scene()
        depth_m = self._glance.render(request.rgb_c2w, self._file.at(request.time_s)[0])[0]
        lens = None
        if self._bending is not None:
            depth_m, lens = self._bending.depth_m(depth_m), self._bending.lens
        camera = self._camera
        way_px = travel_px(depth_m, request.rgb_c2w, request.poses_after(times_s)[0], camera, camera, lens=lens)
        moved = self.motion(first, last)
        return way_px if moved is None else max(way_px, float(np.nanmax(np.hypot(*np.moveaxis(moved[0], -1, 0)))))

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return how what the colour camera sees moves between two frames; None where they show the same moment."""
        first, second = (self._file.at(request.time_s)[0] for request in (here, there))
        if first == second:
            return None
        if self._motion is None:
            self._motion = self._depth_scene(moving=True)
        back = self._motion.motion(there.rgb_c2w, second, here.rgb_c2w, first)
        moved = self._motion.motion(here.rgb_c2w, first, there.rgb_c2w, second)
        return (moved, back) if self._bending is None else (self._bending.motion(moved), self._bending.motion(back))

    def close(self) -> None:
        """Remove the scratch files."""
        glance = None if self._glance is self._depth else self._glance
        for part in (self._colour, self._depth, self._motion, self._seen, glance):
            if part is not None:
                part.close()

    def __enter__(self) -> "OwnSceneSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Colour:
    """The artist's scene, which gives colour and, where its own render has the centre's, depth."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        file: OwnSceneFile,
        intrinsics: Intrinsics,
        options: RenderOptions,
        *,
        depth: bool,
        bending: Bending | None,
    ) -> None:
        """Prepare it. depth: whether it gives depth too. bending: of light, whose pinhole the intrinsics are."""
        self._bending = bending
        self._scene = scene
        self._file = file
        self._depth = depth
        self._far_m = options.far_m
        self._follows = file.follows and scene.render.use_motion_blur
        offset_px = FILTER_MIDDLE * cycles_of(scene).filter_width if depth else 0.0
        self._render_cameras = {
            name: RenderCamera(
                scene,
                None if name is None else scene.objects[name],
                intrinsics,
                options,
                lens_given=file.lens_given,
                sample_offset_px=offset_px,
                sharp=False,
                image_width_px=None if bending is None else bending.camera.width_px,
            )
            for name in dict.fromkeys(file.cameras)
        }
        layer = rendered_layer(scene)
        layer.use_pass_combined = True
        layer.use_pass_z = depth
        self._layer = COMPOSITE if file.keep_compositor else layer.name
        size_px = (intrinsics.width_px, intrinsics.height_px)
        self._render = RenderFile(scene, size_px)
        seen_by = intrinsics if bending is None else bending.camera
        self._shown = ShownColour(scene, (seen_by.width_px, seen_by.height_px), self._render.folder)

    def render(self, request: FrameRequest) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, SceneLight]:
        """Return colour (H, W, 3), display-encoded; depth (H, W) in metres or None; and colour before the display."""
        return self._made(self._passes(request))

    def read(
        self, request: FrameRequest, bands: Sequence[Band]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, SceneLight]:
        """Return the same of a frame whose lines are read one after another, all of it behind the lens."""
        bending = self._bending
        if bending is None:
            size_px = self._render.size_px
            return self._made(joined(bands, size_px, lambda band: self._passes(request.after(band.after_s), band)))

        def passes_of(band: Band) -> dict[str, NDArray[np.float32]]:
            needed, part = behind_lens(band, bending)
            assert part is not None, "there is a lens"
            return self._bent(self._passes(request.after(band.after_s), needed), part)

        return self._of(joined(bands, (bending.camera.width_px, bending.camera.height_px), passes_of))

    def _passes(self, request: FrameRequest, band: Band | None = None) -> dict[str, NDArray[np.float32]]:
        at, camera = self._file.at(request.time_s)
        render_camera = self._render_cameras[camera]
        if self._follows:
            show_frame(self._scene, at)
            render_camera.follow(request.rgb_c2w)
        else:
            # What is keyed of the scene itself, such as exposure, is not the renderer's to evaluate.
            (show_frame if self._scene.animation_data is not None else set_frame)(self._scene, at)
            render_camera.place(request.rgb_c2w)
        return self._render.render(self._layer, band=band)

    def _made(
        self, passes: dict[str, NDArray[np.float32]]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, SceneLight]:
        if self._bending is not None:
            colours = {name: passes[name] for name in passes if name.startswith("Combined.")}
            passes = passes | self._bent(colours, self._bending)
        return self._of(passes)

    def _bent(self, passes: dict[str, NDArray[np.float32]], bending: Bending) -> dict[str, NDArray[np.float32]]:
        """Return the passes of a pinhole as a lens shows them."""
        rgba = bending.rgb(np.stack([passes[f"Combined.{name}"] for name in "RGBA"], axis=-1))
        found = {f"Combined.{name}": rgba[..., place] for place, name in enumerate("RGBA")}
        if self._depth and "Depth.Z" in passes:
            found["Depth.Z"] = bending.depth_m(without_void(passes["Depth.Z"], self._far_m))
        return found

    def _of(
        self, passes: dict[str, NDArray[np.float32]]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, SceneLight]:
        rgba = np.stack([passes[f"Combined.{name}"] for name in "RGBA"], axis=-1)
        depth_m = without_void(passes["Depth.Z"], self._far_m) if self._depth else None
        return self._shown.encode(rgba), depth_m, SceneLight(light_in(rgba), rgba[..., 3:], self._shown.encode)

    def close(self) -> None:
        """Remove the scratch files."""
        self._render.close()


def _shows_centre(scene: bpy.types.Scene, file: OwnSceneFile) -> bool:
    """Tell whether Z of the artist's own render is that of the pixel's centre, and the offset of its filter is known.

    Cycles takes it from a pixel's first sample, unless lens or shutter move that, or it renders other samples only.
    """
    cycles = cycles_of(scene)
    cameras = [camera_of(scene.objects[name]) for name in set(file.cameras) if name is not None]
    return (
        scene.render.engine == "CYCLES"
        and cycles.pixel_filter_type == "BLACKMAN_HARRIS"
        and not cycles.use_sample_subset
        and not scene.render.use_motion_blur
        and not any(camera.dof is not None and camera.dof.use_dof for camera in cameras)
    )


def light_in(rgba: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the light (H, W, 3) of a render (H, W, 4), without what a filter has made negative, at most BRIGHTEST.

    A group's nodes cut it there, too; the sun's disk is brighter than a half float holds.
    """
    return np.nan_to_num(np.clip(rgba[..., :3], np.float32(0), np.float32(BRIGHTEST)), copy=False)


def _served(paths: SensorPaths, options: RenderOptions) -> tuple[object, ...]:
    return paths.depth is not None, replace(options, first_frames=())
