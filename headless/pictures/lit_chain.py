# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups on scene-linear frames, as an artist has them behind a render: for pictures, films and previews."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from noisy_world.core.camera_motion import camera_state_of, motion_between
from noisy_world.core.file_access import ScratchFolder
from noisy_world.core.geometry import Intrinsics
from noisy_world.nodes.chain import capacity_of, shown_values
from noisy_world.nodes.datablocks import (
    action_of,
    group_of,
    inputs,
    interpolation,
    muted_output,
    new_action,
    new_node,
    new_socket,
    new_tree,
    outputs,
    override_scene,
    set_pixels,
    set_value,
    use_as_data,
    write_plain_floats,
)
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.perturbations import registry
from noisy_world.perturbations.groups import OVERRIDE_CAMERA, build_group, camera_values, socket_name, socket_value
from noisy_world.perturbations.kinds import ColourPerturbation, EarlierFrame, FrameContext, small_of
from noisy_world.perturbations.steps import Step
from pictures.street import LitFrame

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


# --- groups one behind the other in the compositor, as if an artist had dragged them in, with keys on their sockets ---


GAP = 60
TOP = 200  # of the nodes, so that a node editor shows them as it opens
OVERRIDE = "Override Severity"
Keys: TypeAlias = Sequence[tuple[int, float]]
"""Scene frames with values; between them the value goes straight from one to the other."""


@dataclass(frozen=True)
class Link:
    """A group of the chain. values, keys: of its sockets, where they are other than the group's own."""

    perturbation: str
    values: Mapping[str, float | bool]
    keys: Mapping[str, Keys] = field(default_factory=dict)


# Chosen by eye for the street: a winter's evening, fog that lies low, moves and glows around the lamps.
EVENING_FOG = {"Airlight": 0.5, "Falloff": 6.0, "Glow": 0.8, "Unevenness": 0.6, "Frame Rate": 24.0}
CHAIN = (
    Link("fog_depth", {OVERRIDE: True, "Visibility": 80.0} | EVENING_FOG),
    Link("snow_depth", {"Severity": 3.0, "Frame Rate": 24.0}),
    Link("lens_frost", {"Severity": 2.0, "Frame Rate": 24.0}),
    Link("gaussian_noise", {OVERRIDE: True, "Std": 0.03}),
)


def show_behind_render(
    scene: bpy.types.Scene, chain: Sequence[Link], camera: Intrinsics, c2w: NDArray[np.float64]
) -> bpy.types.NodeTree:
    """Make the scene's compositing a chain of groups behind its render; return it. c2w: the camera's path, from 0."""
    tree = new_tree("Street")
    new_socket(tree, "Image", "NodeSocketColor", output=True)
    layers = new_node(tree, bpy.types.CompositorNodeRLayers)
    layers.scene = scene
    passes = outputs(layers)
    wide_px = scene.render.resolution_x
    groups = add_groups(tree, passes["Image"], passes["Depth"], chain, camera=camera, reference_width_px=wide_px)
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(groups[-1].outputs["Image"], end.inputs["Image"])
    key_camera(tree, groups, c2w, scene.render.fps)
    arrange([layers, *groups, end])
    scene.compositing_node_group = tree
    scene.render.use_compositing = True
    return tree


def add_groups(
    tree: bpy.types.NodeTree,
    image: bpy.types.NodeSocket,
    depth_m: bpy.types.NodeSocket,
    chain: Sequence[Link],
    *,
    camera: Intrinsics,
    reference_width_px: int,
) -> list[bpy.types.CompositorNodeGroup]:
    """Add the groups, each behind the other, the first behind `image`."""
    groups = []
    for seed, link in enumerate(chain, 1):
        node = _group(tree, link, camera)
        own = {"Reference Width": reference_width_px, "Seed": seed}
        for name, value in own.items():
            if name in node.inputs:
                set_value(node.inputs[name], value)
        tree.links.new(image, node.inputs["Image"])
        if "Depth" in node.inputs:
            tree.links.new(depth_m, node.inputs["Depth"])
        image = node.outputs["Image"]
        groups.append(node)
    return groups


def _group(tree: bpy.types.NodeTree, link: Link, camera: Intrinsics) -> bpy.types.CompositorNodeGroup:
    perturbation = registry()[link.perturbation]
    assert isinstance(perturbation, ColourPerturbation)
    node = new_node(tree, bpy.types.CompositorNodeGroup)
    node.node_tree = ensure_group(build_group(perturbation))
    node.width = group_of(node).default_group_node_width
    by_camera = None if perturbation.nodes is None else perturbation.nodes.by_camera
    seen = {} if by_camera is None else by_camera(camera)
    if OVERRIDE_CAMERA in node.inputs:
        set_value(node.inputs[OVERRIDE_CAMERA], True)
    for name, value in seen.items():
        set_value(node.inputs[socket_name(perturbation, name)], socket_value(perturbation, name, value))
    for name, value in link.values.items():
        set_value(node.inputs[name], value)
    for name, keys in link.keys.items():
        _key(tree, node.inputs[name], np.array(keys, dtype=np.float64))
    return node


def key_camera(
    tree: bpy.types.NodeTree,
    groups: Sequence[bpy.types.CompositorNodeGroup],
    c2w: NDArray[np.float64],
    fps: float,
) -> None:
    """Tell the groups of weather how the camera stands and moves, at each frame of its path (N, 4, 4), from frame 0."""
    each = []
    for frame, here in enumerate(c2w):
        seconds = 1 / fps if frame else 0.0
        each.append(camera_values(camera_state_of(motion_between(c2w[0], c2w[max(frame - 1, 0)], here, seconds))))
    for node in groups:
        for name in each[0]:
            if name not in node.inputs:
                continue
            for axis in range(3):
                keys = [(frame, values[name][axis]) for frame, values in enumerate(each)]
                _key(tree, node.inputs[name], np.array(keys), axis)


def _key(
    tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, keys: NDArray[np.float64], axis: int | None = None
) -> None:
    """Key a socket, or one number of a vector's, by frames and values (N, 2)."""
    if tree.animation_data is None:
        new_action(tree, tree.name)
    path = socket.path_from_id("default_value")
    where: dict[str, Any] = {} if axis is None else {"index": axis}
    points = action_of(tree).fcurve_ensure_for_datablock(tree, path, **where).keyframe_points
    points.add(len(keys))
    points.foreach_set("co", keys.astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(keys), interpolation("LINEAR"), dtype=np.int32))


def arrange(nodes: Sequence[bpy.types.Node]) -> None:
    """Put nodes beside each other around the middle."""
    left = -sum(node.width + GAP for node in nodes) / 2
    for node in nodes:
        node.location = (left, TOP)
        node.select = False
        left += node.width + GAP
