# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of a scene of one's own, rendered apart from colour: one ray through each pixel's centre, whatever the engine.

The scene is a copy that shows the same objects, so that setting it up costs colour's renderer nothing.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction

import bpy
import numpy as np
from numpy.typing import NDArray

from ..channels.channel import Fact, Surface
from ..core.geometry import Intrinsics
from ..core.lens import Bending
from ..nodes.datablocks import cycles as cycles_of
from ..nodes.datablocks import get_value, inputs
from .engines import (
    CENTRE_FILTER_PX,
    FILTER_MIDDLE,
    PLAIN_CYCLES,
    Band,
    RenderFile,
    behind_lens,
    joined,
    set_properties,
    without_void,
)
from .own_view import CONTROLLED, RenderCamera, free_of_animation, rendered_layer
from .scene_dependencies import blocks_of
from .source import RenderOptions

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
