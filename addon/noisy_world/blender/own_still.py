# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame of the open scene as the generator renders it from the .blend; the scene itself is not changed."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics, nearest_rotation, opencv_from_blender_c2w, pose
from ..core.optics import Distortion
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.presets.preset import EngineName
from ..core.scratch import ScratchFolder
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.trajectory import Trajectory
from .own_scene import OwnSceneFile, OwnSceneSession
from .scene_camera import sampled_camera, show_frame
from .scene_inspection import samples_of
from .scene_problems import ENGINES
from .shown_colour import ShownColour

SCENE = "Noisy World still"


@dataclass(frozen=True)
class OwnStill:
    """What is rendered: a scene frame, whole or not, from a pose (4, 4) or, where that is None, by the scene's camera.

    follows: whether the path is that camera's own. clip_m: nearest and farthest, where they are not the camera's.
    engine, samples: where they are not the scene's own. depth_alpha: what is less opaque does not stop depth.
    lens: that distorts what the camera sees.
    """

    frame: float
    c2w: NDArray[np.float64] | None
    follows: bool
    intrinsics: Intrinsics
    clip_m: tuple[float, float] | None
    engine: EngineName | None
    samples: int | None
    seed: int
    keep_compositor: bool
    depth_alpha: float
    lens: Distortion | None = None


def render_own_still(scene: bpy.types.Scene, still: OwnStill) -> RenderedFrame:
    """Render colour, display-encoded, and depth as the artist set the scene up.

    All is done in a copy of the scene, which shares its objects and is removed afterwards. Raises StorageError where no
    scratch file can be written.
    """
    with _nothing_left_behind():
        stand_in = scene.copy()
        stand_in.name = SCENE
        if still.keep_compositor and stand_in.compositing_node_group is not None:
            stand_in.compositing_node_group = stand_in.compositing_node_group.copy()
        found = _rendered(stand_in, still)
    assert found.light is not None, "the scene is lit"
    return replace(found, light=replace(found.light, encode=partial(shown_by, scene.name, still.frame)))


def _rendered(scene: bpy.types.Scene, still: OwnStill) -> RenderedFrame:
    sampled = sampled_camera(scene, None, [still.frame])
    parameters = sampled.parameters[0]
    camera = scene.objects[parameters.camera]
    engine = still.engine or ENGINES[scene.render.engine]
    near_m, far_m = still.clip_m or (parameters.near_m, parameters.far_m)
    options = RenderOptions(
        near_m=near_m, far_m=far_m, engine=engine, seed=still.seed, through_glass=True,
        samples=still.samples or samples_of(scene)[engine],
    )  # fmt: skip
    file = OwnSceneFile(
        path=Path(),
        scene=scene.name,
        frames=(still.frame,),
        stamps_s=(0.0,),
        fps=0.0,
        cameras=(camera.name,),
        follows=still.follows,
        lens_given=still.clip_m is not None,
        sampled=still.samples is not None,
        keep_compositor=still.keep_compositor,
        depth_alpha=still.depth_alpha,
    )
    c2w = still.c2w
    if c2w is None:
        axes = sampled.matrices[0, :3, :3] / np.linalg.norm(sampled.matrices[0, :3, :3], axis=0)
        c2w = opencv_from_blender_c2w(pose(nearest_rotation(axes), sampled.matrices[0, :3, 3]))
    at_once = SensorPaths(rgb=Trajectory(c2w[None], np.zeros(1)))
    with OwnSceneSession(file, at_once, still.intrinsics, options, scene=scene, lens=still.lens) as session:
        scene.render.use_persistent_data = False
        return session.frame(FrameRequest(0, 0.0, c2w, c2w))


def shown_by(name: str, frame: float, rgba: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return light (H, W, 4) as a scene of the open file shows it at one of its frames, (H, W, 3)."""
    scratch = ScratchFolder(rgba.nbytes)
    try:
        with _nothing_left_behind():
            scene = bpy.data.scenes[name].copy()
            if scene.animation_data is not None:  # exposure, for instance, may be keyed
                show_frame(scene, frame)
            return ShownColour(scene, (rgba.shape[1], rgba.shape[0]), scratch.path).encode(rgba)
    finally:
        scratch.remove()


@contextmanager
def _nothing_left_behind() -> Iterator[None]:
    """Remove what is made inside, however it ends."""
    kinds = ("scenes", "objects", "cameras", "images", "node_groups", "actions")
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    try:
        yield
    finally:
        for kind in kinds:
            made = [item for item in getattr(bpy.data, kind) if item not in before[kind]]
            for item in made:
                if getattr(item, "type", "") != "RENDER_RESULT":  # Blender's own
                    getattr(bpy.data, kind).remove(item)
