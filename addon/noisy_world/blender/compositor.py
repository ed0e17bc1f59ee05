# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluating node groups on arrays: one upload of a frame, one evaluation, an image for each setting."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.datasets.images import rgb_bytes
from ..core.errors import StorageError
from ..core.node_graphs.chain import build_chain, is_active, socket_values, step_node
from ..core.perturbing.kinds import ColourPerturbation, Identifiers
from ..core.perturbing.steps import Step
from ..core.scratch import ScratchFolder
from .nodes import ensure_group, remove_group
from .render import muted_output
from .typed import group_of, inputs, new_node, new_tree, override, set_pixels, set_value, use_as_data

SCENE = "Noisy World compositor"
FILES_PER_CALL = 16  # images of float colour; chosen, so that memory does not grow with the number of settings
BYTES_PER_PIXEL = 12  # three channels of float32
LAYER = "s"


class Compositor:
    """Evaluates chains of node groups on given frames, in a separate scene that renders nothing.

    The user's scenes and their colour management are not touched: results leave the compositor as float values.
    """

    def __init__(
        self,
        size_px: tuple[int, int],
        chains: Mapping[str, Sequence[Step[ColourPerturbation]]],
        reference_width_px: int,
    ) -> None:
        """Build the chains.

        size_px: width, height of the frames. chains: steps of colour by the chain's name.
        reference_width_px: the width to which parameters in pixels refer.
        """
        # Blender treats an image of one pixel as a single value and writes no file for it, so two equal pixels are
        # used.
        self._one_pixel = size_px == (1, 1)
        self._size_px = size_px = (2, 1) if self._one_pixel else size_px
        self._chains = {name: tuple(steps) for name, steps in chains.items()}
        self._needs_depth = any(step.perturbation.needs_depth for steps in chains.values() for step in steps)
        self._scratch = ScratchFolder(BYTES_PER_PIXEL * size_px[0] * size_px[1] * min(len(chains), FILES_PER_CALL))
        self._folder = self._scratch.path
        self._scene = bpy.data.scenes.new(SCENE)
        self._tree = new_tree(SCENE)
        self._rgba = np.ones((size_px[1], size_px[0], 4), dtype=np.float32)
        self._image = _float_image("Noisy World frame", size_px)
        self._depth_image = _float_image("Noisy World depth", size_px) if self._needs_depth else None
        self._configure()
        self._nodes: dict[str, bpy.types.CompositorNodeGroup] = {}
        self._files: dict[str, bpy.types.CompositorNodeOutputFile] = {}
        self._wire(reference_width_px)

    def _configure(self) -> None:
        scene = self._scene
        scene.compositing_node_group = self._tree
        render = scene.render
        render.resolution_x, render.resolution_y = self._size_px
        render.resolution_percentage = 100
        render.use_compositing = True
        render.use_sequencer = False
        render.compositor_device = "CPU"
        render.compositor_precision = "FULL"

    def _wire(self, reference_width_px: int) -> None:
        """Link the frame through every chain to its own file output; a shared one would write unlinked layers too."""
        tree = self._tree
        frame = _image_node(tree, self._image)
        depth = _image_node(tree, self._depth_image) if self._depth_image is not None else None
        for number, (name, steps) in enumerate(self._chains.items()):
            node = new_node(tree, bpy.types.CompositorNodeGroup)
            node.node_tree = ensure_group(build_chain(f"NW chain {name}", steps))
            set_value(node.inputs["Reference Width"], reference_width_px)
            set_value(node.inputs["Encoded"], True)
            tree.links.new(frame.outputs["Image"], node.inputs["Image"])
            if depth is not None and "Depth" in node.inputs:
                tree.links.new(depth.outputs["Image"], node.inputs["Depth"])
            file = _file_node(tree, self._folder, f"{number}")
            tree.links.new(node.outputs["Image"], inputs(file)[0])
            self._nodes[name] = node
            self._files[name] = file

    def perturb(
        self,
        rgb: NDArray[Any],
        frames: Mapping[str, tuple[int, Identifiers]],
        depth_m: NDArray[np.float32] | None = None,
    ) -> dict[str, tuple[NDArray[np.uint8] | None, list[dict[str, Any]]]]:
        """Perturb a frame for every setting that shows it, and round once at the end.

        rgb: (H, W, 3) sRGB-encoded, uint8 or float32 in [0, 1]. frames: by chain, the frame's number in its sequence
        and the identifiers of its random streams. depth_m: (H, W), for chains that ask for it.

        Returns by chain (H, W, 3) uint8, or None where every severity is 0; and what was done.
        """
        images, notes = self.evaluate(rgb, frames, depth_m)
        return {name: (None if image is None else rgb_bytes(image), notes[name]) for name, image in images.items()}

    def evaluate(
        self,
        rgb: NDArray[Any],
        frames: Mapping[str, tuple[int, Identifiers]],
        depth_m: NDArray[np.float32] | None = None,
    ) -> tuple[dict[str, NDArray[np.float32] | None], dict[str, list[dict[str, Any]]]]:
        """Do what `perturb` does, without rounding."""
        images: dict[str, NDArray[np.float32] | None] = dict.fromkeys(frames)
        notes: dict[str, list[dict[str, Any]]] = {}
        active = []
        for name, (index, identifiers) in frames.items():
            works, notes[name] = self._set_sockets(name, index, identifiers)
            if works:
                active.append(name)
        if depth_m is None and any(step.perturbation.needs_depth for name in active for step in self._chains[name]):
            raise ValueError(f"{', '.join(active)}: a chain asks for depth, and there is none")
        if active:
            self._upload(rgb, depth_m)
        for first in range(0, len(active), FILES_PER_CALL):
            images |= self._run(active[first : first + FILES_PER_CALL])
        return images, notes

    def _set_sockets(self, name: str, index: int, identifiers: Identifiers) -> tuple[bool, list[dict[str, Any]]]:
        tree = group_of(self._nodes[name])
        values, notes = {}, []
        for step in self._chains[name]:
            values[step_node(step)], note = socket_values(
                step, index, identifiers, scene_frame=self._scene.frame_current
            )
            notes.append(note)
        for node_name, sockets in values.items():
            sockets_of = tree.nodes[node_name].inputs
            for socket_name, value in sockets.items():
                set_value(sockets_of[socket_name], value)
        return is_active(values), notes

    def _upload(self, rgb: NDArray[Any], depth_m: NDArray[np.float32] | None) -> None:
        values = rgb[::-1]
        if rgb.dtype == np.uint8:
            np.divide(values, np.float32(255), out=self._rgba[..., :3], casting="unsafe")
        else:
            self._rgba[..., :3] = values
        set_pixels(self._image, self._rgba)
        if self._depth_image is not None and depth_m is not None:
            rgba = np.ones_like(self._rgba)
            rgba[..., :3] = depth_m[::-1, :, None]
            set_pixels(self._depth_image, rgba)

    def _run(self, names: Sequence[str]) -> dict[str, NDArray[np.float32]]:
        for name, file in self._files.items():
            file.mute = name not in names
        problem = ""
        try:
            # Not by the operator's own argument, which would set the scene to the active scene's frame.
            with muted_output(), override(scene=self._scene):
                bpy.ops.render.render()
        except RuntimeError as error:  # Blender reports in this way that it could not write
            problem = str(error).strip().splitlines()[-1]
        return {name: self._take(self._folder / f"{self._files[name].file_name}.exr", problem) for name in names}

    def _take(self, path: Path, problem: str) -> NDArray[np.float32]:
        """Read an image and remove its file."""
        import cv2
        import OpenEXR

        if problem or not path.exists():
            raise StorageError(f"{path}: Blender could not write its scratch file: {problem or 'no file came'}")
        with OpenEXR.File(str(path), separate_channels=True) as layers:
            channels = layers.channels()
            axes = [np.ascontiguousarray(channels[f"{LAYER}.{axis}"].pixels) for axis in "XYZ"]
        path.unlink()
        image = np.asarray(cv2.merge(axes), np.float32).reshape(*axes[0].shape, 3)
        return image[:, :1] if self._one_pixel else image

    def close(self) -> None:
        """Remove everything that was added to the file."""
        for node in self._nodes.values():
            tree = group_of(node)
            node.node_tree = None
            remove_group(tree)
        self._nodes.clear()
        bpy.data.scenes.remove(self._scene)
        bpy.data.node_groups.remove(self._tree)
        for image in (self._image, self._depth_image):
            if image is not None:
                bpy.data.images.remove(image)
        self._scratch.remove()

    def __enter__(self) -> "Compositor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _float_image(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    image = bpy.data.images.new(name, *size_px, alpha=False, float_buffer=True)
    use_as_data(image)
    return image


def _image_node(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.Node:
    node = new_node(tree, bpy.types.CompositorNodeImage)
    node.image = image
    return node


def _file_node(tree: bpy.types.NodeTree, folder: Path, name: str) -> bpy.types.CompositorNodeOutputFile:
    """Add a node that writes an image unchanged: float, without colour management or compression."""
    file = new_node(tree, bpy.types.CompositorNodeOutputFile)
    file.directory = str(folder)
    file.file_name = name
    file.save_as_render = False
    file_format = file.format
    assert file_format is not None
    file_format.media_type = "MULTI_LAYER_IMAGE"
    file_format.file_format = "OPEN_EXR_MULTILAYER"
    file_format.color_depth = "32"
    file_format.exr_codec = "NONE"
    file_format.use_exr_interleave = True
    file.file_output_items.new("VECTOR", LAYER)
    return file
