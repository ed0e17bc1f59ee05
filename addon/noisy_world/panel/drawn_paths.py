# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths in the 3D views: the clean and the deviated one, the body that carries the camera, and tracked ones."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Color
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.geometry import pose
from ..core.trajectory import Trajectory, rounded_poses
from ..layouts import find_sequence
from ..perturbations.execution import chosen_poses, move, split_motion
from ..render.mesh_session import get_origin
from ..trajectories.bodies import BODIES
from . import open_scene, source_views
from .document import identifiers_of, listed_motion, motion_of, recorded
from .own_objects import OURS
from .properties import FASTER, panel_of
from .sidebar import write
from .tree import value_of
from .wording import spoken

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

    from ..evaluate.trajectory_scores import Score


# The body that carries the camera, and the frames of its rig, as lines in the 3D views at the current frame.


Ends: TypeAlias = NDArray[np.float64]
"""The ends (2 M, 3) of M lines."""
Colour: TypeAlias = tuple[float, float, float]

BODY_RGB = (0.0, 0.62, 0.45)  # bluish green of Okabe and Ito's palette, as the paths' blue and orange are
AXES_RGB: tuple[Colour, Colour, Colour] = ((0.93, 0.25, 0.25), (0.45, 0.80, 0.25), (0.30, 0.50, 0.98))
AXIS_M, IMU_AXIS_M = 0.2, 0.12  # chosen by eye
CORNERS = 24  # of a circle
# Half the length and the width of a trunk, its lower and upper edge as shares of the camera's height; by eye.
_TRUNKS = {"quadruped": (0.2, 0.13, 0.5, 0.75), "rover": (0.25, 0.2, 0.3, 0.6)}


def lines(panel: Any, c2w: NDArray[np.float64], row: int, moved: NDArray[np.float64]) -> list[tuple[Colour, Ends]]:
    """Return the lines of a body and its rig in the world, by colour; none where nothing carries the camera.

    c2w: (N, 4, 4) the planned path. row: which pose of it is shown. moved: (4, 4) where deviation has the camera then.
    """
    path = panel.scene.trajectory
    has_body, has_imu = path.use_body, panel.rig.use_imu
    if not (has_body or has_imu):
        return []
    found = list(zip(AXES_RGB, axes(moved, AXIS_M), strict=True))
    if has_imu:
        imu = moved @ pose(np.eye(3), np.array(value_of(panel.rig.imu, "translation_m")))
        found += zip(AXES_RGB, axes(imu, IMU_AXIS_M), strict=True)
    if has_body:
        body = BODIES[path.body.kind]
        floor_m = float(c2w[:, 2, 3].mean()) - body.height_m
        outline = figure(path.body.kind) @ _upright(c2w, row)[:3, :3].T + [*c2w[row, :2, 3], floor_m]
        found += [(BODY_RGB, outline), (BODY_RGB, _shadow(c2w, floor_m))]
    return found


def axes(c2w: NDArray[np.float64], length_m: float) -> list[Ends]:
    """Return the x, y and z axis of a frame in the world, a line each."""
    return [np.stack([c2w[:3, 3], c2w[:3, 3] + length_m * c2w[:3, axis]]) for axis in range(3)]


def figure(kind: str) -> Ends:
    """Return the outline of a body that stands at the origin and looks along x, z up; as high as its camera."""
    body = BODIES[kind]
    high, wide = body.height_m, body.radius_m
    if kind in _TRUNKS:
        half, side, low, top = _TRUNKS[kind]
        parts = [_box(half, side, low * high, top * high)]
        for x, y in ((half, side), (half, -side), (-half, side), (-half, -side)):
            if kind == "rover":
                parts.append(_circle(0.1, (0, 2), (0.7 * x, y, 0.1)))
            else:
                knee = [0.75 * x - 0.08, y, 0.3 * high]
                parts.append(_strip([[0.75 * x, y, low * high], knee, [0.75 * x, y, 0.0]]))
        parts.append(_strip([[0.8 * half, 0, top * high], [0.8 * half, 0, high]]))
    elif body.stands:
        hip, neck = 0.53 * high, 0.86 * high
        parts = [
            *(_strip([[0, y, hip], [0, 1.3 * y, 0.0]]) for y in (0.1, -0.1)),
            _strip([[0, 0.1, hip], [0, -0.1, hip]]),
            _strip([[0, 0, hip], [0, 0, neck]]),
            *(_strip([[0, 0, neck], [0, y, 0.8 * high], [0.05, 1.2 * y, hip]]) for y in (0.8 * wide, -0.8 * wide)),
            _circle(0.11, (0, 2), (0, 0, high)),
        ]
    else:
        arm = 0.7 * wide
        corners = [(arm, arm), (arm, -arm), (-arm, -arm), (-arm, arm)]
        parts = [_strip([[*corners[0], high], [*corners[2], high]]), _strip([[*corners[1], high], [*corners[3], high]])]
        parts += [_circle(0.5 * wide, (0, 1), (x, y, high)) for x, y in corners]
    return np.concatenate([*parts, _circle(wide, (0, 1), (0, 0, 0.0))])


def _upright(c2w: NDArray[np.float64], row: int) -> NDArray[np.float64]:
    """Return level axes (3, 3): where the camera looks over the floor, its left, and up."""
    ahead = c2w[row, :2, 2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    return np.array([[ahead[0], -ahead[1], 0.0], [ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])


def _shadow(c2w: NDArray[np.float64], floor_m: float) -> Ends:
    """Return the way on the floor."""
    return _strip(np.column_stack([c2w[:, :2, 3], np.full(len(c2w), floor_m)]))


def _strip(points: Any) -> Ends:
    return np.repeat(np.asarray(points, np.float64), 2, axis=0)[1:-1]


def _circle(radius_m: float, plane: tuple[int, int], centre_m: tuple[float, float, float]) -> Ends:
    around = np.linspace(0, 2 * np.pi, CORNERS + 1)
    points = np.zeros((CORNERS + 1, 3))
    points[:, plane[0]], points[:, plane[1]] = radius_m * np.cos(around), radius_m * np.sin(around)
    return _strip(points + centre_m)


def _box(half_m: float, side_m: float, low_m: float, top_m: float) -> Ends:
    ring = np.array([(half_m, side_m), (half_m, -side_m), (-half_m, -side_m), (-half_m, side_m), (half_m, side_m)])
    rings = [_strip(np.column_stack([ring, np.full(5, z)])) for z in (low_m, top_m)]
    posts = [_strip([[x, y, low_m], [x, y, top_m]]) for x, y in ring[:4]]
    return np.concatenate([*rings, *posts])


# What the embedded SLAM system made of a sequence: its path beside the true one, cut into pieces of one colour.
#
# It does not use Blender, and loads the evaluation only when a path is read.


Float64: TypeAlias = NDArray[np.float64]
Part: TypeAlias = Literal["true", "lost", "near", "off", "far"]
"""A part of what is drawn: the true path, where the camera was lost on it, and the estimate by its error."""

NEAR_M, FAR_M = 0.01, 0.05  # errors below the first are near, above the second far; chosen: a good, and a useless map
BY_ERROR: tuple[Part, ...] = ("near", "off", "far")


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """A sequence as it was tracked: its name, SETTING/SCENE, a sentence on it, and the pieces of each part (N, 3).

    Pieces are positions in metres in the dataset's world; one of a single position is a frame between lost ones.
    """

    name: str
    sentence: str
    pieces: Mapping[Part, list[Float64]]


def read_tracked(dataset: Path, found: Path, name: str) -> TrackedPath:
    """Compare what the tracker found of a sequence with its true path. Raises InputError for files that are damaged."""
    from ..evaluate.cases import ESTIMATE, read_estimate_file
    from ..evaluate.trajectory_scores import score_trajectory

    truth = find_sequence(dataset / name).trajectory
    score = score_trajectory(read_estimate_file(found / name / ESTIMATE), truth, frames_s=truth.stamps_s)
    frames = score.frame_errors
    return TrackedPath(
        name,
        f"{name.partition('/')[0]}: {tracked_spoken(score)}",
        true_pieces(truth.c2w[:, :3, 3], frames.tracked) | estimated_pieces(frames.position_m, frames.error_m),
    )


def tracked_spoken(score: "Score") -> str:
    """Return a score in a few words: its error, how much was tracked, and how often the camera was lost."""
    from ..evaluate.trajectory_scores import FAILURES

    tracked = f"{int(score.frame_errors.tracked.sum())} of {score.frames} frames tracked"
    error_m = score.values["ate_rmse_m"]
    if score.failure or error_m is None:
        return f"{tracked}, no error: {FAILURES[score.failure]}"
    losses = int(score.values["losses"] or 0)
    lost = f", lost {'once' if losses == 1 else f'{losses} times'}" if losses else ""
    return f"ATE {length(error_m)}, {tracked}{lost}"


def length(metres: float) -> str:
    """Return a length with the unit that fits it, to two or three digits."""
    for unit, size_m in (("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if metres >= size_m:
            return f"{metres / size_m:.3g} {unit}"
    return f"{metres * 1000:.2g} mm"


def true_pieces(positions_m: Float64, tracked: NDArray[np.bool_]) -> dict[Part, list[Float64]]:
    """(N, 3), (N,) -> the true path, in pieces between frames that were both tracked, and pieces that were lost."""
    return _cut(positions_m, np.where(tracked, 0, 1), ("true", "lost"))


def estimated_pieces(positions_m: Float64, error_m: Float64) -> dict[Part, list[Float64]]:
    """(N, 3), (N,), NaN where a frame was lost -> the estimated path by its error, with gaps where it was lost."""
    known = np.isfinite(error_m)
    classes = np.digitize(np.where(known, error_m, 0.0), (NEAR_M, FAR_M))
    pieces: dict[Part, list[Float64]] = {}
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        for part, found in _cut(positions_m[first:end], classes[first:end], BY_ERROR).items():
            pieces.setdefault(part, []).extend(found)
    return pieces


def _cut(positions_m: Float64, classes: NDArray[np.int64], parts: tuple[Part, ...]) -> dict[Part, list[Float64]]:
    """Cut a path where its class changes; what lies between two frames is of the higher class of both."""
    pieces: dict[Part, list[Float64]] = {}
    if len(positions_m) == 1:
        return {parts[classes[0]]: [positions_m]}
    between = np.maximum(classes[:-1], classes[1:])
    starts = [0, *(np.flatnonzero(np.diff(between)) + 1).tolist(), len(between)]
    for first, end in pairwise(starts):
        if end > first:
            pieces.setdefault(parts[between[first]], []).append(positions_m[first : end + 1])
    return pieces


# Tracked paths as curves in the scene: a collection of ours, which nothing renders and the next run replaces.


COLLECTION = "Noisy World Tracking"
SENTENCE = "noisy_world_sentence"  # of a sequence's collection: what is said of it in the panel
PARTS: "dict[Part, tuple[str, IconItems, tuple[float, float, float]]]" = {
    "true": ("True path", "STRIP_COLOR_09", (0.85, 0.85, 0.85)),
    "lost": ("True path, lost", "COLORSET_16_VEC", (0.05, 0.05, 0.05)),
    # Of Okabe and Ito's palette for every colour vision.
    "near": (f"Error below {length(NEAR_M)}", "STRIP_COLOR_04", (0.0, 0.62, 0.45)),
    "off": (f"Error {length(NEAR_M)} to {length(FAR_M)}", "STRIP_COLOR_03", (0.94, 0.89, 0.26)),
    "far": (f"Error over {length(FAR_M)}", "STRIP_COLOR_01", (0.84, 0.37, 0.0)),
}
"""Name, icon and colour (sRGB) of each part."""
RADIUS_SHARE = 0.008  # of the estimate's tube, of the path's extent; this and the next two are chosen by eye
LEAST_RADIUS_M = 0.002
TRUE_SHARE = 0.6  # of the true path's tube, of the estimate's


def show(scene: bpy.types.Scene, paths: Sequence[TrackedPath]) -> None:
    """Put the paths into the scene, in place of those before."""
    remove(scene)
    ours = bpy.data.collections.new(COLLECTION)
    ours[OURS] = "tracking"
    ours.hide_render = True
    assert scene.collection is not None
    scene.collection.children.link(ours)
    for path in paths:
        own = bpy.data.collections.new(path.name)
        own[SENTENCE] = path.sentence
        own.hide_render = True
        ours.children.link(own)
        radius_m = _radius_m(path)
        for part in PARTS:
            if pieces := path.pieces.get(part):
                thick_m = radius_m * (TRUE_SHARE if part in ("true", "lost") else 1.0)
                own.objects.link(_curve(path.name, part, pieces, get_origin(scene), thick_m))


def remove(scene: bpy.types.Scene) -> None:
    """Remove the paths, and whatever was made for them; what a user has put beside them stays in the scene."""
    ours = collection_of(scene)
    if ours is None:
        return
    assert scene.collection is not None
    for item in list(ours.all_objects):
        if item.get(OURS) in PARTS:
            _remove_curve(item)
        elif all(collection in (ours, *ours.children) for collection in item.users_collection):
            scene.collection.objects.link(item)  # a user has put it there
    for child in (*ours.children, ours):
        bpy.data.collections.remove(child)


def _remove_curve(item: bpy.types.Object) -> None:
    data = item.data
    bpy.data.objects.remove(item)
    if not isinstance(data, bpy.types.Curve) or data.users:
        return
    materials = [material for material in data.materials if material is not None]
    bpy.data.curves.remove(data)
    for material in materials:
        if not material.users:
            bpy.data.materials.remove(material)


def collection_of(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Return our collection of a scene."""
    assert scene.collection is not None
    return next((item for item in scene.collection.children_recursive if item.get(OURS) == "tracking"), None)


def shown(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Return the collections of the sequences whose paths a scene holds."""
    ours = collection_of(scene)
    return [] if ours is None else [item for item in ours.children if SENTENCE in item]


def parts_of(collections: Sequence[bpy.types.Collection]) -> list[Part]:
    """Return the parts that are there, for a legend."""
    there = {item.get(OURS) for collection in collections for item in collection.objects}
    return [part for part in PARTS if part in there]


def _radius_m(path: TrackedPath) -> float:
    whole = np.concatenate([piece for pieces in path.pieces.values() for piece in pieces])
    return max(LEAST_RADIUS_M, RADIUS_SHARE * float(np.ptp(whole, axis=0).max()))


def _curve(
    name: str, part: Part, pieces: list[NDArray[np.float64]], origin_m: NDArray[np.float64], radius_m: float
) -> bpy.types.Object:
    label, _, rgb = PARTS[part]
    curve = bpy.data.curves.new(f"{name}: {label}", "CURVE")
    assert isinstance(curve, bpy.types.Curve)
    curve.dimensions = "3D"
    curve.bevel_depth = radius_m
    curve.bevel_resolution = 1
    curve.use_fill_caps = True
    for piece in pieces:
        # A single frame between lost ones is drawn as a dot.
        ends = piece if len(piece) > 1 else np.stack([piece[0], piece[0] + (0.0, 0.0, radius_m)])
        spline = curve.splines.new("POLY")
        spline.points.add(len(ends) - 1)
        values = np.ones((len(ends), 4), np.float32)
        values[:, :3] = ends - origin_m
        spline.points.foreach_set("co", values.ravel())
    curve.materials.append(_material(label, rgb))
    item = bpy.data.objects.new(curve.name, curve)
    item[OURS] = part
    item.color = _linear(rgb)  # views that colour by attributes fall back to it
    item.show_in_front = True  # paths lead through rooms, which are viewed from outside
    item.hide_render = True
    item.visible_camera = item.visible_shadow = False  # for views in Rendered shading, which ask nothing else
    return item


def _material(label: str, rgb: tuple[float, float, float]) -> bpy.types.Material:
    name = f"Noisy World: {label}"
    found = next((item for item in bpy.data.materials if item.name == name and item.library is None), None)
    material = bpy.data.materials.new(name) if found is None else found
    material.diffuse_color = _linear(rgb)
    return material


def _linear(rgb: tuple[float, float, float]) -> Any:
    """Return a colour as Blender's properties take it, for which the stubs give no type."""
    red, green, blue = Color(rgb).from_srgb_to_scene_linear()
    return red, green, blue, 1.0


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
    if source_views.shows_footage(panel_of(scene)):
        return recorded(panel_of(scene)).stamps_s
    if open_scene.follows(panel_of(scene)):
        return open_scene.stamps_of(scene)
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
    if all(FASTER in item for item in listed_motion(panel_of(scene))):
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
    motion = json.dumps(listed_motion(panel))
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
    if shown(context.scene):  # which hold the true path, and would be covered by it
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


def _carried(scene: bpy.types.Scene, drawn: Drawn, shader: gpu.types.GPUShader) -> list[tuple[Colour, Any]]:
    """Return the lines of the body and the rig at the current frame, by colour; none where the frame is not known."""
    if drawn.c2w is None:
        return []
    try:
        row = current_row(scene, len(drawn.c2w))
    except NoisyWorldError:  # the panel names a recording that cannot be read by now, and its section says so
        return []
    moved = drawn.c2w if drawn.moved is None or len(drawn.moved) != len(drawn.c2w) else drawn.moved
    found = []
    for rgb, ends in lines(panel_of(scene), drawn.c2w, row, moved[row]):
        content: dict[str, Any] = {"pos": (ends - get_origin(scene)).astype(np.float32)}
        found.append((rgb, batch_for_shader(shader, "LINES", content)))
    return found


def current_row(scene: bpy.types.Scene, count: int) -> int:
    """Return which of the path's poses, `count` of them, the current frame shows: the last one at or before it."""
    frames = open_scene.scene_frames(scene, count, clean_stamps_s(scene))
    return int(np.clip(np.searchsorted(frames, scene.frame_current, side="right") - 1, 0, count - 1))


# --- the panel's part ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the legend of the paths that are drawn, and what is wrong with them."""
    scene = context.scene
    c2w = clean_poses(scene)
    if c2w is None:
        return
    if shown(scene):
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
    if panel_of(scene).scene.trajectory.use_body:
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
