# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups on scene-linear frames, as an artist has them behind a render: for pictures, films and previews."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.scratch_images import muted_output, write_plain_floats
from noisy_world.blender.typed import (
    inputs,
    new_node,
    new_tree,
    outputs,
    override_scene,
    set_pixels,
    set_value,
    use_as_data,
)
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.node_graphs.chain import capacity_of, shown_values
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.earlier_frames import EarlierFrame, small_of
from noisy_world.core.perturbing.kinds import ColourPerturbation, FrameContext
from noisy_world.core.perturbing.steps import Step
from noisy_world.core.scratch import ScratchFolder
from tools.street.frames import LitFrame

SEED = 1
SKY_M = 1e10  # what a render's Depth pass has where nothing is
FLOATS = 16  # bytes of a pixel
Linear: TypeAlias = NDArray[np.float32]
ColourStep: TypeAlias = Step[ColourPerturbation]


class LitScene:
    """A scene that renders nothing: a frame with its depth as images, and what nodes behind them make of it."""

    def __init__(self, size_px: tuple[int, int], results: int, sky_m: float = SKY_M) -> None:
        """Add the scene to the file. size_px: width, height; results: how many images it makes; sky_m: void's depth."""
        self._sky_m = np.float32(sky_m)
        self._scratch = ScratchFolder(FLOATS * size_px[0] * size_px[1] * results)
        self._images = [_float_image(name, size_px) for name in ("Lit frame", "Lit depth")]
        self.tree = new_tree("Lit frame")
        self.rgb, self.depth_m = (self._shown(image) for image in self._images)
        self._scene = bpy.data.scenes.new("Lit frame")
        self._scene.compositing_node_group = self.tree
        render = self._scene.render
        render.resolution_x, render.resolution_y = size_px
        render.compositor_device, render.compositor_precision = "CPU", "FULL"

    def _shown(self, image: bpy.types.Image) -> bpy.types.NodeSocket:
        node = new_node(self.tree, bpy.types.CompositorNodeImage)
        node.image = image
        return outputs(node)["Image"]

    def write(self, results: Sequence[bpy.types.NodeSocket]) -> None:
        """Say which sockets are the results."""
        file = new_node(self.tree, bpy.types.CompositorNodeOutputFile)
        file.directory, file.file_name = str(self._scratch.path), "lit"
        file.save_as_render = False
        assert file.format is not None
        write_plain_floats(file.format)
        for number, socket in enumerate(results):
            file.file_output_items.new("VECTOR", f"{number:03}")
            self.tree.links.new(socket, inputs(file)[number])

    def run(self, frame: LitFrame, now: int = 0) -> list[Linear]:
        """Return the results (H, W, 3), float32, scene-linear. now: the scene's frame, which keys are looked up at."""
        self._scene.frame_set(now)
        _fill(self._images[0], frame.rgb)
        _fill(self._images[1], np.where(frame.depth_m > 0, frame.depth_m, self._sky_m)[..., None])
        path = self._scratch.path / "lit.exr"
        path.unlink(missing_ok=True)
        with muted_output(), override_scene(self._scene):
            bpy.ops.render.render()
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: item.pixels for name, item in file.channels().items()}
        count = len(channels) // 3
        return [np.stack([channels[f"{number:03}.{axis}"] for axis in "XYZ"], axis=-1) for number in range(count)]

    def close(self) -> None:
        """Remove what was added to the file, but for the groups."""
        bpy.data.scenes.remove(self._scene)
        bpy.data.node_groups.remove(self.tree)
        bpy.data.batch_remove(self._images)
        self._scratch.remove()

    def __enter__(self) -> "LitScene":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def perturbed(
    frame: LitFrame,
    index: int,
    steps: Mapping[str, ColourStep],
    reference_widths_px: Mapping[str, int],
    camera: Intrinsics,
) -> dict[str, Linear]:
    """Return what steps make of a frame of a film, each by itself: (H, W, 3) float32, scene-linear.

    steps: by names of one's choice; reference_widths_px: by the same names, the width of the frame that sizes in pixels
    refer to. camera: of the frame; it stands still, and its automatics have seen this frame for long.
    """
    seen = (EarlierFrame(0.0, small_of(frame.rgb)),)
    with LitScene((camera.width_px, camera.height_px), len(steps)) as scene:
        nodes = []
        for name, step in steps.items():
            node = new_node(scene.tree, bpy.types.CompositorNodeGroup)
            node.node_tree = ensure_group(build_group(step.perturbation, capacity_of(step)))
            where = FrameContext(index, (SEED, "street", name), stamp_s=0.0, read_earlier=lambda _span_s: seen)
            values = shown_values(step, index, where.identifiers, intrinsics=camera, decided=step.context(where))
            for socket, value in (values | {"Reference Width": reference_widths_px[name]}).items():
                set_value(node.inputs[socket], value)
            for socket, source in (("Image", scene.rgb), ("Depth", scene.depth_m)):
                if socket in node.inputs:
                    scene.tree.links.new(source, node.inputs[socket])
            nodes.append(node)
        scene.write([node.outputs["Image"] for node in nodes])
        return dict(zip(steps, scene.run(frame), strict=True))


def shown(linear: Linear) -> NDArray[np.uint8]:
    """Return scene-linear light as the bytes of a picture, by sRGB's curve; what is brighter than white is white."""
    light = np.clip(linear, 0.0, 1.0)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255).astype(np.uint8)


def _float_image(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    image = bpy.data.images.new(name, *size_px, alpha=False, float_buffer=True)
    use_as_data(image)
    return image


def _fill(image: bpy.types.Image, values: Linear) -> None:
    rgba = np.ones((*values.shape[:2], 4), dtype=np.float32)
    rgba[..., :3] = values[::-1]
    set_pixels(image, rgba)
