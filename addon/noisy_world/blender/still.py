# SPDX-License-Identifier: GPL-3.0-or-later
"""Single frames of the user's scene, rendered as the generator would; the scene itself is not changed."""

from collections.abc import Sequence

import bpy

from ..core.planning.source import RenderedFrame
from .engines import ENGINES, configure
from .render import FrameRenderer
from .typed import override_scene

SCENE = "Noisy World still"


def render_stills(
    scene: bpy.types.Scene, frames: Sequence[int], *, empty: bool = False, longest_px: int | None = None
) -> list[RenderedFrame]:
    """Render colour and depth of scene frames through the scene's camera, with Cycles and one sample.

    empty: whether nothing is seen where there is no surface, as in a mesh's dataset; by default the world is.
    longest_px: of the longer side, at most; by default as many as the scene has.

    Render options are changed only in a copy of the scene, which shares its objects and is removed afterwards. Raises
    StorageError where no scratch file can be written.
    """
    stand_in = scene.copy()
    stand_in.name = SCENE
    try:
        _configure(stand_in)
        if longest_px is not None:
            _shrink(stand_in.render, longest_px)
        if empty:
            stand_in.world = None
        size_px = stand_in.render.resolution_x, stand_in.render.resolution_y
        renderer = FrameRenderer(stand_in, size_px, rgb=True, depth=True, encoded_colours=False)
        try:
            return [_render(renderer, stand_in, frame) for frame in frames]
        finally:
            renderer.close()
    finally:
        bpy.data.scenes.remove(stand_in)


def _configure(scene: bpy.types.Scene) -> None:
    scene.compositing_node_group = None
    configure(scene, ENGINES["cycles"], seed=0, samples=1, threads=0)
    ENGINES["cycles"].set_samples(scene, 1)
    scene.render.use_persistent_data = False
    scene.render.use_multiview = False
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    for layer in list(scene.view_layers)[1:]:
        layer.use = False


def _shrink(render: bpy.types.RenderSettings, longest_px: int) -> None:
    scale = min(1.0, longest_px / max(render.resolution_x, render.resolution_y))
    render.resolution_x = max(1, round(render.resolution_x * scale))
    render.resolution_y = max(1, round(render.resolution_y * scale))


def _render(renderer: FrameRenderer, scene: bpy.types.Scene, frame: int) -> RenderedFrame:
    # Not by the operator's own argument, which would render the active scene's frame.
    with override_scene(scene):
        scene.frame_set(frame)
        return renderer.render()
