# SPDX-License-Identifier: GPL-3.0-or-later
"""A session on a scene of a .blend: frames as its artist set it up, and their depth, from any pose."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels import SurfaceImages
from ..channels.channel import Fact, Surface
from ..channels.passes import NAME as PASSES
from ..channels.passes import passes_image
from ..core.camera_motion import travel_px
from ..core.errors import InputError
from ..core.frame_request import AT_ONCE, FrameRequest, SensorPaths, Shutter
from ..core.geometry import Intrinsics
from ..core.lens import Bending, Distortion, overscanned
from ..nodes.datablocks import camera_of, get_value, inputs
from ..nodes.datablocks import cycles as cycles_of
from ..perturbations.groups import BRIGHTEST
from ..scenes.sun_air import SunAir
from .engines import (
    BYTES_PER_PIXEL,
    CENTRE_FILTER_PX,
    FILTER_MIDDLE,
    PLAIN_CYCLES,
    Band,
    RenderFile,
    bands_of,
    behind_lens,
    joined,
    set_properties,
    whole,
    without_void,
)
from .mirror_scene import MIRRORED_NAMES, MIRRORED_PASSES, MirrorScene, mirrored_share
from .own_view import (
    CONTROLLED,
    RenderCamera,
    ShownColour,
    free_of_animation,
    make_repeatable,
    numbered_objects,
    rendered_layer,
    show_frame,
    show_numbers,
)
from .scene_dependencies import blocks_of
from .scene_inspection import open_file, show_scene
from .source import Motion, RenderedFrame, RenderOptions, SceneLight, surfaces_bent
from .sun_lamps import softened, suns_of

# Depth of a scene of one's own, rendered apart from colour: one ray through each pixel's centre, whatever the engine.
#
# The scene is a copy that shows the same objects, so that setting it up costs colour's renderer nothing.


# Smoke, fog and the like in a scene of one's own: rays end in them by chance, so depth is rendered without.


class Removable:
    """Links to a socket of materials' outputs, which can be taken away for a while: rays go on straight."""

    def __init__(self, outputs: Iterable[tuple[bpy.types.NodeTree, bpy.types.Node]], socket: str) -> None:
        """Keep them. outputs: with the nodes that each is among. socket: what is linked to it is taken away."""
        self._outputs = list(outputs)
        self._socket = socket

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self._outputs)

    @contextmanager
    def gone(self) -> Iterator[None]:
        """Take them away; what is nothing else is as good as not there."""
        given = self.remove()
        try:
            yield
        finally:
            for (tree, output), (source, clear) in zip(self._outputs, given, strict=True):
                if clear is not None:
                    tree.nodes.remove(clear)
                tree.links.new(source, inputs(output)[self._socket])

    def remove(self) -> list[tuple[bpy.types.NodeSocket, bpy.types.Node | None]]:
        """Take them away for good; return what each came from, and what stands for a surface where there is none."""
        return [self._without(tree, output) for tree, output in self._outputs]

    def _without(
        self, tree: bpy.types.NodeTree, output: bpy.types.Node
    ) -> tuple[bpy.types.NodeSocket, bpy.types.Node | None]:
        links = inputs(output)[self._socket].links
        assert links
        source = links[0].from_socket
        assert source is not None
        tree.links.remove(links[0])
        if inputs(output)["Surface"].is_linked:
            return source, None
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        tree.links.new(clear.outputs[0], inputs(output)["Surface"])
        return source, clear


def volumes_of(blocks: Iterable[bpy.types.ID]) -> Removable:
    """Return smoke, fog and the like among the data-blocks of a scene: rays end in them by chance."""
    return Removable((each for each in _outputs(blocks) if inputs(each[1])["Volume"].is_linked), "Volume")


def panes_of(blocks: Iterable[bpy.types.ID]) -> Removable:
    """Return what is glass among the data-blocks of a scene: what is seen through it counts for weather.

    It is a glass or refraction shader, or a principled one that lets more light through than not.
    """
    return Removable((each for each in _outputs(blocks) if _is_glass(_shader(each[1]))), "Surface")


def _outputs(blocks: Iterable[bpy.types.ID]) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    for tree in _shader_trees(blocks):
        for node in tree.nodes:
            if isinstance(node, bpy.types.ShaderNodeOutputMaterial):
                yield tree, node


def _shader_trees(blocks: Iterable[bpy.types.ID]) -> list[bpy.types.NodeTree]:
    """Return the nodes of the materials, and the groups of shader nodes, among some data-blocks."""
    found = [block.node_tree if isinstance(block, bpy.types.Material) else block for block in blocks]
    return [tree for tree in found if isinstance(tree, bpy.types.ShaderNodeTree)]


GLASS = ("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction")
MOST_OPAQUE = 0.5  # a surface that lets through more of the light is a pane; chosen


def _shader(output: bpy.types.Node) -> bpy.types.Node | None:
    """Return the shader of a material's surface; of a mixture, the first that is glass."""
    waiting, seen = [output], set[bpy.types.Node]()
    found = None
    while waiting:
        node = waiting.pop()
        for socket in node.inputs:
            if socket.type != "SHADER" or (node == output and socket.name != "Surface"):
                continue
            for link in socket.links or ():
                source = link.from_node
                if source is not None and source not in seen:
                    seen.add(source)
                    waiting.append(source)
                    found = source if found is None or _is_glass(source) else found
    return found


def _is_glass(node: bpy.types.Node | None) -> bool:
    if node is None:
        return False
    if node.bl_idname in GLASS:
        return True
    passes = node.inputs.get("Transmission Weight") if node.bl_idname == "ShaderNodeBsdfPrincipled" else None
    return passes is not None and not passes.is_linked and get_value(passes) > MOST_OPAQUE


MOST_STRETCHED = 900  # Blender's own limit
MOST_LOOKS = (
    16  # of a frame with see-through surfaces; half opaque ones are all gone through then, but for 2 pixels in 1e5
)


TRANSPARENT = ("ShaderNodeBsdfTransparent", "ShaderNodeScript", "ShaderNodeEeveeSpecular")


class DepthScene:
    """A linked copy of a scene that Cycles renders with one sample for depth alone."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        intrinsics: Intrinsics,
        options: RenderOptions,
        *,
        alpha: float,
        masked: bool,
        facts: frozenset[Fact] = frozenset(),
        moving: bool = False,
        panes: Removable | None = None,
    ) -> None:
        """Copy the scene.

        alpha: what is less opaque does not stop depth. masked: whether anything may be. facts: what of the surface is
        told beside depth. moving: whether it tells how what is seen moves, which takes a scene of its own. panes: what
        depth goes through, too.
        """
        self._scene = copy = scene.copy()
        self._masked = masked
        volumes = volumes_of(blocks_of(scene))
        self._hidden = [] if panes is None else [panes]
        if options.rgb:
            self._hidden.append(volumes)
        else:  # nobody sees them
            volumes.remove()
        free_of_animation(copy, CONTROLLED)
        set_properties(
            copy,
            {
                "render.engine": "CYCLES",
                "render.use_compositing": False,
                "render.use_motion_blur": False,
                "render.use_freestyle": False,
                "world": None,
                **PLAIN_CYCLES,
                "cycles.samples": 1,
                "cycles.use_sample_subset": False,
                "cycles.filter_width": CENTRE_FILTER_PX,
            },
        )
        self._layer = layer = rendered_layer(copy)
        for item in copy.view_layers:
            item.use = item == layer
        only_depth(layer)
        layer.use_pass_normal = "normals" in facts
        layer.use_pass_object_index = "objects" in facts
        layer.use_pass_vector = moving
        self._facts = facts
        layer.samples = 0
        layer.pass_alpha_threshold = alpha
        offset_px = FILTER_MIDDLE * CENTRE_FILTER_PX
        self._camera = RenderCamera(
            copy, None, intrinsics, options, lens_given=True, sample_offset_px=offset_px, sharp=True
        )
        self._far_m = options.far_m
        self._file = RenderFile(copy, (intrinsics.width_px, intrinsics.height_px))

    def render(self, c2w: NDArray[np.float64], frame: float) -> tuple[NDArray[np.float32], Surface]:
        """Return the depth (H, W) at a pose and a frame of the scene, in metres, 0 is void, and what else it tells."""
        passes = self._passes(c2w, frame)
        depth_m = without_void(passes["Depth.Z"], self._far_m)
        normals = objects = None
        if "normals" in self._facts:
            world = np.stack([passes[f"Normal.{name}"] for name in "XYZ"], axis=-1)
            normals = (np.where(depth_m[..., None] > 0, world, 0) @ c2w[:3, :3]).astype(np.float32)
        if "objects" in self._facts:
            objects = np.where(depth_m > 0, passes["Object Index.X"], 0).astype(np.uint16)
        return depth_m, Surface(normals, objects=objects)

    def read(
        self,
        bands: Sequence[Band],
        seen_from: Callable[[Band], tuple[NDArray[np.float64], float]],
        bending: Bending | None = None,
    ) -> NDArray[np.float32]:
        """Return the depth (H, W) of a frame whose lines are read one after another, each planar along its own axis.

        seen_from: gives the pose at which a band is seen, and the frame of the scene. bending: of the lens whose lines
        they are.
        """
        size_px = self._file.size_px if bending is None else (bending.camera.width_px, bending.camera.height_px)

        def passes_of(band: Band) -> dict[str, NDArray[np.float32]]:
            needed, part = behind_lens(band, bending)
            depth_m = without_void(self._passes(*seen_from(band), needed)["Depth.Z"], self._far_m)
            return {"Depth.Z": depth_m if part is None else part.depth_m(depth_m)}

        return joined(bands, size_px, passes_of)["Depth.Z"]

    def _passes(
        self, c2w: NDArray[np.float64], frame: float, band: Band | None = None
    ) -> dict[str, NDArray[np.float32]]:
        set_frame(self._scene, frame)
        self._camera.place(c2w)
        return self._seen(band)

    def motion(
        self, here_c2w: NDArray[np.float64], here: float, there_c2w: NDArray[np.float64], there: float
    ) -> NDArray[np.float32]:
        """Return (H, W, 2): how far what each pixel's centre sees at a pose and a frame is from it at another, pixels.

        Cycles tells where things are a frame before and after, so as many frames as there are between become one.
        """
        between = _near_fraction(abs(there - here))
        self._scene.render.frame_map_old, self._scene.render.frame_map_new = between.numerator, between.denominator
        set_frame(self._scene, here / float(between))
        self._camera.move({here: here_c2w, there: there_c2w})
        passes = self._seen()
        if there > here:
            return np.stack([-passes["Vector.Z"], passes["Vector.W"]], axis=-1)
        return np.stack([passes["Vector.X"], -passes["Vector.Y"]], axis=-1)

    def _seen(self, band: Band | None = None) -> dict[str, NDArray[np.float32]]:
        with ExitStack() as hidden:
            for each in self._hidden:
                hidden.enter_context(each.gone())
            return self._through(band) if self._masked else self._once(0, band)

    def _once(self, seed: int, band: Band | None = None) -> dict[str, NDArray[np.float32]]:
        cycles = cycles_of(self._scene)
        if cycles.seed != seed:
            cycles.seed = seed
            self._scene.update_tag()  # the seed alone would not tell the renderer
        return self._file.render(self._layer.name, band=band)

    def _through(self, band: Band | None = None) -> dict[str, NDArray[np.float32]]:
        """Return the first surface of each pixel that always stops a ray.

        At a surface that is less opaque than the threshold, chance decides whether Cycles' ray goes on, so the farthest
        of several looks is taken, until two show nothing new.
        """
        farthest, unchanged = self._once(0, band), 0
        for seed in range(1, MOST_LOOKS):
            seen = self._once(seed, band)
            farther = seen["Depth.Z"] > farthest["Depth.Z"]
            unchanged = 0 if farther.any() else unchanged + 1
            farthest = {name: np.where(farther, seen[name], pixels) for name, pixels in farthest.items()}
            if unchanged == 2:
                break
        return farthest

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()


def _near_fraction(frames: float) -> Fraction:
    """Return how many frames are between two as a fraction that a scene's time can be stretched by."""
    whole = Fraction(frames)
    small = whole.limit_denominator(max(1, int(MOST_STRETCHED / max(1.0, frames))))
    return small if small and small.numerator <= MOST_STRETCHED else Fraction(round(frames) or 1)


def set_frame(scene: bpy.types.Scene, frame: float) -> None:
    """Let a scene's next render show a frame, between two whole ones too; the renderer evaluates it."""
    whole = int(np.floor(frame))
    scene.frame_current = whole
    scene.frame_subframe = float(frame) - whole


def only_depth(layer: bpy.types.ViewLayer) -> None:
    """Turn off every pass of a view layer but Z."""
    for item in layer.bl_rna.properties:
        if item.identifier.startswith("use_pass_") and getattr(layer, item.identifier):
            setattr(layer, item.identifier, False)
    layer.use_pass_z = True


def may_be_seen_through(blocks: tuple[bpy.types.ID, ...]) -> bool:
    """Tell whether a material among the data-blocks of a scene may let a camera's ray go on straight, or some of them.

    That of a volume alone does so always, and leaves nothing to chance.
    """
    return any(_transparent(node) for tree in _shader_trees(blocks) for node in tree.nodes)


def _transparent(node: bpy.types.Node) -> bool:
    if node.bl_idname in TRANSPARENT:
        return True
    alpha = node.inputs.get("Alpha") if node.bl_idname == "ShaderNodeBsdfPrincipled" else None
    return alpha is not None and (alpha.is_linked or get_value(alpha) < 1.0)


BYTES_WITH_PASSES = 400  # of a pixel in the scratch file; chosen: a hundred channels
KEPT_TEXTS = ("cryptomatte/", "BlenderMultiChannel", "colorInteropID")
"""How texts of a render's header begin that say what is in it, and not when and how fast it was made."""

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
    not stop depth. sun_air: what softens its sun lamps, in memory alone; None where nothing does. mirrors: whether
    frames tell what their surfaces mirror, where what acts on colour looks at depth.
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
    sun_air: SunAir | None = None
    mirrors: bool = False

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
        passes = PASSES in options.channels
        if passes:  # they are those of colour's render
            options = replace(options, channels=options.channels | {"rgb"})
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
        mirrors = file.mirrors and options.through_glass and options.rgb
        self._mirror = MirrorScene(scene, intrinsics, options, _outputs(blocks), blocks) if mirrors else None
        self._colour = (
            _Colour(scene, file, intrinsics, options, together, bending=self._bending, passes=passes, mirrors=mirrors)
            if options.rgb
            else None
        )
        self._passes = passes
        self._softened = ExitStack()
        if file.sun_air is not None:
            self._softened.enter_context(softened(suns_of(blocks), file.sun_air))

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
        passes_asked = self._passes and request.looks_at(PASSES)
        if self._colour is not None and (passes_asked or request.looks_at("rgb") or (depth_asked and not self._apart)):
            rgb, depth_m, light = self._colour.render(request)
            others |= {PASSES: self._colour.passes} if passes_asked else {}
        at = self._file.at(request.time_s)[0]
        if self._mirror is not None and self._colour is not None and light is not None:
            mirrored = self._mirror.render(request.rgb_c2w, at, self._colour.mirrored)
            light = replace(
                light, mirrored=mirrored if self._bending is None else mirrored.changed(self._bending.nearest)
            )
        if self._depth is not None and self._images.needs:
            seen_m, surface = self._depth.render(request.rgb_c2w, at)
            others |= self._images.of(surface)
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
        """Remove the scratch files, and give sun lamps their own light back."""
        self._softened.close()
        glance = None if self._glance is self._depth else self._glance
        for part in (self._colour, self._depth, self._motion, self._seen, self._mirror, glance):
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
        depth: bool,
        *,
        bending: Bending | None,
        passes: bool = False,
        mirrors: bool = False,
    ) -> None:
        """Prepare it. depth: whether it gives depth too. bending: of light, whose pinhole the intrinsics are.

        passes: whether it tells all passes that the scene's layer has, and Cryptomatte of objects and materials.
        mirrors: whether it tells how much of its light is mirrored.
        """
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
        layer.use_pass_z = depth or (passes and layer.use_pass_z)
        if passes:
            layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = True
        added = [name for name in MIRRORED_PASSES if mirrors and not getattr(layer, name)]
        for name in added:
            setattr(layer, name, True)
        self._prefix = f"{layer.name}."
        unasked = (name for flag, name in zip(MIRRORED_PASSES, MIRRORED_NAMES, strict=True) if flag in added)
        self._unasked = tuple(f"{self._prefix}{name}." for name in (*unasked, "Render Time"))
        self._seen: dict[str, NDArray[np.float32]] = {}  # the passes of the last frame, where mirrors are told
        self._tells_mirrors = mirrors
        self._layer = COMPOSITE if file.keep_compositor else layer.name
        size_px = (intrinsics.width_px, intrinsics.height_px)
        self._render = RenderFile(scene, size_px, BYTES_WITH_PASSES if passes or mirrors else BYTES_PER_PIXEL)
        self._render.keep_all = passes
        seen_by = intrinsics if bending is None else bending.camera
        self._shown = ShownColour(scene, (seen_by.width_px, seen_by.height_px), self._render.folder)

    def render(self, request: FrameRequest) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, SceneLight]:
        """Return colour (H, W, 3), display-encoded; depth (H, W) in metres or None; and colour before the display."""
        passes = self._passes(request)
        self._seen = passes if self._tells_mirrors else {}
        return self._made(passes)

    @property
    def passes(self) -> NDArray[np.uint8]:
        """The passes of the frame that was rendered last, as their channel's image."""
        channels, texts = self._render.last
        # No two renders agree in the time that they took.
        own = (name for name in channels if name.startswith(self._prefix) and not name.startswith(self._unasked))
        layer = {name: channels[name] for name in own}
        attributes = {name: text for name, text in texts.items() if name.startswith(KEPT_TEXTS)}
        return passes_image(layer, attributes)

    @property
    def mirrored(self) -> NDArray[np.float32]:
        """The share (H, W, 3) of the light of the frame that was rendered last that its surfaces mirror."""
        return mirrored_share(self._seen)

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
