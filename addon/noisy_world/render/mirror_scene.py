# SPDX-License-Identifier: GPL-3.0-or-later
"""What water, wet floors and mirrors of a scene of one's own show: how far behind them it is, and how much of it.

The scene is a copy that shows the same objects. While it is rendered, a surface that a glossy ray meets shines by that
ray's length, and no lamp is mirrored, so that the pass of glossy light is the mean length of the rays which a surface
mirrors: by its own roughness, waves and bumps.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.mirrored import Mirrored
from ..nodes.datablocks import cycles as cycles_of
from ..nodes.datablocks import inputs, outputs, set_value
from .engines import RenderFile, set_properties
from .own_view import CONTROLLED, RenderCamera, free_of_animation, rendered_layer
from .source import RenderOptions

ShaderOutput = tuple[bpy.types.NodeTree, bpy.types.Node]

SAMPLES = 16  # of a pixel; chosen: a mean of lengths needs fewer than light does
BYTES = 60  # of a pixel in the scratch file


class MirrorScene:
    """A linked copy of a scene in which Cycles finds how far behind surfaces is what they mirror."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        intrinsics: Intrinsics,
        options: RenderOptions,
        shaders: Iterable[ShaderOutput],
        blocks: Sequence[bpy.types.ID],
    ) -> None:
        """Copy the scene. shaders: the outputs of all materials. blocks: of the scene, with its materials and lamps."""
        self._scene = copy = scene.copy()
        self._shaders = [item for item in shaders if inputs(item[1])["Surface"].is_linked]
        self._materials = [block for block in blocks if isinstance(block, bpy.types.Material)]
        self._lamps = [block for block in blocks if isinstance(block, bpy.types.Object) and block.type == "LIGHT"]
        free_of_animation(copy, CONTROLLED)
        set_properties(copy, {**_SETTINGS, "world": _sky(), "cycles.filter_width": cycles_of(scene).filter_width})
        self._layer = layer = rendered_layer(copy)
        for item in copy.view_layers:
            item.use = item == layer
        for item in layer.bl_rna.properties:
            if item.identifier.startswith("use_pass_"):
                setattr(layer, item.identifier, item.identifier in _NEEDED)
        layer.samples = 0
        self._camera = RenderCamera(copy, None, intrinsics, options, lens_given=True, sample_offset_px=0.0, sharp=True)
        self._file = RenderFile(copy, (intrinsics.width_px, intrinsics.height_px), BYTES)

    def render(self, c2w: NDArray[np.float64], frame: float, share: NDArray[np.float32]) -> Mirrored:
        """Return what is mirrored at a pose and a frame of the scene. share: of the frame's light, (H, W, 3)."""
        self._scene.frame_current = int(np.floor(frame))
        self._scene.frame_subframe = float(frame) - np.floor(frame)
        self._camera.place(c2w)
        with ExitStack() as changed:
            changed.enter_context(_lengths_shine(self._shaders))
            changed.enter_context(_unsampled(self._materials))
            changed.enter_context(_unmirrored(self._lamps))
            passes = self._file.render(self._layer.name)
        length_m, surface, all_seen = np.moveaxis(_image(passes, "Glossy Direct"), -1, 0)
        colour = _image(passes, "Glossy Color")
        known = np.maximum(all_seen, np.float32(1e-6))
        sky = np.clip(1 - surface / known, 0, 1)
        distance_m = length_m / np.maximum(surface, np.float32(1e-6))
        return Mirrored(share, colour * np.minimum(all_seen, 1)[..., None], distance_m, sky)

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()


_SETTINGS: Mapping[str, Any] = {
    "render.engine": "CYCLES",
    "render.use_compositing": False,
    "render.use_motion_blur": False,
    "render.use_freestyle": False,
    "cycles.use_adaptive_sampling": False,
    "cycles.use_denoising": False,
    "cycles.use_sample_subset": False,
    "cycles.samples": SAMPLES,
    "cycles.max_bounces": 1,
    "cycles.diffuse_bounces": 0,
    "cycles.glossy_bounces": 1,
    "cycles.transmission_bounces": 0,
    "cycles.volume_bounces": 0,
    "cycles.sample_clamp_direct": 0.0,
    "cycles.sample_clamp_indirect": 0.0,
    "cycles.film_exposure": 1.0,
}
_NEEDED = ("use_pass_glossy_direct", "use_pass_glossy_color")


def _sky() -> bpy.types.World:
    """Return a world that counts as seen, at no length."""
    world = bpy.data.worlds.new("Noisy World mirrored sky")
    assert world.node_tree is not None
    nodes = world.node_tree.nodes
    nodes.clear()
    background, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    set_value(inputs(background)["Color"], (0.0, 0.0, 1.0, 1.0))
    world.node_tree.links.new(background.outputs[0], inputs(output)["Surface"])
    cycles_of(world).sampling_method = "NONE"
    return world


@contextmanager
def _lengths_shine(shaders: Sequence[ShaderOutput]) -> Iterator[None]:
    """Let each surface shine by the length of a glossy ray that meets it: that, 1 and 1 as red, green and blue."""
    added = []
    try:
        for tree, output in shaders:
            socket = inputs(output)["Surface"]
            assert socket.links
            source = socket.links[0].from_socket
            assert source is not None
            kinds = ("ShaderNodeLightPath", "ShaderNodeCombineColor", "ShaderNodeEmission", "ShaderNodeMixShader")
            path, colour, emission, mix = made = [tree.nodes.new(kind) for kind in kinds]
            added.append((tree, output, source, made))
            for name in ("Green", "Blue"):
                set_value(inputs(colour)[name], 1.0)
            for end, begin in (
                (inputs(colour)["Red"], outputs(path)["Ray Length"]),
                (inputs(emission)["Color"], colour.outputs[0]),
                (mix.inputs[0], outputs(path)["Is Glossy Ray"]),
                (mix.inputs[1], source),
                (mix.inputs[2], emission.outputs[0]),
                (socket, mix.outputs[0]),
            ):
                tree.links.new(begin, end)
        yield
    finally:
        for tree, output, source, made in added:
            for node in made:
                tree.nodes.remove(node)
            tree.links.new(source, inputs(output)["Surface"])


@contextmanager
def _unsampled(materials: Sequence[bpy.types.Material]) -> Iterator[None]:
    """Let no surface be taken for a lamp, which would make a large mesh as many lamps as it has triangles."""
    own = [(cycles_of(item), cycles_of(item).emission_sampling) for item in materials]
    try:
        for settings, _ in own:
            settings.emission_sampling = "NONE"
        yield
    finally:
        for settings, sampling in own:
            settings.emission_sampling = sampling


@contextmanager
def _unmirrored(lamps: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Let no surface mirror a lamp: the ray goes on to what is behind it."""
    own = [(lamp, lamp.visible_glossy) for lamp in lamps]
    try:
        for lamp, _ in own:
            lamp.visible_glossy = False
        yield
    finally:
        for lamp, seen in own:
            lamp.visible_glossy = seen


# What colour's own render tells: how much of its light is mirrored.


MIRRORED_PASSES = ("use_pass_glossy_direct", "use_pass_glossy_indirect", "use_pass_glossy_color")
MIRRORED_NAMES = ("Glossy Direct", "Glossy Indirect", "Glossy Color")
BEFORE_DENOISING = "Noisy Image"


def mirrored_share(passes: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the share (H, W, 3) of a frame's light that surfaces mirror, of passes by their names and channels.

    It is a share of the light before it was denoised, which has the same noise, so it fits that which was denoised too.
    """
    whole = BEFORE_DENOISING if f"{BEFORE_DENOISING}.R" in passes else "Combined"
    direct, indirect, colour, light = (_image(passes, name) for name in (*MIRRORED_NAMES, whole))
    share = (direct + indirect) * colour / np.maximum(light, np.float32(1e-9))
    return np.asarray(np.clip(share, 0, 1), np.float32)


def _image(passes: Mapping[str, NDArray[np.float32]], name: str) -> NDArray[np.float32]:
    return np.stack([passes[f"{name}.{channel}"] for channel in "RGB"], axis=-1)
