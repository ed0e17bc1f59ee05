# SPDX-License-Identifier: GPL-3.0-or-later
"""The clean path and the deviated one in the 3D views, in two colours that every colour vision tells apart."""

import json
from dataclasses import dataclass
from typing import Any, Literal

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..blender.scene import get_origin
from ..core.errors import NoisyWorldError
from ..core.perturbing.execution import chosen_poses, move, split_motion
from ..core.trajectories.rounding import rounded_poses
from ..core.trajectories.trajectory import Trajectory
from . import drawn_body, drawn_tracks, footage, this_scene
from .document import NO_BODY, identifiers_of, listed_motion, motion_of, recorded
from .long_text import write
from .properties import panel_of
from .wording import spoken

CLEAN_C2W = "noisy_world_clean_c2w"
"""A camera's custom property: its clean poses (N, 4, 4), camera-to-world, OpenCV axes, metres, as N x 16 floats."""

CLEAN_STAMPS_S = "noisy_world_clean_stamps_s"
"""A camera's custom property: the time stamps (N,) of its clean poses, seconds."""

CLEAN_RGB = (0.34, 0.71, 0.91)  # sky blue and orange of Okabe and Ito's palette for every colour vision
DEVIATED_RGB = (0.90, 0.62, 0.0)
HIDDEN_ALPHA = 0.75  # of lines behind walls; this and the next are chosen by eye
CLEAN_ICON, DEVIATED_ICON, BODY_ICON = "STRIP_COLOR_05", "STRIP_COLOR_02", "STRIP_COLOR_04"
WIDTH_PX = 3.0
TICKS = 60  # at most: short lines along the path that show where the camera looks
TICK_SHARE = 0.02  # of the path's extent


@dataclass(frozen=True)
class Drawn:
    """The lines drawn for a scene, and the values they were made from. c2w, moved: the poses that they show."""

    made_from: tuple[Any, ...]
    clean: Any
    deviated: Any | None
    c2w: NDArray[np.float64] | None = None
    moved: NDArray[np.float64] | None = None


_drawn: dict[int, Drawn] = {}  # by scene
_deviated: dict[tuple[Any, ...], NDArray[np.float64]] = {}  # the last result: both the keys and the lines use it
_handles: list[Any] = []


def _camera_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the camera that has a clean path: the scene's active one or, if that has none, another of the scene."""
    if scene.camera is not None and CLEAN_C2W in scene.camera:
        return scene.camera
    # Of a scene of one's own, the camera that we key is never the scene's.
    return next((item for item in scene.objects if item.type == "CAMERA" and CLEAN_C2W in item), None)


def path_of(scene: bpy.types.Scene) -> Any | None:
    """Return the floats of the clean path; None where no camera has one."""
    camera = _camera_of(scene)
    return None if camera is None else camera[CLEAN_C2W]


def clean_stamps_s(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the time stamps (N,) of the clean path, seconds; without a path those of the scene frames."""
    if footage.is_shown(panel_of(scene)):
        return recorded(panel_of(scene)).stamps_s
    if this_scene.follows(panel_of(scene)):
        return this_scene.stamps_of(scene)
    camera = _camera_of(scene)
    if camera is not None and CLEAN_STAMPS_S in camera:
        return np.array(camera[CLEAN_STAMPS_S], dtype=np.float64)
    poses = clean_poses(scene)
    count = scene.frame_end + 1 if poses is None else len(poses)
    return np.arange(count) * scene.render.fps_base / scene.render.fps


def clean_poses(scene: bpy.types.Scene) -> NDArray[np.float64] | None:
    """Return the clean poses (N, 4, 4) that the scene's camera was keyed from, OpenCV axes, metres; None without."""
    values = path_of(scene)
    if values is None or len(values) == 0 or len(values) % 16:
        return None
    return np.array(values, dtype=np.float64).reshape(-1, 4, 4)


def deviated_poses(scene: bpy.types.Scene, c2w: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the poses (M, 4, 4) that the panel moves the clean ones (N, 4, 4) to; None where they leave them alone.

    Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    moving, _ = split_motion(motion_of(panel_of(scene)))
    if not moving:
        return None
    identifiers, stamps_s = identifiers_of(panel_of(scene)), _stamps_s_of(scene, len(c2w))
    values = [(step.perturbation.name, step.severity, *step.given.items()) for step in moving]
    made_from = (c2w.tobytes(), stamps_s.tobytes(), *values, identifiers)
    if made_from not in _deviated:
        _deviated.clear()
        _deviated[made_from] = rounded_poses(move(moving, Trajectory(c2w, stamps_s), identifiers).c2w)
    return _deviated[made_from]


def _stamps_s_of(scene: bpy.types.Scene, count: int) -> NDArray[np.float64]:
    """Return the time stamps (count,) of the poses that were loaded, whatever the timeline has become since."""
    camera = _camera_of(scene)
    known_s = np.array([] if camera is None else camera.get(CLEAN_STAMPS_S, []), dtype=np.float64)
    return known_s if len(known_s) == count else np.arange(count) * scene.render.fps_base / scene.render.fps


def chosen_frames(scene: bpy.types.Scene, count: int) -> NDArray[np.int64] | None:
    """Return which of the `count` poses that the camera is keyed along the sequence shows; None where it shows all.

    Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    _, choosing = split_motion(motion_of(panel_of(scene)))
    return chosen_poses(choosing, count, identifiers_of(panel_of(scene)))


def drawn_poses(scene: bpy.types.Scene, c2w: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the poses (M, 4, 4) of the second line, which are those that the sequence shows; None without that line.

    There is none where only the panel's own speed leaves poses out, as the lines would be equal. Raises NoisyWorldError
    naming a perturbation that breaks its contract.
    """
    moved = deviated_poses(scene, c2w)
    if not listed_motion(panel_of(scene)):
        return moved
    keyed = c2w if moved is None else moved
    chosen = chosen_frames(scene, len(keyed))
    return moved if chosen is None else keyed[chosen]


# --- drawing ---


def path_lines(c2w: NDArray[np.float64], origin_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the ends (2 M, 3) of the lines that show a path: between its positions, and ticks along the view."""
    places_m = c2w[:, :3, 3] - origin_m
    along_m = np.repeat(places_m, 2, axis=0)[1:-1]
    chosen = np.unique(np.linspace(0, len(c2w) - 1, min(TICKS, len(c2w))).round().astype(int))
    length_m = max(0.05, TICK_SHARE * float(np.ptp(places_m, axis=0).max()))
    ticks_m = np.stack([places_m[chosen], places_m[chosen] + length_m * c2w[chosen, :3, 2]], axis=1)
    return np.concatenate([along_m, ticks_m.reshape(-1, 3)]).astype(np.float32)


def _batches(scene: bpy.types.Scene) -> Drawn | None:
    """Return the lines for a scene, which are made again only if the path or its perturbations have changed."""
    values = path_of(scene)
    if values is None:
        _drawn.pop(scene.session_uid, None)
        return None
    panel = panel_of(scene)
    fields = (panel.deviation_rotation, panel.deviation_translation_m, panel.speed_factor)
    motion = (*fields, json.dumps(listed_motion(panel)))
    origin_m = get_origin(scene)
    made_from = (hash(bytes(memoryview(values))), motion, identifiers_of(panel), tuple(origin_m))
    found = _drawn.get(scene.session_uid)
    if found is None or found.made_from != made_from:
        found = _drawn[scene.session_uid] = _make(scene, made_from, origin_m)
    return found


def _make(scene: bpy.types.Scene, made_from: tuple[Any, ...], origin_m: NDArray[np.float64]) -> Drawn:
    c2w = clean_poses(scene)
    if c2w is None:
        return Drawn(made_from, None, None)
    try:
        second = drawn_poses(scene, c2w)
    except NoisyWorldError:  # `draw` shows the message in the panel
        second = None
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")

    def batch(poses: NDArray[np.float64]) -> gpu.types.GPUBatch:
        content: dict[str, Any] = {"pos": path_lines(poses, origin_m)}
        return batch_for_shader(shader, "LINES", content)

    try:
        moved = deviated_poses(scene, c2w)
    except NoisyWorldError:
        moved = None
    return Drawn(made_from, batch(c2w), None if second is None else batch(second), c2w, moved)


def _draw() -> None:
    context = bpy.context
    space = context.space_data
    # In the camera's view its own path would cover the picture.
    if not space.overlay.show_overlays or context.region_data.view_perspective == "CAMERA":
        return
    if drawn_tracks.shown(context.scene):  # which hold the true path, and would be covered by it
        return
    drawn = _batches(context.scene)
    if drawn is None:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", WIDTH_PX * context.preferences.system.ui_scale)
    carried = _carried(context.scene, drawn, shader)
    # Lines behind walls are drawn too, more faintly: paths lead through rooms, which are viewed from outside.
    tests: tuple[tuple[Literal["NONE", "LESS_EQUAL"], float], ...] = (("NONE", HIDDEN_ALPHA), ("LESS_EQUAL", 1.0))
    for test, alpha in tests:
        gpu.state.depth_test_set(test)
        for batch, rgb in ((drawn.deviated, DEVIATED_RGB), (drawn.clean, CLEAN_RGB)):  # the smoother one above
            if batch is not None:
                shader.uniform_float("color", (*rgb, alpha))
                batch.draw(shader)
        for rgb, batch in carried:
            shader.uniform_float("color", (*rgb, alpha))
            batch.draw(shader)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")


def _carried(scene: bpy.types.Scene, drawn: Drawn, shader: gpu.types.GPUShader) -> list[tuple[drawn_body.Colour, Any]]:
    """Return the lines of the body and the rig at the current frame, by colour."""
    if drawn.c2w is None:
        return []
    row = current_row(scene, len(drawn.c2w))
    moved = drawn.c2w if drawn.moved is None or len(drawn.moved) != len(drawn.c2w) else drawn.moved
    found = []
    for rgb, ends in drawn_body.lines(panel_of(scene), drawn.c2w, row, moved[row]):
        content: dict[str, Any] = {"pos": (ends - get_origin(scene)).astype(np.float32)}
        found.append((rgb, batch_for_shader(shader, "LINES", content)))
    return found


def current_row(scene: bpy.types.Scene, count: int) -> int:
    """Return which of the path's poses, `count` of them, the current frame shows: the last one at or before it."""
    frames = this_scene.scene_frames(scene, count, clean_stamps_s(scene))
    return int(np.clip(np.searchsorted(frames, scene.frame_current, side="right") - 1, 0, count - 1))


# --- the panel's part ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the legend of the paths that are drawn, and what is wrong with them."""
    scene = context.scene
    c2w = clean_poses(scene)
    if c2w is None:
        return
    if drawn_tracks.shown(scene):
        write(layout, context, "Run SLAM shows its paths instead", "INFO")
        return
    row = layout.row(align=True)
    row.label(text="Clean Path", icon=CLEAN_ICON)
    try:
        second = drawn_poses(scene, c2w)
    except NoisyWorldError as error:
        write(layout, context, spoken(error.message), "ERROR")
        return
    if second is not None:
        row.label(text="Deviated Path", icon=DEVIATED_ICON)
    if panel_of(scene).body != NO_BODY:
        row.label(text="Body", icon=BODY_ICON)


def register() -> None:
    """Start drawing in all 3D views."""
    _handles.append(bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    """Stop drawing."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _drawn.clear()
    _deviated.clear()
