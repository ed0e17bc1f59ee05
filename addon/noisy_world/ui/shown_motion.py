# SPDX-License-Identifier: GPL-3.0-or-later
"""How the camera of the panel's sequence stands and moves at a frame, for weather that is in the world."""

from collections.abc import Callable, Collection
from dataclasses import replace

import bpy
import numpy as np

from ..blender.scene_camera import sampled_camera, shots_at
from ..core.planning.sequence import PlannedSequence
from ..core.schema import ConfigPath
from ..core.trajectories.camera_state import CameraState, camera_state_of
from ..core.trajectories.trajectory import Trajectory
from ..pipeline.clean_frame import Camera
from . import footage, metered, this_scene, world
from .document import intrinsics_of, recorded
from .paths import clean_poses, clean_stamps_s, deviated_poses
from .properties import panel_of
from .stills import path_frames


def shown_path(scene: bpy.types.Scene, sources: Collection[int]) -> Trajectory | None:
    """Return the camera's path, on which at least the poses of some source frames are known; None where it has none.

    A path that is loaded is known wholly. That of the scene's own camera, where it is not loaded, is looked up at these
    frames alone. Raises NoisyWorldError where a recording cannot be read or a perturbation breaks its contract.
    """
    panel = panel_of(scene)
    if footage.is_shown(panel):
        return recorded(panel).path
    c2w = None if _waits(scene) else clean_poses(scene)
    if c2w is not None:
        moved = deviated_poses(scene, c2w)
        keyed = c2w if moved is None else moved
        stamps_s = clean_stamps_s(scene)
        shots = shots_at(scene, path_frames(scene)) if this_scene.follows(panel) else None
        return Trajectory(keyed, stamps_s, shots=shots) if len(stamps_s) == len(keyed) else None
    return _sampled(scene, sorted(set(sources))) if this_scene.follows(panel) and scene.camera is not None else None


def _sampled(scene: bpy.types.Scene, sources: list[int]) -> Trajectory:
    from ..sources.blend_source import rigid_c2w

    stamps_s = clean_stamps_s(scene)
    found = sampled_camera(scene, None, path_frames(scene)[sources].tolist())
    c2w = np.tile(np.eye(4), (len(stamps_s), 1, 1))
    c2w[sources] = rigid_c2w(found.matrices, ConfigPath(this_scene.CAMERA_FIELD))
    posed = np.zeros(len(stamps_s), dtype=np.bool_)
    posed[sources] = True
    return Trajectory(c2w, stamps_s, posed=posed, shots=shots_at(scene, path_frames(scene)))


def camera_at(scene: bpy.types.Scene, sequence: PlannedSequence, frame: int) -> Camera:
    """Return what is known about the camera at a frame of the sequence. Raises NoisyWorldError as `shown_path` does."""
    earlier = metered.earlier_of(scene, sequence)
    camera = Camera(intrinsics_of(panel_of(scene)), clean_stamps_s(scene), earlier=earlier)
    if not sequence.setting.uses_motion:
        return camera
    sources = [sequence.source_frames[k] for k in (0, max(frame - 1, 0), frame)]
    return replace(camera, path=shown_path(scene, sources))


def camera_states(scene: bpy.types.Scene, sequence: PlannedSequence) -> Callable[[int], CameraState] | None:
    """Return what gives the camera's state at a frame of the sequence, whose last one stays at later numbers.

    None where no perturbation asks for it, or where the path is not known wholly: the scene's own camera has to be
    loaded, as looking at all its frames would take seconds.
    """
    path = shown_path(scene, ()) if sequence.setting.uses_motion and not _waits(scene) else None
    if path is None:
        return None
    camera, last = Camera(None, path.stamps_s, path), len(sequence.source_frames) - 1
    return lambda frame: camera_state_of(camera.motion(sequence, min(max(frame, 0), last)))


def is_unknown(scene: bpy.types.Scene, sequence: PlannedSequence) -> bool:
    """Tell whether a perturbation asks how the camera moves, and its path has to be loaded for that."""
    return sequence.setting.uses_motion and _waits(scene)


def _waits(scene: bpy.types.Scene) -> bool:
    return this_scene.follows(panel_of(scene)) and not world.has_current_path(scene)
