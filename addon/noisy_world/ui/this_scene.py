# SPDX-License-Identifier: GPL-3.0-or-later
"""The open scene itself as what the dataset shows, and its own camera as the path."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender.scene_camera import bound_cameras, camera_parameters, sampled_camera
from ..blender.scene_inspection import inspect_scene, scale_note
from ..blender.scene_problems import camera_problems
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.presets.frame_range import FrameRange
from ..core.schema import ConfigPath
from ..core.trajectories.rounding import rounded_path
from ..core.trajectories.trajectory import Trajectory
from .own_objects import keys_state
from .properties import panel_of
from .scene_copy import blend_file, keeps_compositing

CAMERA_FIELD = "Trajectory > Scene Camera"


def is_shown(panel: Any) -> bool:
    """Tell whether the dataset shows the scene itself."""
    return panel.mesh_source == "SCENE"


def follows(panel: Any) -> bool:
    """Tell whether the path is that of the scene's own camera."""
    return is_shown(panel) and panel.trajectory_source == "CAMERA"


def frame_range(scene: bpy.types.Scene) -> FrameRange:
    """Return the scene's frames that the dataset shows, where its own camera is the path."""
    step = scene.frame_step * panel_of(scene).every
    return FrameRange(scene.frame_start, max(scene.frame_start, scene.frame_end), step)


def scene_frames(scene: bpy.types.Scene, count: int, stamps_s: NDArray[np.float64] | None = None) -> NDArray[Any]:
    """Return the scene frame of each of the `count` poses of the path, whole or not.

    stamps_s: (N,) of the poses of a file, which may be fewer than `count`; then frames follow one another.
    """
    panel = panel_of(scene)
    if not is_shown(panel):
        return np.arange(count)
    if follows(panel):
        chosen = frame_range(scene)
        return chosen.first + chosen.step * np.arange(count)
    fps = scene.render.fps / scene.render.fps_base
    if stamps_s is None or len(stamps_s) < count:
        return scene.frame_start + np.arange(count)
    frames = scene.frame_start + (stamps_s[:count] - stamps_s[0]) * fps
    return np.where(np.abs(frames - np.round(frames)) < 1e-3, np.round(frames), frames)


def stamps_of(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the time stamps (N,) of the path of the scene's own camera, seconds."""
    frames = np.array(frame_range(scene).frames, dtype=np.float64)
    return (frames - frames[0]) * (scene.render.fps_base / scene.render.fps)


def own_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the camera that the scene looks through at the current frame. Raises InputError where there is none."""
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise InputError(CAMERA_FIELD, "the scene looks through no camera", remedy="add one, and make it the scene's")
    return camera


def intrinsics_of_scene(scene: bpy.types.Scene) -> Intrinsics:
    """Return the intrinsics of the scene's own camera. Raises InputError where it has none."""
    camera = own_camera(scene)
    parameters = camera_parameters(scene, camera)
    if parameters.kind != "PERSP":
        raise InputError(CAMERA_FIELD, f"{camera.name} is not perspective", remedy="change its type")
    return parameters.intrinsics


def sampled_path(scene: bpy.types.Scene) -> Trajectory:
    """Return the path of the scene's own camera, frame by frame.

    Raises InputError where it has none, or sees as no camera of a dataset does.
    """
    from ..sources.blend_source import rigid_c2w

    own_camera(scene)
    sampled = sampled_camera(scene, None, frame_range(scene).frames)
    for item in camera_problems(sampled, lens_given=panel_of(scene).lens_source == "GIVEN"):
        raise InputError(CAMERA_FIELD, item.problem, remedy=item.remedy)
    c2w = rigid_c2w(sampled.matrices, ConfigPath(CAMERA_FIELD))
    note = scale_note(scene)
    path = Trajectory(c2w, stamps_of(scene), (f"This Scene: {note}",) if note else (), shots=sampled.shots)
    return rounded_path(path)


def check(scene: bpy.types.Scene) -> None:
    """Raise InputError where the scene, as it is open, can be no source: what is missing, scripted or not baked."""
    panel = panel_of(scene)
    given = panel.lens_source == "GIVEN"
    found = inspect_scene(scene, None, frame_range(scene), path=False, lens_given=given)
    needed = follows(panel) or not given
    for item in found.problems:
        if needed or item.key != "camera":
            raise InputError("This Scene", item.problem, remedy=item.remedy)


def entry(panel: Any, place: Any) -> dict[str, Any]:
    """Return what a preset's scene says of the open one. place: gives a file's path as the preset has it."""
    scene: bpy.types.Scene = panel.id_data
    said: dict[str, Any] = {"blend": place(str(blend_file(scene))), "scene": scene.name}
    if follows(panel):
        if scene.camera is not None and not bound_cameras(scene):
            said["camera"] = scene.camera.name
        chosen = frame_range(scene)
        said["frames"] = f"{chosen.first}:{chosen.last}" + (f":{chosen.step}" if chosen.step > 1 else "")
    elif scene.camera is not None:
        said["camera"] = scene.camera.name
    if keeps_compositing(scene):
        said["compositor"] = "keep"
    if abs(panel.depth_alpha - 0.5) > 1e-6:
        said["depth_alpha"] = float(str(np.float32(panel.depth_alpha)))
    return said


def motion_state(scene: bpy.types.Scene) -> list[Any]:
    """Return what tells whether the scene's own camera still goes as it was sampled: what moves it, and its frames."""
    chosen, moved_by = frame_range(scene), []
    bound = bound_cameras(scene)
    for camera in dict.fromkeys(item for _, item in bound) if bound else (scene.camera,):
        item = camera
        while item is not None:
            still = item.animation_data is None and not item.constraints
            pose = [round(value, 6) for row in item.matrix_basis for value in row] if still else []
            moved_by.append([item.name, keys_state(item), pose])
            item = item.parent
    cuts = [[frame, item.name] for frame, item in bound]
    return [[chosen.first, chosen.last, chosen.step], moved_by, *([cuts] if cuts else [])]


def has_moved(scene: bpy.types.Scene, frame: float, c2w: NDArray[np.float64]) -> bool:
    """Tell whether the scene's own camera is elsewhere at a frame than at this pose (4, 4)."""
    from ..sources.blend_source import rigid_c2w

    sampled = sampled_camera(scene, None, [frame])
    return not np.allclose(rigid_c2w(sampled.matrices, ConfigPath(CAMERA_FIELD))[0], c2w, atol=1e-5)
