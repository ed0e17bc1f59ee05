"""Node groups beside their references: the same parameters, the same frame."""

import functools
import hashlib
from itertools import pairwise

import bpy
import numpy as np
import OpenEXR
from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.nodes.datablocks import muted_output
from noisy_world.nodes.datablocks import write_plain_floats
from noisy_world.nodes.datablocks import new_tree, set_pixels, use_as_data
from noisy_world.nodes.chain import build_written
from noisy_world.core.node_graph import Graph
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

IDENTIFIERS = (7, "room", "setting")


def picture(height, width, seed=0):
    """A frame with edges, texture, dark and light: (H, W, 3) float32, whole bytes."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    phase = rng.uniform(0, 6, 3)
    waves = 0.5 + 0.3 * np.sin(rows[..., None] / 37 + phase) * np.cos(columns[..., None] / 53 + phase)
    boxes = rng.random((height // 24 + 1, width // 24 + 1, 3)).repeat(24, 0).repeat(24, 1)[:height, :width]
    fine = rng.random((height, width, 1)) - 0.5
    image = 0.55 * waves + 0.4 * boxes + 0.1 * fine
    image[: height // 8, : width // 8] = 0
    image[-(height // 8) :, -(width // 8) :] = 1
    return (np.rint(np.clip(image, 0, 1) * 255) / 255).astype(np.float32)


def step_of(name, **values):
    """The step of a preset's {name: values}."""
    (step,) = parse_steps([{name: values}], ConfigPath("test"), registry())
    return step


@functools.cache
def described(name):
    """The description of a perturbation's group, made once: it takes tens of milliseconds."""
    return build_group(registry()[name])


def keep_group(name):
    """Make a perturbation's node group stay in the file: making it takes up to half a second, each evaluation 10 ms."""
    ensure_group(described(name)).use_fake_user = True


def keep_written(chains):
    """Make what the generator evaluates for these chains stay in the file, for the same reason."""
    for steps in chains.values():
        ensure_group(build_written(steps, apart=True)).use_fake_user = True


def by_nodes(name, image, frames=(0,), *, reference_width=None, identifiers=IDENTIFIERS, depth_m=None, **values):
    """What the node group makes of the frames: a list of (H, W, 3) float32, encoded; the image itself at severity 0."""
    size = image.shape[1], image.shape[0]
    chains = {"x": [step_of(name, **values)]}
    keep_written(chains)
    with Compositor(size, chains, reference_width or size[0]) as compositor:
        found = [compositor.evaluate(image, {"x": (k, identifiers)}, depth_m)[0]["x"] for k in frames]
    return [image if item is None else item for item in found]


def many_by_nodes(chains, images, indices=(0,), *, identifiers=IDENTIFIERS, depth_m=None):
    """What many chains, steps by name, make of the images, each at each index: a dictionary by name for every one."""
    size = images[0].shape[1], images[0].shape[0]
    keep_written(chains)
    with Compositor(size, chains, size[0]) as compositor:
        return [
            compositor.evaluate(image, dict.fromkeys(chains, (k, identifiers)), depth_m)[0]
            for image in images
            for k in indices
        ]


def digests(names):
    """The SHA-256 of what each group makes of a picture at frame 50, in their order."""
    image = picture(90, 130)
    chains = {name: [step_of(name, severity=4)] for name in names}
    (made,) = many_by_nodes(chains, [image], [50], depth_m=image[..., 0] * 5)
    return [hashlib.sha256(made[name].tobytes()).hexdigest() for name in names]


def by_groups(nodes, image, folder, *, frame=5, depth_m=None, set_up=None):
    """What the groups that people see make of a float image (H, W, 3), standing in a user's compositor, in one call.

    nodes: by a label, the perturbation's name (or a description of a group) and the values of sockets; an array among
    these is linked as an image. set_up: what is done to the scene first, such as giving it a camera.
    """
    scene, tree = bpy.data.scenes.new("By groups"), new_tree("By groups")
    scene.compositing_node_group = tree
    render = scene.render
    render.resolution_x, render.resolution_y = image.shape[1], image.shape[0]
    render.compositor_device, render.compositor_precision = "CPU", "FULL"
    if set_up is not None:
        set_up(scene)
    scene.frame_set(frame)
    file = tree.nodes.new("CompositorNodeOutputFile")
    file.directory, file.file_name = str(folder), "by_groups"
    write_plain_floats(file.format)

    def linked(pixels):
        node = tree.nodes.new("CompositorNodeImage")
        node.image = bpy.data.images.new("By groups", image.shape[1], image.shape[0], alpha=False, float_buffer=True)
        use_as_data(node.image)
        rgba = np.ones((*image.shape[:2], 4), np.float32)
        rgba[..., :3] = pixels[::-1] if pixels.ndim == 3 else pixels[::-1, :, None]
        set_pixels(node.image, rgba)
        return node.outputs["Image"]

    kinds = dict.fromkeys(kind for kind, _ in nodes.values())
    groups = {kind: ensure_group(kind if isinstance(kind, Graph) else described(kind)) for kind in kinds}
    source, far = linked(image), None if depth_m is None else linked(depth_m)
    for place, (label, (name, values)) in enumerate(nodes.items()):
        node = tree.nodes.new("CompositorNodeGroup")
        node.node_tree = groups[name]
        tree.links.new(source, node.inputs["Image"])
        if far is not None and "Depth" in node.inputs:
            tree.links.new(far, node.inputs["Depth"])
        for socket, value in ({"Reference Width": image.shape[1]} | values).items():
            if isinstance(value, np.ndarray):
                tree.links.new(linked(value), node.inputs[socket])
            else:
                node.inputs[socket].default_value = value
        file.file_output_items.new("VECTOR", label.replace(" ", "_"))
        tree.links.new(node.outputs["Image"], file.inputs[place])
    with muted_output(), bpy.context.temp_override(scene=scene):
        bpy.ops.render.render()
    bpy.data.scenes.remove(scene)
    path = folder / "by_groups.exr"
    with OpenEXR.File(str(path), separate_channels=True) as layers:
        channels = {name: part.pixels.copy() for name, part in layers.channels().items()}
    path.unlink()
    return {label: np.stack([channels[f"{label.replace(' ', '_')}.{axis}"] for axis in "XYZ"], -1) for label in nodes}


def by_reference(name, image, frames=(0,), *, identifiers=IDENTIFIERS, depth_m=None, **values):
    """What the reference makes of them, clipped."""
    step = step_of(name, **values)
    results = []
    for k in frames:
        context = step.context(FrameContext(k, identifiers, read_depth_m=None if depth_m is None else lambda: depth_m))
        made = step.perturbation.apply(image, step.parameters(step.severity_of(context)), context)
        results.append(np.clip(made, 0, 1))
    return results


def levels_apart(one, other):
    """The largest and the mean difference, in 255ths."""
    apart = np.abs(one.astype(np.float64) - other) * 255
    return apart.max(), apart.mean()


def ks_distance(one, other):
    """The Kolmogorov-Smirnov distance of two samples."""
    one, other = np.sort(one, axis=None), np.sort(other, axis=None)
    both = np.concatenate([one, other])
    share = [np.searchsorted(item, both, side="right") / item.size for item in (one, other)]
    return np.abs(share[0] - share[1]).max()


def ks_bar(one, other, level=0.01):
    """The distance that two equal distributions reach with this probability."""
    return np.sqrt(-0.5 * np.log(level / 2)) * np.sqrt(1 / one.size + 1 / other.size)


def radial_power(change, bands=12):
    """The mean power of (H, W, 3) or (H, W) in rings of equal ratio from 1 / 256 to 1 / 2 cycles a pixel."""
    grey = change.mean(axis=2) if change.ndim == 3 else change
    power = np.abs(np.fft.fft2(grey)) ** 2 / grey.size
    radius = np.hypot(np.fft.fftfreq(grey.shape[0])[:, None], np.fft.fftfreq(grey.shape[1]))
    edges = np.geomspace(1 / 256, 0.5, bands + 1)
    rings = [power[(radius >= low) & (radius < high)].mean() for low, high in pairwise(edges)]
    return np.array(rings)


def spectrum_ratios(name, image, draws, **values):
    """Nodes' power of the change over the reference's in each band, both the means over draws."""
    powers = []
    for make in (by_nodes, by_reference):
        total = 0
        for made in make(name, image, range(draws), **values):
            total = total + radial_power(made - image)
        powers.append(total / draws)
    return powers[0] / powers[1]
