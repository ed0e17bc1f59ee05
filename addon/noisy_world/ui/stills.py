# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean frames for previews: of the panel's mesh as it is shown, or of the scene itself as it is set up."""

from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender.own_still import OwnStill, render_own_still
from ..blender.still import render_stills
from ..blender.still_process import StillRequest
from ..core.datasets.provenance import render_seed
from ..core.errors import InputError
from ..core.optics import Distortion
from ..core.perturbing.execution import split_motion
from ..core.planning.source import RenderedFrame
from ..core.presets.preset import EngineName
from ..sources.bending import lens_of
from . import excluded, footage, this_scene, world
from .described import EMBREE
from .document import PANEL, engine_of, intrinsics_of, motion_of, preset_of, recorded
from .paths import clean_poses, clean_stamps_s, deviated_poses
from .properties import panel_of
from .scene_copy import keeps_compositing
from .source_fields import ITEMS


def path_frames(scene: bpy.types.Scene) -> NDArray[Any]:
    """Return the scene frame of each pose of the clean path, whole or not."""
    if footage.is_shown(panel_of(scene)):
        return np.arange(len(recorded(panel_of(scene)).stamps_s))
    stamps_s = clean_stamps_s(scene)
    return this_scene.scene_frames(scene, len(stamps_s), stamps_s)


def rendered(scene: bpy.types.Scene, frame: int) -> RenderedFrame:
    """Render the frame of a pose: of a mesh it is the scene frame of this number; of a recording, read its frame."""
    panel = panel_of(scene)
    if footage.is_shown(panel):
        return footage.still(recorded(panel), frame)
    if not this_scene.is_shown(panel):
        (still,) = render_stills(scene, [frame], empty=excluded.shows_dataset(scene))
        return still
    return render_own_still(scene, own_still(scene, frame))


def request_of(scene: bpy.types.Scene, indices: Iterable[int]) -> StillRequest:
    """Return what another process is asked for, so that it renders what `rendered` does. Raises InputError."""
    chosen = sorted(indices)
    if this_scene.is_shown(panel_of(scene)):
        return StillRequest(scene.name, {index: own_still(scene, index) for index in chosen})
    return StillRequest(scene.name, dict.fromkeys(chosen), empty=excluded.shows_dataset(scene))


def check_depth(scene: bpy.types.Scene) -> None:
    """Raise InputError where the dataset shows footage that has no depth."""
    panel = panel_of(scene)
    if footage.is_shown(panel) and not recorded(panel).source.capabilities.depth:
        name = {item: label for item, label, _ in ITEMS}[panel.mesh_source]
        without = "take out what reads depth"
        remedy = without if panel.mesh_source == "RECORDING" else f"choose the folder of its depth, or {without}"
        raise InputError(f"Scene > {name}", "has no depth", remedy=remedy)


def beside(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return two pictures (H, W, 3) beside one another; the right one takes the left one's height."""
    import cv2

    if right.shape[0] != left.shape[0]:
        wide = max(1, round(right.shape[1] * left.shape[0] / right.shape[0]))
        right = np.asarray(cv2.resize(right, (wide, left.shape[0]), interpolation=cv2.INTER_NEAREST), np.uint8)
    return np.concatenate([left, right], axis=1)


def own_still(scene: bpy.types.Scene, index: int) -> OwnStill:
    """Return what is rendered for a pose of the path, where the dataset shows the scene itself.

    Raises InputError where the path has to be loaded first.
    """
    panel = panel_of(scene)
    given = panel.render_source == "GIVEN"
    this_scene.check(scene)
    follows = this_scene.follows(panel)
    c2w = clean_poses(scene) if world.has_current_path(scene) else None
    moved = None if c2w is None else deviated_poses(scene, c2w)
    if c2w is None and (not follows or has_moving_steps(scene)):
        raise InputError("Preview Frame", "the path is not loaded, or another by now", remedy="press Load Trajectory")
    at = float(path_frames(scene)[index])
    if (
        moved is not None
        and c2w is not None
        and this_scene.follows(panel)
        and this_scene.has_moved(scene, at, c2w[index])
    ):
        problem = "the scene's camera moves otherwise than when its path was loaded"
        raise InputError("Preview Frame", problem, remedy="press Load Trajectory")
    keyed = c2w if moved is None else moved
    return OwnStill(
        frame=at,
        c2w=None if keyed is None or (moved is None and follows) else keyed[index],
        follows=follows,
        intrinsics=intrinsics_of(panel),
        clip_m=(panel.near_m, panel.far_m) if panel.lens_source == "GIVEN" else None,
        engine=_engine(panel) if given else None,
        samples=panel.samples if given else None,
        seed=render_seed(panel.seed),
        keep_compositor=keeps_compositing(scene),
        depth_alpha=panel.depth_alpha,
        lens=_lens(panel),
    )


def _lens(panel: Any) -> Distortion | None:
    """Return the lens that distorts what the panel's camera sees. Raises InputError where it cannot."""
    if panel.lens_source != "GIVEN" or not panel.distorts:
        return None
    preset = preset_of(panel)
    assert preset.spec.camera is not None, "the panel gives it"
    assert preset.spec.camera.distortion is not None, "it distorts"
    place = preset.place("camera").at("distortion")
    return lens_of(preset.spec.camera.distortion, intrinsics_of(panel), place, cast=False)


def _engine(panel: Any) -> EngineName:
    """Return the engine that the panel gives. Raises InputError for one that shows no scene of a .blend."""
    engine = engine_of(panel)
    if engine == EMBREE:
        problem = "is Embree, which knows no lights or materials"
        raise InputError(PANEL, problem, where="render.engine", remedy="choose another engine")
    return engine


def has_moving_steps(scene: bpy.types.Scene) -> bool:
    """Tell whether a perturbation moves the poses of the path."""
    moving, _ = split_motion(motion_of(panel_of(scene)))
    return len(moving) > 0
