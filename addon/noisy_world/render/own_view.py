# SPDX-License-Identifier: GPL-3.0-or-later
"""How a scene of one's own is looked at: its camera, overridden settings, keys on groups in its compositor."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.errors import StorageError
from ..core.file_access import utf8_name
from ..core.geometry import Intrinsics, blender_from_opencv_c2w, rotvec_from_rotation
from ..images.image_files import read_pixels
from ..nodes.chain_scene import BUILT_AS, clear_keys, drop_empty_action, key_socket
from ..nodes.datablocks import camera_of, fcurves_of, muted_output, set_pixels, set_value
from ..nodes.datablocks import cycles as cycles_of
from ..nodes.node_trees import STAMP, described_as
from ..perturbations.groups import TURNING_INPUT, VELOCITY_INPUT, socket_name
from ..perturbations.kinds import ColourPerturbation
from ..scenes.blend_scene import CameraParameters, SampledCamera
from ..scenes.polygon_mesh import SceneObject
from .engines import ENGINES, enable_gpu, for_threads, set_properties
from .mesh_session import SENSOR_WIDTH_MM, add_camera, place_camera, set_intrinsics
from .source import RenderOptions

CONTROLLED = ("cycles.seed", "cycles.samples", "eevee.taa_render_samples", "render.use_motion_blur")
"""Properties of a scene that are set here, whatever animates them."""


def make_repeatable(scene: bpy.types.Scene, options: RenderOptions, *, sampled: bool, keep_compositor: bool) -> None:
    """Set what reproducibility asks for; engine, lights, world, view and visibility stay as they are.

    sampled: whether the preset gives the engine's samples. Raises MissingDependencyError where a GPU is asked for and
    none is found.
    """
    assert options.engine != "embree", "which is not Blender's"
    free_of_animation(scene, CONTROLLED)
    set_properties(
        scene,
        {
            "render.engine": ENGINES[options.engine].blender_name,
            "render.use_persistent_data": True,
            "render.use_sequencer": False,
            "render.use_compositing": keep_compositor,
            "render.compositor_device": "CPU",
            "render.dither_intensity": 0.0,
            "render.use_stamp": False,
            "render.use_border": False,
            **({"render.use_motion_blur": False} if options.instants else {}),
            **({"cycles.use_denoising": False} if options.read_lines else {}),
            **for_threads(options.threads),
        },
    )
    for marker in scene.timeline_markers:
        marker.camera = None  # the frames' cameras are known, and a render would look through the marker's
    if keep_compositor and scene.compositing_node_group is not None:
        _mute_files(scene.compositing_node_group)
    if not keep_compositor:
        _one_layer(scene)
    if sampled:
        for layer in scene.view_layers:
            layer.samples = 0  # the scene's own count
        ENGINES[options.engine].set_samples(scene, options.samples)
    _settle_cycles(scene, options)


def free_of_animation(block: bpy.types.ID, paths: tuple[str, ...]) -> None:
    """Take keyframes and drivers from properties of a block of the open file."""
    data = getattr(block, "animation_data", None)
    if data is None:
        return
    for curve in [curve for curve in data.drivers if curve.data_path in paths]:
        data.drivers.remove(curve)
    if data.action is None or data.action_slot is None:
        return
    data.action = data.action.copy()  # others may use it
    strips = (strip for layer in data.action.layers for strip in layer.strips)
    for strip in strips:
        if not isinstance(strip, bpy.types.ActionKeyframeStrip):
            continue
        for bag in strip.channelbags:
            for curve in [curve for curve in bag.fcurves if curve.data_path in paths]:
                bag.fcurves.remove(curve)


def _settle_cycles(scene: bpy.types.Scene, options: RenderOptions) -> None:
    set_properties(
        scene,
        {
            "cycles.device": "CPU",
            "cycles.seed": options.seed,
            "cycles.use_animated_seed": False,
            "cycles.time_limit": 0.0,
            "cycles.use_deterministic_guiding": True,
            "cycles.denoising_use_gpu": False,
        },
    )
    cycles = cycles_of(scene)
    if lacks_denoiser(scene):
        cycles.use_denoising = False
    elif cycles.use_denoising:
        cycles.denoiser = "OPENIMAGEDENOISE"
    if options.device == "gpu":
        enable_gpu()
        cycles.device = "GPU"


def lacks_denoiser(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene is to be denoised by a Blender that is built without OpenImageDenoise."""
    cycles = cycles_of(scene)
    with muted_output():  # Blender warns of what it does not know
        return cycles.use_denoising and cycles.denoiser == ""


def _one_layer(scene: bpy.types.Scene) -> None:
    """Render the first of the view layers that are rendered, alone."""
    first = rendered_layer(scene)
    for layer in scene.view_layers:
        layer.use = layer == first


def rendered_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """Return the first of a scene's view layers that are rendered; the first of all where none is."""
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


def _mute_files(tree: bpy.types.NodeTree) -> None:
    """Keep a compositor from writing files of its own."""
    for node in tree.nodes:
        if isinstance(node, bpy.types.CompositorNodeOutputFile):
            node.mute = True
        elif isinstance(node, bpy.types.CompositorNodeGroup) and node.node_tree is not None:
            _mute_files(node.node_tree)


# The camera of a scene of one's own: sampled frame by frame, through its parents, constraints and drivers.
#
# Nothing here changes what is open, but for the frame, which is given back.


def sampled_camera(scene: bpy.types.Scene, camera: bpy.types.Object | None, frames: Iterable[float]) -> SampledCamera:
    """Return a camera at some frames of a scene, which has to be a window's or have a view layer that is evaluated.

    camera: None for the scene's own, which markers may switch. Another one is made the scene's for each frame, as
    Blender evaluates what a view layer leaves out for the scene's camera and those of markers alone. The scene shows
    its own frame again in the end, and looks through its own camera.
    """
    asked = tuple(frames)
    before = (scene.frame_current, scene.frame_subframe, scene.camera)
    matrices, parameters = [], []
    try:
        for frame in asked:
            if camera is not None and scene.camera != camera:  # a marker may have switched it at the frame before
                scene.camera = camera
            show_frame(scene, frame)
            seen_by = camera or scene.camera
            assert seen_by is not None, "the scene has a camera"
            evaluated = seen_by.evaluated_get(_evaluated(scene))
            matrices.append(np.array(evaluated.matrix_world, dtype=np.float64))
            parameters.append(camera_parameters(scene, evaluated))
    finally:
        scene.frame_set(before[0], subframe=before[1])
        if scene.camera != before[2]:
            scene.camera = before[2]
    return SampledCamera(asked, np.array(matrices).reshape(-1, 4, 4), tuple(parameters))


def bound_cameras(scene: bpy.types.Scene) -> list[tuple[int, bpy.types.Object]]:
    """Return the cameras that the scene's markers bind, with the frames from which on, in their order.

    As in Blender, one that is not rendered binds nothing.
    """
    bound = ((marker.frame, marker.camera) for marker in scene.timeline_markers)
    return sorted(((at, item) for at, item in bound if item is not None and not item.hide_render), key=itemgetter(0))


def shots_at(scene: bpy.types.Scene, frames: Iterable[float]) -> NDArray[np.int64] | None:
    """Return the number of the bound camera that takes each frame (N,); None where markers bind fewer than two.

    Before the first marker the scene looks through its camera already, as in Blender.
    """
    bound = bound_cameras(scene)
    order = {item.name: number for number, item in enumerate(dict.fromkeys(item for _, item in bound))}
    if len(order) < 2:
        return None
    rows = np.searchsorted([frame for frame, _ in bound], list(frames), side="right") - 1
    return np.array([order[bound[max(row, 0)][1].name] for row in rows.tolist()], dtype=np.int64)


def show_frame(scene: bpy.types.Scene, frame: float) -> None:
    """Show a frame of a scene; between two whole ones, too."""
    whole = int(np.floor(frame))
    scene.frame_set(whole, subframe=float(frame) - whole)


def _evaluated(scene: bpy.types.Scene) -> bpy.types.Depsgraph:
    graph = scene.view_layers[0].depsgraph
    assert graph is not None
    return graph


@np.errstate(divide="ignore", invalid="ignore")
def camera_parameters(scene: bpy.types.Scene, camera: bpy.types.Object) -> CameraParameters:
    """Return how a camera sees in a scene's image, by Blender's own rule.

    The sensor's size is measured along the image's longer side, in units of square pixels, unless its fit says along
    which; an automatic fit takes the sensor's width along either. The shift is in units of that side.
    """
    data, render = camera_of(camera), scene.render
    width_px = render.resolution_x * render.resolution_percentage // 100
    height_px = render.resolution_y * render.resolution_percentage // 100
    # In numpy's numbers, as damaged files have zeros that no field takes; how much higher than wide a pixel is.
    aspect = float(np.float64(render.pixel_aspect_y) / render.pixel_aspect_x)
    wide = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width_px >= aspect * height_px)
    sensor_mm = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    side_px = width_px if wide else aspect * height_px
    fx_px = float(np.float64(data.lens * side_px) / sensor_mm)
    return CameraParameters(
        camera=camera.name,
        kind=data.type,
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=float(np.float64(fx_px) / aspect),
        cx_px=(width_px - 1) / 2 - data.shift_x * side_px,
        cy_px=(height_px - 1) / 2 + float(np.float64(data.shift_y * side_px) / aspect),
        near_m=data.clip_start,
        far_m=data.clip_end,
    )


def camera_alone(scene: bpy.types.Scene) -> None:
    """Take out of a scene what its cameras do not depend on, so that a frame is shown at once.

    A scene whose rigid bodies move keeps all, as they push each other.
    """
    if scene.rigidbody_world is not None:
        return
    for layer in scene.view_layers:
        root = layer.layer_collection
        assert root is not None
        for child in root.children:
            child.exclude = True
    for item in scene.collection.objects:
        if item.type != "CAMERA":
            item.hide_viewport = True


# The camera that looks at a scene of one's own: a copy of the artist's, put where the path says.


PLACED = ("lens", "sensor_width", "sensor_height", "sensor_fit", "shift_x", "shift_y", "clip_start", "clip_end", "type")


class RenderCamera:
    """A camera of a scene that sees with given intrinsics, and otherwise as an artist's camera does."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        model: bpy.types.Object | None,
        intrinsics: Intrinsics,
        options: RenderOptions,
        *,
        lens_given: bool,
        sample_offset_px: float,
        sharp: bool,
        image_width_px: int | None = None,
    ) -> None:
        """Add the camera.

        model: the artist's camera; None for a plain one. lens_given: whether the intrinsics are the preset's, rather
        than the model's own. sharp: whether everything is in focus, as for depth. image_width_px: of the image, where
        the intrinsics are those of a pinhole that sees more than it, and the sensor is so much wider.
        """
        self._scene = scene
        self._model = model
        self.camera = add_camera(scene, "Noisy World camera")
        sensor_mm, blurred = SENSOR_WIDTH_MM, False
        if model is not None:
            own = camera_of(model)
            # The lens stays, as the blur out of focus depends on it; the sensor's width follows.
            wider = 1.0 if image_width_px is None else intrinsics.width_px / image_width_px
            sensor_mm = own.sensor_width * wider if lens_given else own.lens * intrinsics.width_px / intrinsics.fx_px
            self.camera.data = own.copy()
            free_of_animation(camera_of(self.camera), PLACED)
            blurred = own.dof is not None and own.dof.use_dof and not sharp
        set_intrinsics(
            scene,
            self.camera,
            intrinsics,
            near_m=options.near_m,
            far_m=options.far_m,
            sample_offset_px=sample_offset_px,
            sensor_width_mm=sensor_mm,
            blurred=blurred,
        )

    def place(self, c2w: NDArray[np.float64]) -> None:
        """Look from a pose (4, 4), camera-to-world with OpenCV axes, metres."""
        place_camera(self._scene, self.camera, c2w)
        self._be_scenes()

    def move(self, poses: Mapping[float, NDArray[np.float64]]) -> None:
        """Look from poses (4, 4) at frames of the scene, from one to the next."""
        self.camera.animation_data_clear()
        self.camera.rotation_mode = "QUATERNION"
        for frame, c2w in poses.items():
            matrix = Matrix(blender_from_opencv_c2w(c2w).tolist())
            self.camera.location, self.camera.rotation_quaternion = matrix.to_translation(), matrix.to_quaternion()
            for path in ("location", "rotation_quaternion"):
                self.camera.keyframe_insert(path, frame=frame)
        self._be_scenes()

    def follow(self, c2w: NDArray[np.float64]) -> None:
        """Look from a pose at the frame that the scene shows, and move as the artist's camera does around it."""
        assert self._model is not None
        layer = self._scene.view_layers[0]
        if self.camera.parent != self._model:
            self.camera.parent = self._model
            self.camera.matrix_parent_inverse = Matrix.Identity(4)
            layer.update()  # only from now on is a model evaluated that the view layer leaves out
        assert layer.depsgraph is not None
        under = np.array(self._model.evaluated_get(layer.depsgraph).matrix_world, dtype=np.float64)
        self.camera.matrix_basis = Matrix((np.linalg.inv(under) @ blender_from_opencv_c2w(c2w)).tolist())
        self._be_scenes()

    def _be_scenes(self) -> None:
        if self._scene.camera != self.camera:  # setting it, even to what it is, makes Cycles take the scene over again
            self._scene.camera = self.camera


# Colour as a scene of one's own is shown: view transform, look, exposure and curves, as Blender applies them.


VIEW_VALUES = ("view_transform", "look", "exposure", "gamma", "use_curve_mapping", "use_white_balance")
WHITE_VALUES = ("white_balance_temperature", "white_balance_tint")


class ShownColour:
    """Encodes linear light for a scene's display, by saving it as an image of 16 bits.

    Blender has no other way to do that without a window. 16 bits are 1/257 of a step of 8 bits apart, so an image that
    is rounded to 8 bits afterwards differs from Blender's own at ties alone.
    """

    def __init__(self, scene: bpy.types.Scene, size_px: tuple[int, int], folder: Path) -> None:
        """Prepare. size_px: width, height. folder: where the file is written."""
        self._scene = scene
        self._path = folder / "colour.png"
        self._writer = scene.copy()  # a scene's view settings cannot be copied by themselves
        for child in list(self._writer.collection.children):
            self._writer.collection.children.unlink(child)
        for item in list(self._writer.collection.objects):
            self._writer.collection.objects.unlink(item)
        settings = self._writer.render.image_settings
        settings.media_type = "IMAGE"
        settings.file_format = "PNG"
        settings.color_mode = "RGB"
        settings.color_depth = "16"
        settings.compression = 0
        settings.color_management = "FOLLOW_SCENE"
        self._image = bpy.data.images.new("Noisy World colour", *size_px, alpha=True, float_buffer=True)
        self._image.alpha_mode = "PREMUL"

    def encode(self, rgba: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return linear light (H, W, 4), its colour multiplied by alpha, as display values (H, W, 3) in [0, 1].

        Raises StorageError where the scratch file could not be written.
        """
        import cv2  # needed only for rendering

        if self._scene.animation_data is not None:  # exposure, for instance, may be keyed
            self._follow()
        set_pixels(self._image, np.ascontiguousarray(rgba[::-1]))
        self._path.unlink(missing_ok=True)
        try:
            with muted_output():
                self._image.save_render(utf8_name(self._path), scene=self._writer)
        except RuntimeError as error:
            raise StorageError(f"Blender could not write its scratch file: {error}", file=self._path) from error
        bgr = read_pixels(self._path, cv2.IMREAD_UNCHANGED)
        if bgr is None or bgr.dtype != np.uint16:
            raise StorageError("Blender's scratch file is cut short or damaged", file=self._path)
        return np.ascontiguousarray(bgr[..., ::-1]).astype(np.float32) / np.float32(65535)

    def _follow(self) -> None:
        shown, own = self._scene.view_settings, self._writer.view_settings
        assert shown is not None
        assert own is not None
        for name in (*VIEW_VALUES, *WHITE_VALUES):
            if getattr(own, name) != getattr(shown, name):
                setattr(own, name, getattr(shown, name))


# The objects of a scene of one's own, numbered alike by the inspection and the renderer.


_UNNAMED = re.compile(r"Collection([ .][0-9]+)?")  # as Blender names new ones
WITH_SURFACE = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD")


def numbered_objects(blocks: Iterable[bpy.types.ID]) -> tuple[SceneObject, ...]:
    """Return the objects with a surface among the data-blocks of a scene, those of libraries too, in order."""
    return tuple(
        SceneObject(number, item.name_full, item.pass_index, _category(item)) for number, item in _numbered(blocks)
    )


def _category(item: bpy.types.Object) -> str:
    """Return an object's class: its custom property `class`, or its first collection that has a name of its own."""
    given = item.get("class")
    if isinstance(given, str | int) and str(given).strip():
        return str(given).strip()
    own = (found for found in item.users_collection if bpy.data.collections.get(found.name) == found)
    names = sorted(found.name for found in own if not _UNNAMED.fullmatch(found.name))
    return names[0] if names else ""


def show_numbers(blocks: Iterable[bpy.types.ID]) -> None:
    """Give each object its number as its pass index. What is an instance of an object has its number."""
    for number, item in _numbered(blocks):
        free_of_animation(item, ("pass_index",))
        item.pass_index = number


def _numbered(blocks: Iterable[bpy.types.ID]) -> Iterable[tuple[int, bpy.types.Object]]:
    found = [block for block in blocks if isinstance(block, bpy.types.Object) and block.type in WITH_SURFACE]
    return enumerate(sorted(found, key=lambda item: item.name_full), 1)


# Keys on groups in an artist's own compositor: how the camera moves, and values told for each frame.


Place: TypeAlias = tuple[bpy.types.NodeTree, bpy.types.NodeGroup | Any]
"""A tree, and a node of it that shows one of our groups."""

_NAMES = {VELOCITY_INPUT.name, TURNING_INPUT.name}
STILL = 1e-6  # metres or radians a second; what moves less is at rest


def keyable(scene: bpy.types.Scene) -> list[Place]:
    """Return the group nodes of a scene's compositor that ask how the camera moves.

    Those inside groups of the user's own are among them; the chain that the panel keys itself is not.
    """
    tree = scene.compositing_node_group
    return [] if tree is None else [place for place in groups_within(tree) if set(place[1].inputs.keys()) >= _NAMES]


def groups_within(tree: bpy.types.NodeTree) -> list[Place]:
    """Return the nodes of our groups in a tree and in groups of the user's own inside it; not the panel's chain."""
    return list(_within(tree, {tree.session_uid}))


def _within(tree: bpy.types.NodeTree, seen: set[int]) -> Iterator[Place]:
    for node in tree.nodes:
        group = getattr(node, "node_tree", None)
        if group is None:
            continue
        if STAMP in group and BUILT_AS not in group:
            yield tree, node
        elif STAMP not in group and BUILT_AS not in group and group.library is None and group.session_uid not in seen:
            seen.add(group.session_uid)
            yield from _within(group, seen)


def key_motion(scene: bpy.types.Scene) -> list[str]:
    """Key how the scene's camera moves in all these groups; return the names of their nodes.

    Velocity and turning, which no driver knows, are keyed over the scene's frames, as means since the frame before; a
    path that changes later asks for keying again. Where markers bind several cameras, they are of the one that sees the
    frame, and none flies from one to the next. Sockets that a user has linked or driven stay as they are.
    """
    camera, places, frames = scene.camera, keyable(scene), range(scene.frame_start, scene.frame_end + 1)
    assert camera is not None, "the scene has a camera"
    sampled = sampled_camera(scene, None if has_several_cameras(scene) else camera, frames)
    keyed = _velocities(sampled, scene.render.fps / scene.render.fps_base)
    for tree, node in places:
        for name, values in keyed.items():
            if not _is_taken(tree, node.inputs[name]):
                _key(tree, node.inputs[name], frames, values)
    return [node.label or node.name for _, node in places]


def has_several_cameras(scene: bpy.types.Scene) -> bool:
    """Tell whether markers bind more than one camera, so that they take turns."""
    return len({item.name for _, item in bound_cameras(scene)}) > 1


def _is_taken(tree: bpy.types.NodeTree, socket: Any) -> bool:
    drivers = () if tree.animation_data is None else tree.animation_data.drivers
    return socket.is_linked or socket.path_from_id("default_value") in {curve.data_path for curve in drivers}


def _turns(sampled: SampledCamera) -> NDArray[np.float64]:
    """Return the rotations (frames, 3, 3) of a camera in the world."""
    axes = sampled.matrices[:, :3, :3]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _velocities(sampled: SampledCamera, rate_hz: float) -> dict[str, NDArray[np.float64]]:
    """Return by socket (frames, 3): velocity in the world, m/s, and turning about the camera's axes, rad/s."""
    places_m, turns = sampled.matrices[:, :3, 3], _turns(sampled)
    velocity, turning = np.zeros_like(places_m), np.zeros_like(places_m)
    velocity[1:] = np.diff(places_m, axis=0) * rate_hz
    turning[1:] = [rotvec_from_rotation(a.T @ b) * rate_hz for a, b in pairwise(turns)]
    if sampled.shots is not None:  # no camera flies from one shot to the next
        cut = np.flatnonzero(np.diff(sampled.shots)) + 1
        velocity[cut] = turning[cut] = 0
    return {VELOCITY_INPUT.name: velocity, TURNING_INPUT.name: turning}


def _key(tree: bpy.types.NodeTree, socket: Any, frames: range, values: NDArray[np.float64]) -> None:
    """Key vectors (frames, 3) where they change; what does not is set."""
    clear_keys(tree, [socket.path_from_id("default_value")])
    rows = [tuple(row) for row in values.tolist()]
    set_value(socket, rows[0])
    if np.ptp(values, axis=0).max() > STILL:
        key_socket(tree, socket, list(zip(frames, rows, strict=True)))
    drop_empty_action(tree)


# Keys on groups in an artist's own compositor that are told a value for each frame, such as auto-exposure's stops.


BAKED = "noisy_world_baked"  # of a tree: the keys that were baked, [frame, value] by their sockets' paths, as JSON
CONSTANT = 1e-6  # stops or turns; what changes less is set, not keyed


@dataclass(frozen=True)
class ToldGroup:
    """A group node that is told values for each frame. place: its tree and the node."""

    place: Place
    perturbation: ColourPerturbation

    @property
    def name(self) -> str:
        """What the node is called."""
        _, node = self.place
        return node.label or node.name


def told_groups(own: bpy.types.NodeTree | None, by_group: Mapping[str, ColourPerturbation]) -> list[ToldGroup]:
    """Return the group nodes of a scene's own compositing that have sockets for values of each frame.

    by_group: those perturbations, by the name of their group. Groups inside groups of the user's own are among them, in
    the order in which the compositor has them.
    """
    found: list[ToldGroup] = []
    for tree, node in [] if own is None else groups_within(own):
        group: Any = node.node_tree
        if (perturbation := by_group.get(described_as(group))) is not None:
            found.append(ToldGroup((tree, node), perturbation))
    return found


def bake(group: ToldGroup, frames: range, values: Mapping[str, Sequence[float]]) -> list[str]:
    """Key a group's sockets over scene frames; return the names of those that stay as an artist has set them up.

    values: of each frame, by the perturbation's name for them. What an earlier call keyed is keyed anew, unless it was
    changed since; sockets that are linked, driven or keyed otherwise stay.
    """
    tree, node = group.place
    baked: dict[str, Any] = json.loads(tree.get(BAKED, "{}"))
    left: list[str] = []
    for name, each in values.items():
        socket: Any = node.inputs[socket_name(group.perturbation, name)]
        path = socket.path_from_id("default_value")
        if socket.is_linked or _is_own(tree, path, baked.get(path)):
            left.append(f"{group.name} > {socket.name}")
            continue
        clear_keys(tree, [path])
        numbers = np.array(each, np.float32)
        set_value(socket, float(numbers[0]))
        baked.pop(path, None)
        if np.ptp(numbers) > CONSTANT:
            key_socket(tree, socket, list(zip(frames, numbers.tolist(), strict=True)))
            baked[path] = _keys(tree, path).tolist()
    drop_empty_action(tree)
    tree[BAKED] = json.dumps(baked)
    return left


def _is_own(tree: bpy.types.NodeTree, path: str, baked: Any) -> bool:
    """Tell whether a socket is driven, or has keys that are not those that were baked."""
    data = tree.animation_data
    if data is None:
        return False
    if any(curve.data_path == path for curve in data.drivers):
        return True
    keys = _keys(tree, path)
    return len(keys) > 0 and keys.tolist() != baked


def _keys(tree: bpy.types.NodeTree, path: str) -> NDArray[np.float64]:
    """Return (N, 2) frame and value of a socket's keys."""
    data = tree.animation_data
    curves = [] if data is None else [curve for curve in fcurves_of(data) if curve.data_path == path]
    return np.array([point.co[:] for curve in curves for point in curve.keyframe_points], np.float64).reshape(-1, 2)
