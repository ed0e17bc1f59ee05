# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups on scene-linear frames, as an artist has them behind a render: for pictures, films and previews."""

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.render import muted_output
from noisy_world.blender.scratch_images import write_plain_floats
from noisy_world.blender.typed import inputs, new_node, new_tree, override, set_pixels, set_value, use_as_data
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.node_graphs.chain import capacity_of, socket_values
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.core.perturbing.steps import Step
from noisy_world.core.scratch import ScratchFolder
from tools.street.frames import LitFrame

SEED = 1
SKY_M = 1e10  # what a render's Depth pass has where nothing is
FLOATS = 16  # bytes of a pixel
type Linear = NDArray[np.float32]
type ColourStep = Step[ColourPerturbation]


class LitCompositor:
    """Steps of colour, each a group node of its own on the same frame; linear light comes in and goes out."""

    def __init__(
        self,
        size_px: tuple[int, int],
        steps: Mapping[str, ColourStep],
        reference_widths_px: Mapping[str, int],
        camera: Intrinsics,
    ) -> None:
        """Build the groups.

        size_px: width, height. steps: by names of one's choice; reference_widths_px: by the same names, the width of
        the frame that sizes in pixels refer to. camera: of the frames.
        """
        self._steps = dict(steps)
        self._camera = camera
        self._scratch = ScratchFolder(FLOATS * size_px[0] * size_px[1] * len(steps))
        self._rgb, self._depth = (_float_image(name, size_px) for name in ("Lit frame", "Lit depth"))
        self._tree = new_tree("Lit frame")
        self._nodes = {name: self._node(step, reference_widths_px[name]) for name, step in steps.items()}
        self._scene = bpy.data.scenes.new("Lit frame")
        self._scene.compositing_node_group = self._tree
        render = self._scene.render
        render.resolution_x, render.resolution_y = size_px
        render.compositor_device, render.compositor_precision = "CPU", "FULL"
        self._write()

    def _node(self, step: ColourStep, reference_width_px: int) -> bpy.types.CompositorNodeGroup:
        tree = self._tree
        node = new_node(tree, bpy.types.CompositorNodeGroup)
        node.node_tree = ensure_group(build_group(step.perturbation, capacity_of(step)))
        set_value(node.inputs["Reference Width"], reference_width_px)
        for name, image in (("Image", self._rgb), ("Depth", self._depth)):
            if name in node.inputs:
                shown = new_node(tree, bpy.types.CompositorNodeImage)
                shown.image = image
                tree.links.new(shown.outputs["Image"], node.inputs[name])
        return node

    def _write(self) -> None:
        file = new_node(self._tree, bpy.types.CompositorNodeOutputFile)
        file.directory, file.file_name = str(self._scratch.path), "lit"
        file.save_as_render = False
        assert file.format is not None
        write_plain_floats(file.format)
        for number, node in enumerate(self._nodes.values()):
            file.file_output_items.new("VECTOR", f"{number:03}")
            self._tree.links.new(node.outputs["Image"], inputs(file)[number])

    def perturb(self, frame: LitFrame, index: int) -> dict[str, Linear]:
        """Return what each step makes of a frame of the film: (H, W, 3) float32, scene-linear."""
        for name, step in self._steps.items():
            values, _ = socket_values(step, index, (SEED, "street", name), intrinsics=self._camera)
            for socket, value in values.items():
                set_value(self._nodes[name].inputs[socket], value)
        _fill(self._rgb, frame.rgb)
        _fill(self._depth, np.where(frame.depth_m > 0, frame.depth_m, np.float32(SKY_M))[..., None])
        path = self._scratch.path / "lit.exr"
        path.unlink(missing_ok=True)
        with muted_output(), override(scene=self._scene):
            bpy.ops.render.render()
        return dict(zip(self._steps, _layers(path, len(self._steps)), strict=True))

    def close(self) -> None:
        """Remove what was added to the file, but for the groups."""
        bpy.data.scenes.remove(self._scene)
        bpy.data.node_groups.remove(self._tree)
        bpy.data.images.remove(self._rgb)
        bpy.data.images.remove(self._depth)
        self._scratch.remove()

    def __enter__(self) -> "LitCompositor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def shown(linear: Linear) -> NDArray[np.uint8]:
    """Return scene-linear light as the bytes of a picture, by sRGB's curve; what is brighter than white is white."""
    light = np.clip(linear, 0.0, 1.0)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255).astype(np.uint8)


def _layers(path: Path, count: int) -> list[Linear]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: item.pixels for name, item in file.channels().items()}
    return [np.stack([channels[f"{number:03}.{axis}"] for axis in "XYZ"], axis=-1) for number in range(count)]


def _float_image(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    image = bpy.data.images.new(name, *size_px, alpha=False, float_buffer=True)
    use_as_data(image)
    return image


def _fill(image: bpy.types.Image, values: Linear) -> None:
    rgba = np.ones((*values.shape[:2], 4), dtype=np.float32)
    rgba[..., :3] = values[::-1]
    set_pixels(image, rgba)
