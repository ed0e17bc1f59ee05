# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluating node groups on arrays: one upload of a frame, one evaluation, an image for each setting."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.camera_motion import CameraMotion, camera_state_of
from ..core.errors import StorageError
from ..core.file_access import ScratchFolder, utf8_name
from ..core.geometry import Intrinsics
from ..core.machine import batched
from ..core.node_graph import Graph
from ..perturbations.kinds import ColourPerturbation, FrameContext, Identifiers
from ..perturbations.shares import read_mask
from ..perturbations.steps import Step
from .chain import Decided, Divided, bytes_of, is_active, mask_values, pooled, socket_of, socket_values, step_node
from .datablocks import (
    float_image,
    group_of,
    image_node,
    inputs,
    muted_output,
    new_node,
    new_tree,
    override_scene,
    read_rows,
    set_pixels,
    set_value,
    write_plain_floats,
)
from .node_trees import ensure_group, remove_group

T = TypeVar("T", bound=np.generic)

SCENE = "Noisy World compositor"
# Layers of a file, so images of one evaluation; chosen: memory is bounded, and a file costs less than several files.
LAYERS = 16
FLOATS = 4  # bytes of a float32
Motions: TypeAlias = Mapping[str, CameraMotion | None]
"""How the camera moves at a frame, by chain; of those that are missing nothing is known."""

Device: TypeAlias = Literal["cpu", "gpu"]

_Output: TypeAlias = Literal["Image", "Bytes"]

SocketValues: TypeAlias = dict[str, Any]
"""The values of a chain's sockets, by name."""

_Known: TypeAlias = tuple[SocketValues, list[dict[str, Any]], bool]
"""The values of a chain's sockets for a frame, a note of each step, and whether it is to be evaluated."""


@dataclass(frozen=True, eq=False)
class _Pool:
    """Equal nodes, any of which can do the work of any chain of these perturbations.

    names: of the nodes, as many as chains. draws: the node that makes the random images of them all, which are then
    those of one stream.
    """

    names: tuple[str, ...]
    draws: bpy.types.CompositorNodeGroup | None


class Compositor:
    """Evaluates chains of node groups on given frames, in a separate scene that renders nothing.

    The user's scenes and their colour management are not touched: results leave the compositor as float values.
    """

    def __init__(
        self,
        size_px: tuple[int, int],
        chains: Mapping[str, Sequence[Step[ColourPerturbation]]],
        reference_width_px: int,
        intrinsics: Intrinsics | None = None,
        *,
        lit: bool = False,
        device: Device = "cpu",
    ) -> None:
        """Build the chains.

        size_px: width, height of the frames. chains: steps of colour by the chain's name.
        reference_width_px: the width to which parameters in pixels refer. intrinsics: of the camera, if known. lit:
        frames are scene-linear light of any brightness, which `evaluate` takes and gives; there is no `perturb`.
        device: what evaluates them.
        """
        # Blender treats an image of one pixel as a single value and writes no file for it, so two equal pixels are
        # used.
        self._one_pixel = size_px == (1, 1)
        self._size_px = size_px = (2, 1) if self._one_pixel else size_px
        self._intrinsics = intrinsics
        self._chains = {name: tuple(steps) for name, steps in chains.items()}
        self._needs_depth = any(step.perturbation.needs_depth for steps in chains.values() for step in steps)
        self._scratch = ScratchFolder(FLOATS * size_px[0] * size_px[1] * min(len(chains), LAYERS))
        self._scene = bpy.data.scenes.new(SCENE)
        self._tree = new_tree(SCENE)
        self._rgba = np.ones((size_px[1], size_px[0], 4), dtype=np.float32)
        self._image = float_image("Noisy World frame", size_px)
        self._depth_image = float_image("Noisy World depth", size_px) if self._needs_depth else None
        self._configure(device)
        self._nodes: dict[str, bpy.types.CompositorNodeGroup] = {}
        self._pool_of: dict[str, _Pool] = {}
        self._known: dict[bpy.types.CompositorNodeGroup, SocketValues] = defaultdict(dict)
        self._masks: dict[tuple[bpy.types.CompositorNodeGroup, str], bpy.types.Image] = {}
        self._lit = lit
        self._wire(reference_width_px)
        self._outputs: dict[_Output, _Layers] = {}

    def _configure(self, device: Device) -> None:
        scene = self._scene
        scene.compositing_node_group = self._tree
        render = scene.render
        render.resolution_x, render.resolution_y = self._size_px
        render.resolution_percentage = 100
        render.use_compositing = True
        render.use_sequencer = False
        render.compositor_device = "GPU" if device == "gpu" else "CPU"
        render.compositor_precision = "FULL"

    def _wire(self, reference_width_px: int) -> None:
        """Make nodes for every chain and link the frame to them.

        A file is one evaluation, so a pool's nodes stand together. Each frame's work takes a pool's first nodes; those
        beyond what every frame needs come last, so that most files are full.
        """
        tree = self._tree
        frame = image_node(tree, self._image)
        depth = image_node(tree, self._depth_image) if self._depth_image is not None else None

        def node_of(graph: Graph) -> bpy.types.CompositorNodeGroup:
            node = new_node(tree, bpy.types.CompositorNodeGroup)
            node.node_tree = ensure_group(graph)
            for name, given in (("Image", frame.outputs["Image"]), ("Depth", depth and depth.outputs["Image"])):
                if given is not None and name in node.inputs:
                    tree.links.new(given, node.inputs[name])
            if "Reference Width" in node.inputs:
                set_value(node.inputs["Reference Width"], reference_width_px)
            return node

        ordered: list[tuple[tuple[int, bool, int, int], str, bpy.types.CompositorNodeGroup]] = []
        for number, (names, graph) in enumerate(pooled(self._chains, lit=self._lit)):
            draws = node_of(graph.draws) if isinstance(graph, Divided) else None
            pool = _Pool(tuple(f"{number}: {rank}" for rank in range(len(names))), draws)
            always = sum(all(step.levels is None for step in self._chains[name]) for name in names)
            masked = mask_values(self._chains[names[0]], 0)
            for rank, name in enumerate(pool.names):
                node = node_of(graph.rest if isinstance(graph, Divided) else graph)
                for socket in masked:
                    self._masks[node, socket] = image = float_image("Noisy World mask", self._size_px)
                    tree.links.new(image_node(tree, image).outputs["Image"], node.inputs[socket])
                for output in () if draws is None else draws.outputs:
                    tree.links.new(output, node.inputs[output.name])
                ordered.append(((max(rank - always + 1, 0), draws is None, number, rank), name, node))
            self._pool_of |= dict.fromkeys(names, pool)
        self._nodes = {name: node for _, name, node in sorted(ordered, key=lambda item: item[0])}

    def perturb(
        self,
        rgb: NDArray[Any],
        frames: Mapping[str, tuple[int, Identifiers]],
        depth_m: NDArray[np.float32] | None = None,
        motions: Motions | None = None,
        decided: Decided | None = None,
    ) -> dict[str, tuple[NDArray[np.uint8] | None, list[dict[str, Any]]]]:
        """Perturb a frame for every setting that shows it, and round once at the end.

        rgb: (H, W, 3) sRGB-encoded, uint8 or float32 in [0, 1]. frames: by chain, the frame's number in its sequence
        and the identifiers of its random streams. depth_m: (H, W), for chains that ask for it. motions: likewise.
        decided: what automatics decided by earlier frames; without it, as if these had been mid-grey.

        Returns by chain (H, W, 3) uint8, or None where every severity is 0; and what was done. Chains that do the same
        to the frame give one array.
        """
        known = self._values_of_all(frames, motions, decided)
        images: dict[str, NDArray[np.uint8] | None] = dict.fromkeys(frames)
        for active in self._turns(rgb, depth_m, known):
            for name, layer in self._run("Bytes", active):
                images |= dict.fromkeys(active[name], self._own(bytes_of(layer[:, 0])))
        return {name: (image, known[name][1]) for name, image in images.items()}

    def evaluate(
        self,
        rgb: NDArray[Any],
        frames: Mapping[str, tuple[int, Identifiers]],
        depth_m: NDArray[np.float32] | None = None,
        motions: Motions | None = None,
        decided: Decided | None = None,
    ) -> tuple[dict[str, NDArray[np.float32] | None], dict[str, list[dict[str, Any]]]]:
        """Do what `perturb` does, without rounding; to scene-linear light (H, W, 3), float32, where it is lit."""
        known = self._values_of_all(frames, motions, decided)
        images: dict[str, NDArray[np.float32] | None] = dict.fromkeys(frames)
        for active in self._turns(rgb, depth_m, known):
            for name, layer in self._run("Image", active):
                images |= dict.fromkeys(active[name], self._own(np.ascontiguousarray(np.moveaxis(layer, 1, 2))))
        return images, {name: notes for name, (_, notes, _) in known.items()}

    def _own(self, image: NDArray[T]) -> NDArray[T]:
        return image[:, :1] if self._one_pixel else image

    def _turns(
        self,
        rgb: NDArray[Any],
        depth_m: NDArray[np.float32] | None,
        known: Mapping[str, _Known],
    ) -> Iterator[dict[str, list[str]]]:
        """Hand the frame over and set the sockets; yield the nodes to evaluate, each with the chains that it serves.

        One node serves all chains that do the same: a severity that is drawn is often that of another setting, which
        then gives the same image if it draws nothing, or draws from the same stream. Chains whose random images come
        from one node, and which draw others all the same, as they show the frame at other times, take another turn.

        known: of each chain, as `_values` says.
        """
        works: dict[tuple[_Pool, str], tuple[str, SocketValues, list[str]]] = {}
        for name, (values, _, acts) in known.items():
            if acts:
                work = works.setdefault((self._pool_of[name], repr(values)), (name, values, []))
                work[2].append(name)
        served = [name for _, _, names in works.values() for name in names]
        if depth_m is None and any(step.perturbation.needs_depth for name in served for step in self._chains[name]):
            raise ValueError(f"{', '.join(served)}: a chain asks for depth, and there is none")
        if works:
            self._upload(rgb, depth_m)
        left = [(pool, values, names) for (pool, _), (_, values, names) in works.items()]
        while left:
            active, left = self._turn(left)
            yield active

    def _turn(
        self, works: Iterable[tuple[_Pool, SocketValues, list[str]]]
    ) -> tuple[dict[str, list[str]], list[tuple[_Pool, SocketValues, list[str]]]]:
        """Set the sockets of nodes for the works of one turn; return these with their chains, and what is left."""
        active: dict[str, list[str]] = {}
        drawn: dict[_Pool, SocketValues] = {}
        left: list[tuple[_Pool, SocketValues, list[str]]] = []
        taken: dict[_Pool, int] = defaultdict(int)
        for pool, values, names in works:
            if pool.draws is not None:
                draws = {name: value for name, value in values.items() if name in pool.draws.inputs}
                if drawn.setdefault(pool, draws) != draws:
                    left.append((pool, values, names))
                    continue
                self._set_sockets(pool.draws, draws)
            slot = pool.names[taken[pool]]
            taken[pool] += 1
            self._set_sockets(self._nodes[slot], values)
            active[slot] = names
        return active, left

    def _values_of_all(
        self, frames: Mapping[str, tuple[int, Identifiers]], motions: Motions | None, decided: Decided | None
    ) -> dict[str, _Known]:
        """Return what `_values` does, of each chain."""
        motions, decided = motions or {}, decided or {}
        return {
            name: self._values(name, *frame, motions.get(name), decided.get(name, {})) for name, frame in frames.items()
        }

    def _values(
        self,
        name: str,
        index: int,
        identifiers: Identifiers,
        motion: CameraMotion | None,
        decided: Mapping[str, FrameContext],
    ) -> _Known:
        """Return the values of a chain's sockets, a note of each step, and whether it is to be evaluated."""
        values: dict[str, dict[str, Any]] = {}
        notes: list[dict[str, Any]] = []
        now = self._scene.frame_current
        for step in self._chains[name]:
            values[step_node(step)], note = socket_values(
                step,
                index,
                identifiers,
                scene_frame=now,
                intrinsics=self._intrinsics,
                camera_state=camera_state_of(motion),
                decided=decided.get(step_node(step)),
                lit=self._lit,
            )
            notes.append(note)
        flat = {
            socket_of(step, socket): value
            for step in self._chains[name]
            for socket, value in values[step_node(step)].items()
        }
        return flat | mask_values(self._chains[name], index), notes, is_active(values)

    def _set_sockets(self, node: bpy.types.CompositorNodeGroup, values: SocketValues) -> None:
        """Set the sockets that are there and change: for each that is set, Blender looks through all nodes."""
        known = self._known[node]
        for name, value in values.items():
            if (name not in known or known[name] != value) and name in node.inputs:
                if isinstance(value, Path):
                    rgba = np.ones_like(self._rgba)
                    rgba[..., :3] = read_mask(value, self._size_px)[::-1, :, None]
                    set_pixels(self._masks[node, name], rgba)
                else:
                    set_value(node.inputs[name], value)
            known[name] = value

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

    def _run(self, output: "_Output", active: Iterable[str]) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """Evaluate the active chains; yield each with its layer (H, channels, W)."""
        if output not in self._outputs:
            self._outputs[output] = _Layers(self._tree, self._scratch.path, self._nodes, output)
        layers = self._outputs[output]
        for other in self._outputs.values():
            other.mute()
        for names in layers.batches(active):
            problem = ""
            try:
                # Not by the operator's own argument, which would set the scene to the active scene's frame.
                with muted_output(), override_scene(self._scene):
                    bpy.ops.render.render()
            except RuntimeError as error:  # Blender reports in this way that it could not write
                problem = str(error).strip().splitlines()[-1]
            yield from layers.take(names, self._size_px, problem)

    def close(self) -> None:
        """Remove everything that was added to the file."""
        draws = [pool.draws for pool in self._pool_of.values() if pool.draws is not None]
        trees = {group_of(node).name: group_of(node) for node in [*self._nodes.values(), *draws]}
        bpy.data.scenes.remove(self._scene)
        bpy.data.node_groups.remove(self._tree)
        self._nodes.clear()
        self._pool_of.clear()
        self._known.clear()
        for tree in trees.values():
            if tree.users == 0:
                remove_group(tree)
        for image in (self._image, self._depth_image, *self._masks.values()):
            if image is not None:
                bpy.data.images.remove(image)
        self._scratch.remove()

    def __enter__(self) -> "Compositor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Layers:
    """The files that one output of the chains is written to, each with a layer for several nodes."""

    def __init__(
        self,
        tree: bpy.types.NodeTree,
        folder: Path,
        nodes: Mapping[str, bpy.types.CompositorNodeGroup],
        output: _Output,
    ) -> None:
        """Add the nodes that write. output: of the chains."""
        self._folder = folder
        self._nodes = nodes
        self._channels = 3 if output == "Image" else 1
        self._files: dict[tuple[str, ...], bpy.types.CompositorNodeOutputFile] = {}
        for number, names in enumerate(batched(nodes, LAYERS)):
            file = new_node(tree, bpy.types.CompositorNodeOutputFile)
            file.directory, file.file_name = utf8_name(folder), f"{output}-{number}"
            file.save_as_render = False
            assert file.format is not None
            write_plain_floats(file.format)
            for slot, name in enumerate(names):
                file.file_output_items.new("VECTOR" if output == "Image" else "FLOAT", f"{slot:02}")
                tree.links.new(nodes[name].outputs[output], inputs(file)[slot])
            self._files[names] = file

    def mute(self) -> None:
        """Write nothing."""
        for file in self._files.values():
            file.mute = True

    def batches(self, active: Iterable[str]) -> Iterator[tuple[str, ...]]:
        """Unmute one file after the other, for those that have layers of active chains; yield the chains of each.

        A chain beside them that is not active passes the frame on, as a file has all its layers always.
        """
        wanted = set(active)
        for names, file in self._files.items():
            if wanted.isdisjoint(names):
                continue
            for name in names:
                self._nodes[name].mute = name not in wanted
            file.mute = False
            yield tuple(name if name in wanted else "" for name in names)
            file.mute = True

    def take(
        self, names: Sequence[str], size_px: tuple[int, int], problem: str
    ) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """Read a file and remove it; yield its layers by the chain's name, without those that have none."""
        (path,) = {self._folder / f"{file.file_name}.exr" for file in self._files.values() if not file.mute}
        if problem or not path.exists():
            raise StorageError(f"Blender could not write its scratch file: {problem or 'no file came'}", file=path)
        rows = read_rows(path, size_px, self._channels * len(names))
        path.unlink()
        for slot, name in enumerate(names):
            if name:
                yield name, rows[:, slot * self._channels : (slot + 1) * self._channels]
