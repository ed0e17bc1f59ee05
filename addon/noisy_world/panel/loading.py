# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene, the path and the camera that the panel describes, in the user's file: only our objects are replaced."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, NoisyWorldError
from ..core.file_access import split_home
from ..nodes.datablocks import camera_of, mesh_of
from ..render.mesh_session import add_camera, add_mesh, key_poses, rgba_of, set_intrinsics, set_origin
from ..scenes.polygon_mesh import Mesh
from ..sources import find_scenes
from ..sources.rendered_mesh import forget_rooms_and_meshes, load_mesh
from . import open_scene, source_views
from .document import intrinsics_of, listed_motion, preset_of, scene_name, scene_of
from .drawn_paths import CLEAN_C2W, CLEAN_STAMPS_S, chosen_frames, deviated_poses
from .fields import LISTENERS
from .open_scene import absolute
from .own_objects import (
    OURS,
    camera_alone,
    images_of,
    keys_state,
    mark,
    own_object,
    put_into,
    select,
    take_out_mesh,
    tied,
)
from .properties import panel_of
from .tree import value_of

KEYED_BY = "noisy_world_keyed_by"  # of our camera: what the list did to the path when it was keyed, as JSON
LOADED_FROM = "noisy_world_loaded_from"  # of ours: what of the panel decided the mesh or the path, as JSON
LEFT_AS = "noisy_world_left_as"  # of ours: how we left the mesh or the lens, to see whether it was changed since
KEYS_LEFT_AS = "noisy_world_keys_left_as"  # of our camera: how we left its keys
DISPLAY_COLOURS = "Display"
FASTEST_FPS = 32767  # that Blender knows
RATE_TOLERANCE = 1e-3  # of a rate, which stamps with six decimals do not hold exactly; chosen
FAR_M = 1000.0  # beyond it float32 numbers are 0.06 mm apart or more, and the scene is moved
PATH_PROPERTIES = frozenset(("seed", "scene.name", "scene.use_name", "setting.name"))


def is_editable(scene: bpy.types.Scene | None) -> bool:
    """Tell whether a scene is this file's own: what is linked from another is left alone."""
    return scene is not None and scene.library is None and scene.is_editable


# --- mesh ---


def load_scene(scene: bpy.types.Scene) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Put the mesh that the panel names into the scene, in place of the one before.

    Returns the object, and what a user should know of how the file was read. Raises InputError.
    """
    panel = panel_of(scene)
    mesh = load_mesh(_mesh_path(panel), panel.room_seed)
    take_out_mesh(scene)
    set_origin(scene, _origin_m(mesh))
    loaded = add_mesh(scene, mesh, scene_name(panel), decoding="shader")
    mark(loaded, "mesh")
    put_into(scene, loaded)
    # Its colours hold the light already, and for shadows EEVEE would draw it several more times.
    loaded.visible_shadow = False
    _add_display_colours(mesh_of(loaded), mesh)
    for image in images_of(loaded):
        image.pack()  # its pixels are the file's own, and would not be saved with it otherwise
    loaded[LOADED_FROM] = _decided_by(panel, "mesh")
    loaded[LEFT_AS] = _mesh_state(loaded)
    select(scene, loaded)
    return loaded, mesh.notes


def is_textured(item: bpy.types.Object) -> bool:
    """Tell whether a mesh of ours shows a texture."""
    return bool(images_of(item))


def _mesh_path(panel: Any) -> Path | None:
    """Return the file of the mesh that the panel names; None is an embedded room. Raises InputError."""
    if panel.mesh_source == "ROOM":
        return None
    try:
        split_home(panel.of_mesh.mesh)
    except LookupError as error:
        raise InputError("Mesh File", str(error)) from error
    return Path(absolute(panel.of_mesh.mesh))


def _origin_m(mesh: Mesh) -> NDArray[np.float64]:
    """Return the point that becomes Blender's origin: the world's own, unless the mesh is far from it."""
    # Column by column numpy is ten times as fast as along the first axis.
    low_m, high_m = np.array([(column.min(), column.max()) for column in mesh.vertices_m.T]).T
    return np.rint((low_m + high_m) / 2) if max(np.abs(low_m).max(), np.abs(high_m).max()) > FAR_M else np.zeros(3)


def _add_display_colours(data: bpy.types.Mesh, mesh: Mesh) -> None:
    """Add colours for Solid shading, which reads float colours as linear light; those for rendering are not changed."""
    rendered = data.color_attributes.render_color_index
    domain, rgba = rgba_of(mesh)
    colours = data.color_attributes.new(DISPLAY_COLOURS, "BYTE_COLOR", domain)
    assert isinstance(colours, bpy.types.ByteColorAttribute)
    colours.data.foreach_set("color_srgb", rgba.ravel())
    data.color_attributes.active_color_name = DISPLAY_COLOURS
    data.color_attributes.render_color_index = rendered


# --- path ---


def load_path(scene: bpy.types.Scene) -> tuple[int, tuple[str, ...]]:
    """Load or make the panel's trajectory, key the camera along it and set the timeline to it.

    Returns the number of poses, and notes: first what of the timeline has changed. Where the dataset shows the scene
    itself, its camera, its range and its rate stay, and a camera of ours shows the path. Raises NoisyWorldError.
    """
    if open_scene.is_shown(panel_of(scene)):
        return _load_own_path(scene)
    nominal = find_scenes(preset_of(panel_of(scene)))[0].path
    camera = set_camera(scene)
    camera[CLEAN_C2W] = nominal.c2w.ravel().tolist()
    camera[CLEAN_STAMPS_S] = nominal.stamps_s.tolist()
    camera[LOADED_FROM] = _decided_by(panel_of(scene), "camera")
    key_camera(scene)
    select(scene, camera)
    changed = set_timeline(scene, nominal.stamps_s)
    return len(nominal), (*([changed] if changed else []), *nominal.notes)


def _load_own_path(scene: bpy.types.Scene) -> tuple[int, tuple[str, ...]]:
    """Sample the scene's own camera, or read the file's path, and key our camera along it."""
    panel = panel_of(scene)
    if open_scene.follows(panel):
        nominal = open_scene.sampled_path(scene)
    else:
        open_scene.ensure(scene)
        nominal = find_scenes(preset_of(panel))[0].path
    set_origin(scene, np.zeros(3))
    camera = camera_alone(scene) or _new_camera(scene)
    put_into(scene, camera)
    _take_lens(scene, camera)
    camera[CLEAN_C2W] = nominal.c2w.ravel().tolist()
    camera[CLEAN_STAMPS_S] = nominal.stamps_s.tolist()
    camera[LOADED_FROM] = _decided_by(panel, "camera")
    key_camera(scene)
    return len(nominal), nominal.notes


def _new_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    before = scene.camera
    camera = add_camera(scene, "Noisy World Camera")
    scene.camera = before
    mark(camera, "camera")
    return camera


def _take_lens(scene: bpy.types.Scene, camera: bpy.types.Object) -> None:
    """Let our camera see as the scene's own does."""
    own = scene.camera
    if own is None or own == camera or not isinstance(own.data, bpy.types.Camera):
        return
    before, camera.data = camera.data, own.data.copy()
    camera_of(camera).animation_data_clear()
    if isinstance(before, bpy.types.Camera) and not before.users:
        bpy.data.cameras.remove(before)


def key_camera(scene: bpy.types.Scene) -> None:
    """Key the camera along its path, deviated as the panel says, and set the timeline's step.

    Raises NoisyWorldError naming a perturbation that breaks its contract; the keys are then kept.
    """
    camera = camera_alone(scene)
    if camera is None or CLEAN_C2W not in camera:
        return
    c2w = np.array(camera[CLEAN_C2W], dtype=np.float64).reshape(-1, 4, 4)
    deviated = deviated_poses(scene, c2w)
    keyed = c2w if deviated is None else deviated
    step = _frame_step(chosen_frames(scene, len(keyed)), len(keyed))
    before = camera.animation_data.action if camera.animation_data else None
    stamps_s = np.array(camera.get(CLEAN_STAMPS_S, ()), dtype=np.float64)
    key_poses(scene, camera, keyed, open_scene.scene_frames(scene, len(keyed), stamps_s))
    if before is not None and not before.users:
        bpy.data.actions.remove(before)
    camera[KEYED_BY] = json.dumps(listed_motion(panel_of(scene)))
    if not open_scene.is_shown(panel_of(scene)):
        scene.frame_step = step  # rendered, an animation holds the frames of the sequence
    camera[KEYS_LEFT_AS] = keys_state(camera)


def _frame_step(chosen: NDArray[np.int64] | None, count: int) -> int:
    """Return the timeline's step that shows the chosen of `count` poses; 1 where no step does."""
    if chosen is None:
        return 1
    step = int(chosen[1] - chosen[0]) if len(chosen) > 1 else count
    return step if step > 0 and np.array_equal(chosen, np.arange(0, count, step)) else 1


def set_timeline(scene: bpy.types.Scene, stamps_s: NDArray[np.float64]) -> str:
    """Give the timeline the range and the rate of a path, at its first frame; say what has changed, "" if nothing has.

    stamps_s: (N,), of the poses, which are at the scene frames from 0.
    """
    before = _timeline(scene)
    scene.frame_start, scene.frame_end = 0, len(stamps_s) - 1
    if len(stamps_s) > 1:
        _set_rate(scene, rate_of(stamps_s))
    scene.frame_set(0)
    after = _timeline(scene)
    changed = [f"{after[name]} (was {before[name]})" for name in after if after[name] != before[name]]
    return f"timeline: {', '.join(changed)}" if changed else ""


def rate_of(stamps_s: NDArray[np.float64]) -> float:
    """Return the frames a second of stamps (N,), N > 1: their median rate."""
    return float(1.0 / np.median(np.diff(stamps_s)))


def _set_rate(scene: bpy.types.Scene, rate_hz: float) -> None:
    whole = min(max(1, round(rate_hz)), FASTEST_FPS)
    scene.render.fps = whole
    scene.render.fps_base = 1.0 if abs(rate_hz - whole) < RATE_TOLERANCE * rate_hz else whole / rate_hz


def _timeline(scene: bpy.types.Scene) -> dict[str, str]:
    return {
        "range": f"frames {scene.frame_start} to {scene.frame_end}",
        "rate": f"{frames_per_s(scene):.4g} fps",
        "frame": f"at frame {scene.frame_current}",
    }


def frames_per_s(scene: bpy.types.Scene) -> float:
    """Return a scene's frame rate."""
    return scene.render.fps / scene.render.fps_base


# --- camera ---


def set_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """Give the scene our camera with the panel's intrinsics, and make it the scene's."""
    camera = camera_alone(scene)
    if camera is None:
        camera = add_camera(scene, "Noisy World Camera")
        mark(camera, "camera")
    put_into(scene, camera)
    scene.camera = camera
    apply_intrinsics(scene)
    return camera


def apply_intrinsics(scene: bpy.types.Scene) -> None:
    """Give our camera, where there is one, the panel's intrinsics; the scene's resolution goes with them."""
    camera = camera_alone(scene)
    if camera is None or open_scene.is_shown(panel_of(scene)) or source_views.shows_footage(panel_of(scene)):
        return
    panel = panel_of(scene)
    near_m, far_m = value_of(panel.camera, "near_m"), value_of(panel.camera, "far_m")
    set_intrinsics(scene, camera, intrinsics_of(panel), near_m=near_m, far_m=far_m)
    camera[LEFT_AS] = _lens_state(scene, camera)


# --- what was loaded, and what became of it ---


def is_from_panel(scene: bpy.types.Scene, item: bpy.types.Object) -> bool:
    """Tell whether the panel still names what our mesh was read from, or our camera's path."""
    return item.get(LOADED_FROM) == _decided_by(panel_of(scene), item[OURS])


def is_changed(scene: bpy.types.Scene, item: bpy.types.Object) -> bool:
    """Tell whether our mesh or our camera was moved, edited or set up otherwise since we made it."""
    if item[OURS] == "mesh":
        return not isinstance(item.data, bpy.types.Mesh) or item.get(LEFT_AS) != _mesh_state(item)
    if not isinstance(item.data, bpy.types.Camera):
        return True
    keyed = KEYS_LEFT_AS in item and item[KEYS_LEFT_AS] != keys_state(item)
    return keyed or item.get(LEFT_AS) != _lens_state(scene, item)


def _decided_by(panel: Any, kind: str) -> str:
    """Return what of the panel decides the mesh, or the camera's path, as JSON."""
    if open_scene.is_shown(panel):
        path = open_scene.motion_state(panel.id_data) if open_scene.follows(panel) else scene_of(panel)["trajectory"]
        return json.dumps([kind, path])
    described = scene_of(panel)
    if source_views.shows_footage(panel):
        return json.dumps([kind, described])
    if kind == "mesh":
        return json.dumps(described["mesh"])
    made_here = panel.trajectory_source == "HANDHELD" or panel.scene.trajectory.use_body
    return json.dumps([described["trajectory"], *([described["mesh"], value_of(panel, "seed")] if made_here else [])])


def _mesh_state(item: bpy.types.Object) -> str:
    """Return what decides how our mesh looks in a render."""
    data = mesh_of(item)
    pose = [round(value, 6) for row in item.matrix_basis for value in row]
    materials = [material.name for material in data.materials if material is not None]
    counted = [len(item.modifiers), len(data.vertices), len(data.polygons)]
    return json.dumps([item.animation_data is None, tied(item), pose, counted, materials])


def _lens_state(scene: bpy.types.Scene, item: bpy.types.Object) -> str:
    """Return what decides the shape of our camera's picture."""
    data, render = camera_of(item), scene.render
    assert data.dof is not None
    lens = [data.type, data.sensor_fit, data.sensor_width, data.lens, data.shift_x, data.shift_y]
    lens += [data.clip_start, data.clip_end, data.dof.use_dof, data.animation_data is None]
    image = [render.resolution_x, render.resolution_y, render.pixel_aspect_x, render.pixel_aspect_y]
    return json.dumps([lens, image])


# --- following ---


def follow(scene: bpy.types.Scene, names: frozenset[str]) -> None:
    """Update our camera after changes of the panel."""
    if not isinstance(scene, bpy.types.Scene) or not is_editable(scene):
        return
    if any(name.startswith("camera.") for name in names):
        apply_intrinsics(scene)
    if names & PATH_PROPERTIES or (names & {"steps", "motion"} and _keyed_otherwise(scene)):
        with suppress(NoisyWorldError):  # the panel shows the message beside the legend of the paths
            key_camera(scene)


def _keyed_otherwise(scene: bpy.types.Scene) -> bool:
    """Tell whether the list gives another path than the keyed one; most changes in it do not affect the path."""
    camera = own_object(scene, "camera")
    return camera is not None and camera.get(KEYED_BY, "[]") != json.dumps(listed_motion(panel_of(scene)))


def register() -> None:
    """Register the listener to the panel."""
    LISTENERS.append(follow)


def unregister() -> None:
    """Unregister the listener, and drop meshes from memory."""
    forget_rooms_and_meshes()
    if follow in LISTENERS:
        LISTENERS.remove(follow)


def summary(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Return what is loaded, as sentences for the panel; nothing where the panel names another mesh by now."""
    item = own_object(scene, "mesh")
    if item is None or not isinstance(item.data, bpy.types.Mesh) or not is_from_panel(scene, item):
        return ()
    return f"{len(item.data.vertices):,} vertices", f"{len(item.data.polygons):,} faces"


def poses(scene: bpy.types.Scene) -> int:
    """Return how many poses our camera is keyed along; 0 without a camera."""
    camera: Any = own_object(scene, "camera")
    return 0 if camera is None else len(camera.get(CLEAN_C2W, ())) // 16


def has_current_path(scene: bpy.types.Scene) -> bool:
    """Tell whether our camera is keyed along the path that the panel names."""
    camera = own_object(scene, "camera")
    return camera is not None and poses(scene) > 0 and is_from_panel(scene, camera)


def path_summary(scene: bpy.types.Scene) -> str:
    """Return what our camera is keyed along, for the panel; "" where the panel names another path by now."""
    camera = own_object(scene, "camera")
    if camera is None or not has_current_path(scene):
        return ""
    stamps_s = np.array(camera.get(CLEAN_STAMPS_S, ()), dtype=np.float64)
    rate = f", {rate_of(stamps_s):.4g} fps" if len(stamps_s) > 1 else ""
    return f"{poses(scene):,} poses keyed{rate}"
