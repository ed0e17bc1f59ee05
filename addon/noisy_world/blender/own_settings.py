# SPDX-License-Identifier: GPL-3.0-or-later
"""The artist's settings that are overridden, so that a frame's bytes depend on the request alone."""

import bpy

from ..core.planning.source import RenderOptions
from .engines import ENGINES, enable_gpu
from .scratch_images import muted_output
from .typed import cycles as cycles_of

BLENDER_NAMES = {"cycles": "CYCLES", "eevee": "BLENDER_EEVEE", "workbench": "BLENDER_WORKBENCH"}
CONTROLLED = ("cycles.seed", "cycles.samples", "eevee.taa_render_samples", "render.use_motion_blur")
"""Properties of a scene that are set here, whatever animates them."""


def make_repeatable(scene: bpy.types.Scene, options: RenderOptions, *, sampled: bool, keep_compositor: bool) -> None:
    """Set what reproducibility asks for; engine, lights, world, view and visibility stay as they are.

    sampled: whether the preset gives the engine's samples. Raises MissingDependencyError where a GPU is asked for and
    none is found.
    """
    assert options.engine != "embree", "which is not Blender's"
    free_of_animation(scene, CONTROLLED)
    render = scene.render
    render.engine = BLENDER_NAMES[options.engine]  # pyright: ignore[reportAttributeAccessIssue]  the stubs know one
    render.use_persistent_data = True
    render.use_sequencer = False
    render.use_compositing = keep_compositor
    render.compositor_device = "CPU"
    render.dither_intensity = 0.0
    render.use_stamp = False
    render.use_border = False
    if options.instants:
        render.use_motion_blur = False
    if options.read_lines:
        cycles_of(scene).use_denoising = False
    render.threads_mode = "FIXED" if options.threads else "AUTO"
    if options.threads:
        render.threads = options.threads
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
    cycles = cycles_of(scene)
    cycles.device = "CPU"
    cycles.seed = options.seed
    cycles.use_animated_seed = False
    cycles.time_limit = 0.0
    cycles.use_deterministic_guiding = True
    cycles.denoising_use_gpu = False
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
