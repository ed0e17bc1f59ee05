# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh in Blender that shows exactly its colours, unlit, rendered from any pose."""

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels import SurfaceImages
from ..channels.channel import Surface
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics, blender_from_opencv_c2w, continuous_quats, quat_wxyz_from_rotation
from ..core.srgb import exact_light
from ..core.trajectory import recentring_m
from ..nodes.datablocks import (
    camera_of,
    cycles,
    emptied_action,
    inputs,
    interpolation,
    new_node,
    node_tree,
    outputs,
    set_pixels,
    set_value,
    size_px,
    use_as_data,
)
from ..scenes.polygon_mesh import NEUTRAL_GREY, Mesh, Texture
from .engines import (
    ENGINES,
    FACE_ATTRIBUTE,
    FACE_OUTPUT,
    FACE_STEP,
    Device,
    EngineName,
    FrameRenderer,
    configure,
    enable_gpu,
    gl_version,
    show_textures,
)
from .source import RenderedFrame, RenderOptions

# Unlit materials: the colours of a mesh's vertices, corners or texture as emission.


COLOUR_ATTRIBUTE = "Col"
UV_ATTRIBUTE = "UVMap"
MATERIAL = "Noisy World vertex colours"
TEXTURE_MATERIAL = "Noisy World texture"

_Operation: TypeAlias = Literal["POWER", "MULTIPLY_ADD", "MULTIPLY", "CEIL", "SUBTRACT", "FLOOR"]
_Operand: TypeAlias = bpy.types.NodeSocket | float | tuple[float, float, float]


def vertex_colour_material(*, decode_colours: bool) -> bpy.types.Material:
    """Build the unlit material: the colour attribute, interpolated as stored, as emission.

    decode_colours: True emits linear light (IEC 61966-2-1), which a view transform and the averaging of several samples
    need. False emits the display-encoded values themselves, which is exact for a single sample and a fifth faster.
    """
    name = MATERIAL if decode_colours else f"{MATERIAL} (encoded)"
    material, tree = _empty_material(name)
    attribute = new_node(tree, bpy.types.ShaderNodeAttribute)
    attribute.attribute_name = COLOUR_ATTRIBUTE
    _emit(material, tree, outputs(attribute)["Color"], decode_colours=decode_colours)
    return material


def texture_material(image: bpy.types.Image, *, decode_colours: bool, by_texels: bool) -> bpy.types.Material:
    """Build the unlit material of an image: its colours, interpolated as stored, as emission.

    decode_colours: as of vertex_colour_material. by_texels: whether nodes interpolate between the four texels around a
    point; if not, the engine does.
    """
    material, tree = _empty_material(f"{TEXTURE_MATERIAL} {image.name}")
    if by_texels:
        colour = _interpolated(tree, image)
    else:
        texture = _image_node(tree, image, "Linear")
        tree.nodes.active = texture  # Workbench shows the active image
        colour = outputs(texture)["Color"]
    _emit(material, tree, colour, decode_colours=decode_colours)
    return material


def _image_node(
    tree: bpy.types.NodeTree, image: bpy.types.Image, interpolation: Literal["Linear", "Closest"]
) -> bpy.types.ShaderNodeTexImage:
    node = new_node(tree, bpy.types.ShaderNodeTexImage)
    node.image = image
    node.interpolation = interpolation
    node.extension = "REPEAT"
    return node


def _interpolated(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.NodeSocket:
    """Add the nodes that interpolate linearly between texels, whose centres are at whole numbers and a half."""
    width, height = size_px(image)
    place = new_node(tree, bpy.types.ShaderNodeUVMap)
    place.uv_map = UV_ATTRIBUTE
    texels = _vector_math(tree, "MULTIPLY_ADD", outputs(place)["UV"], (width, height, 1.0), (-0.5, -0.5, 0.0))
    corner = _vector_math(tree, "FLOOR", texels)
    across = new_node(tree, bpy.types.ShaderNodeSeparateXYZ)
    tree.links.new(_vector_math(tree, "SUBTRACT", texels, corner), inputs(across)["Vector"])

    def texel(column: int, row: int) -> bpy.types.NodeSocket:
        scale, middle = (1 / width, 1 / height, 1.0), ((column + 0.5) / width, (row + 0.5) / height, 0.0)
        node = _image_node(tree, image, "Closest")
        tree.links.new(_vector_math(tree, "MULTIPLY_ADD", corner, scale, middle), inputs(node)["Vector"])
        return outputs(node)["Color"]

    def between(first: _Operand, second: _Operand, share: _Operand) -> bpy.types.NodeSocket:
        return _vector_math(tree, "MULTIPLY_ADD", _vector_math(tree, "SUBTRACT", second, first), share, first)

    lower, upper = (between(texel(0, row), texel(1, row), outputs(across)["X"]) for row in (0, 1))
    return between(lower, upper, outputs(across)["Y"])


def new_image(name: str, rgb: NDArray[np.uint8], *, decoded: bool) -> bpy.types.Image:
    """Make an image of (H, W, 3) uint8, display-encoded, the top row first.

    decoded: whether Blender converts it to linear light where it is read; if not, its bytes are taken as they are.
    """
    height, width = rgb.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=False)
    if not decoded:
        use_as_data(image)
    rgba = np.full((height, width, 4), 255, dtype=np.uint8)
    for channel in range(3):  # one by one: all at once takes four times as long
        rgba[..., channel] = rgb[::-1, :, channel]
    set_pixels(image, np.divide(rgba, np.float32(255), dtype=np.float32))
    return image


def tell_attribute(material: bpy.types.Material, attribute: str, name: str) -> None:
    """Let a material write an attribute of three numbers, as it is, into the pass of a name."""
    tree = node_tree(material)
    attribute_node = new_node(tree, bpy.types.ShaderNodeAttribute)
    attribute_node.attribute_name = attribute
    into = new_node(tree, bpy.types.ShaderNodeOutputAOV)
    into.aov_name = name
    tree.links.new(outputs(attribute_node)["Vector"], inputs(into)["Color"])


def _empty_material(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    material = bpy.data.materials.new(name)
    tree = node_tree(material)
    tree.nodes.clear()
    return material, tree


def _emit(
    material: bpy.types.Material, tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket, *, decode_colours: bool
) -> None:
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    if decode_colours:
        colour = _linear_from_srgb(tree, colour)
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    _spread(tree)
    # Nothing is lit here, and preparing two million emissive triangles as lights takes seconds.
    cycles(material).emission_sampling = "NONE"


def _vector_math(tree: bpy.types.NodeTree, operation: _Operation, *operands: _Operand) -> bpy.types.NodeSocket:
    """Add a node that calculates by component; a single number stands for three."""
    node = new_node(tree, bpy.types.ShaderNodeVectorMath)
    node.operation = operation
    for socket, operand in zip(inputs(node), operands, strict=False):
        if isinstance(operand, bpy.types.NodeSocket):
            tree.links.new(operand, socket)
        else:
            set_value(socket, operand if isinstance(operand, tuple) else (operand,) * 3)
    return outputs(node)["Vector"]


def _linear_from_srgb(tree: bpy.types.NodeTree, encoded: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Add the nodes that decode sRGB (IEC 61966-2-1), by component: linear up to 0.04045, a power above."""

    power = _vector_math(tree, "POWER", _vector_math(tree, "MULTIPLY_ADD", encoded, 1 / 1.055, 0.055 / 1.055), 2.4)
    line = _vector_math(tree, "MULTIPLY", encoded, 1 / 12.92)
    # Colours are in [0, 1], so the ceiling of the difference is 0 up to the threshold and 1 above it.
    above = _vector_math(tree, "CEIL", _vector_math(tree, "SUBTRACT", encoded, 0.04045))
    return _vector_math(tree, "MULTIPLY_ADD", _vector_math(tree, "SUBTRACT", power, line), above, line)


def _spread(tree: bpy.types.NodeTree) -> None:
    for column, node in enumerate(tree.nodes):
        node.location = (200.0 * column, 0.0)


# A mesh as a Blender object that shows exactly its colours, unlit.


ORIGIN_PROPERTY = "noisy_world_origin_m"
Domain: TypeAlias = Literal["POINT", "CORNER"]
"""What of a mesh has colours, in Blender's words."""
Decoding: TypeAlias = Literal["none", "shader", "attribute"]
"""Where display-encoded colours are converted to linear light: nowhere, in the material, or before they are stored."""


def empty_scene() -> bpy.types.Scene:
    """Start from Blender's own startup file with nothing in it, so that no setting of the user affects a pixel."""
    # Not read_factory_settings: it disables extensions too, and Blender then deletes their packages from the profile.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    # Vertex colours are display values already, so no filmic curve may change them.
    scene.view_settings.view_transform = "Standard"
    scene.render.dither_intensity = 0.0
    return scene


def set_origin(scene: bpy.types.Scene, origin_m: NDArray[np.float64]) -> None:
    """Store which point of the world (3,) float64, metres, is at Blender's origin.

    Blender computes in float32, whose spacing is 1 mm at 10 km, so a scene far away is rendered around this point.
    Custom properties are float64.
    """
    scene[ORIGIN_PROPERTY] = [float(value) for value in origin_m]


def get_origin(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, set by set_origin; the world's own origin where none was set."""
    return np.array(scene.get(ORIGIN_PROPERTY, (0.0, 0.0, 0.0)), dtype=np.float64)


def add_mesh(
    scene: bpy.types.Scene, mesh: Mesh, name: str, *, decoding: Decoding, by_texels: bool = False
) -> bpy.types.Object:
    """Link the mesh to the scene, moved so that the scene's origin (set_origin) is Blender's.

    by_texels: whether the material interpolates between a texture's texels, rather than the engine.
    """
    data = bpy.data.meshes.new(name)
    vertices_m = (mesh.vertices_m - get_origin(scene)).astype(np.float32)
    # Attributes copy an array of their own type at once; the vertices' "co" and the loops' "vertex_index" take it value
    # by value, a second for a million.
    data.vertices.add(len(vertices_m))
    _set_attribute(data.attributes["position"], "vector", vertices_m.ravel())
    data.loops.add(len(mesh.corner_vertices))
    _set_attribute(data.attributes[".corner_vert"], "value", np.ascontiguousarray(mesh.corner_vertices, np.int32))
    data.polygons.add(len(mesh.face_starts))
    data.polygons.foreach_set("loop_start", mesh.face_starts)
    data.update(calc_edges=True)
    _add_colours(data, mesh, decoded=decoding == "attribute")
    material = vertex_colour_material(decode_colours=decoding == "shader")
    grey = NEUTRAL_GREY if decoding == "none" else float(exact_light(np.float64(NEUTRAL_GREY)))
    rgba: Any = (grey, grey, grey, 1.0)
    material.diffuse_color = rgba  # of the faces that Workbench shows beside textures
    data.materials.append(material)
    if mesh.texture is not None:
        _add_texture(data, mesh.texture, decoding, by_texels=by_texels)
    result = bpy.data.objects.new(name, data)
    scene.collection.objects.link(result)
    return result


def tell_faces(shown: bpy.types.Object) -> None:
    """Let the materials of a mesh's object write each face's number into FACE_OUTPUT, in two parts, and a 1."""
    data = shown.data
    assert isinstance(data, bpy.types.Mesh)
    numbers = np.arange(len(data.polygons), dtype=np.int64)
    parts = np.stack([numbers % FACE_STEP, numbers // FACE_STEP, np.ones_like(numbers)], axis=1).astype(np.float32)
    _set_attribute(data.attributes.new(FACE_ATTRIBUTE, "FLOAT_VECTOR", "FACE"), "vector", parts.ravel())
    for material in data.materials:
        assert material is not None
        tell_attribute(material, FACE_ATTRIBUTE, FACE_OUTPUT)


def rgba_of(mesh: Mesh) -> tuple[Domain, NDArray[np.float32]]:
    """Return whether colours are those of vertices or of corners, and these (N, 4); grey where there are none."""
    rgb = mesh.rgb if mesh.corner_rgb is None else mesh.corner_rgb
    rgba = np.ones((len(mesh.vertices_m if mesh.corner_rgb is None else mesh.corner_rgb), 4), dtype=np.float32)
    rgba[:, :3] = NEUTRAL_GREY if rgb is None else rgb
    return "POINT" if mesh.corner_rgb is None else "CORNER", rgba


def _add_texture(data: bpy.types.Mesh, texture: Texture, decoding: Decoding, *, by_texels: bool) -> None:
    """Give each picture a material after that of the vertices' colours, and the faces with a picture its material."""
    layer = data.attributes.new(UV_ATTRIBUTE, "FLOAT2", "CORNER")
    _set_attribute(layer, "vector", np.ascontiguousarray(texture.corner_uv, np.float32).ravel())
    slots = data.attributes.new("material_index", "INT", "FACE")
    _set_attribute(slots, "value", np.ascontiguousarray(texture.face_pictures + 1, np.int32))
    for name, picture in zip(texture.names, texture.pictures, strict=True):
        image = new_image(name, picture, decoded=decoding == "attribute")
        decode = decoding == "shader"
        data.materials.append(texture_material(image, decode_colours=decode, by_texels=by_texels))


def _add_colours(data: bpy.types.Mesh, mesh: Mesh, *, decoded: bool) -> None:
    domain, rgba = rgba_of(mesh)
    if decoded:
        rgba[:, :3] = exact_light(rgba[:, :3])
    # FLOAT_COLOR keeps the display-encoded values. BYTE_COLOR would be decoded before it is interpolated, and colours
    # between vertices would differ from what other viewers of such files show.
    attribute = data.color_attributes.new(COLOUR_ATTRIBUTE, "FLOAT_COLOR", domain)
    _set_attribute(attribute, "color", rgba.ravel())
    data.color_attributes.active_color = attribute
    data.color_attributes.render_color_index = data.color_attributes.active_color_index or 0


def _set_attribute(attribute: bpy.types.Attribute, field: str, values: NDArray[np.float32] | NDArray[np.int32]) -> None:
    kinds = (
        bpy.types.FloatVectorAttribute,
        bpy.types.FloatColorAttribute,
        bpy.types.IntAttribute,
        bpy.types.Float2Attribute,
    )
    assert isinstance(attribute, kinds)
    attribute.data.foreach_set(field, values)


# Pinhole intrinsics on a Blender camera, and trajectories as its keyframes.


SENSOR_WIDTH_MM = 36.0  # Blender's default; only its ratio to the focal length matters
SMALLEST_PX = 4  # the smallest width and height that Blender renders


def add_camera(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    """Link a camera whose rotation is a quaternion, and make it the scene's if the scene has none."""
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    camera.rotation_mode = "QUATERNION"
    scene.collection.objects.link(camera)
    if scene.camera is None:
        scene.camera = camera
    return camera


def set_intrinsics(
    scene: bpy.types.Scene,
    camera: bpy.types.Object,
    intrinsics: Intrinsics,
    *,
    near_m: float,
    far_m: float,
    sample_offset_px: float = 0.0,
    sensor_width_mm: float = SENSOR_WIDTH_MM,
    blurred: bool = False,
) -> None:
    """Give the camera and the scene's image the intrinsics; depth outside [near_m, far_m] is void.

    Blender measures its shift from the image's centre, in image widths; with integer coordinates at pixel centres, the
    image's centre is (width - 1) / 2. fx != fy becomes a pixel aspect, which Blender allows from 1 up. An image smaller
    than Blender's smallest is rendered larger, to the right and below. sample_offset_px: by how much the renderer's
    rays miss the pixel's centre, to the right and up; the shift compensates it. sensor_width_mm: decides the lens'
    length, and thereby what is out of focus. blurred: whether that is shown as it is.
    """
    width_px = max(intrinsics.width_px, SMALLEST_PX)
    height_px = max(intrinsics.height_px, SMALLEST_PX)
    scene.render.resolution_x = width_px
    scene.render.resolution_y = height_px
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    aspect = intrinsics.fx_px / intrinsics.fy_px
    scene.render.pixel_aspect_x = max(1.0, 1.0 / aspect)
    scene.render.pixel_aspect_y = max(1.0, aspect)
    data = camera_of(camera)
    data.type = "PERSP"
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = sensor_width_mm
    data.lens_unit = "MILLIMETERS"
    data.lens = intrinsics.fx_px * sensor_width_mm / width_px
    data.shift_x = ((width_px - 1) / 2 - intrinsics.cx_px - sample_offset_px) / width_px
    data.shift_y = (intrinsics.cy_px - (height_px - 1) / 2 - sample_offset_px) * aspect / width_px
    data.clip_start = near_m
    data.clip_end = far_m
    assert data.dof is not None
    data.dof.use_dof = blurred


def place_camera(scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64]) -> None:
    """Set a camera's pose (4, 4), camera-to-world with OpenCV axes, metres."""
    blender_c2w = blender_from_opencv_c2w(c2w)
    camera.location = (blender_c2w[:3, 3] - get_origin(scene)).tolist()
    camera.rotation_quaternion = quat_wxyz_from_rotation(blender_c2w[:3, :3]).tolist()


def key_trajectory(
    scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64], *, first_frame: int = 0
) -> None:
    """Key the poses (N, 4, 4), camera-to-world with OpenCV axes, metres, at consecutive scene frames.

    The scene's range becomes theirs.
    """
    key_poses(scene, camera, c2w, np.arange(first_frame, first_frame + len(c2w)))
    scene.frame_start = first_frame
    scene.frame_end = first_frame + len(c2w) - 1


def key_poses(scene: bpy.types.Scene, camera: bpy.types.Object, c2w: NDArray[np.float64], frames: NDArray[Any]) -> None:
    """Key the poses (N, 4, 4), camera-to-world with OpenCV axes, metres, at scene frames (N,).

    Quaternion signs are continuous, so that Blender interpolates between two keys along the shorter arc.
    """
    blender_c2w = blender_from_opencv_c2w(c2w)
    location_m = blender_c2w[:, :3, 3] - get_origin(scene)
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(blender_c2w[:, :3, :3]))
    action = emptied_action(camera, f"{camera.name} trajectory")
    for path, values in (("location", location_m), ("rotation_quaternion", quat_wxyz)):
        for index, column in enumerate(values.T):
            curve = action.fcurve_ensure_for_datablock(camera, path, index=index)
            _set_keys(curve, frames, column)


def _set_keys(curve: bpy.types.FCurve, frames: NDArray[Any], values: NDArray[np.float64]) -> None:
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack([frames, values], axis=1).astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(frames), interpolation("LINEAR"), dtype=np.int32))
    curve.update()


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
