# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups beside the references: error where nothing is random, and time."""

import time
from collections.abc import Mapping, Sequence

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.blender.compositor import Compositor
from noisy_world.blender.nodes import ensure_group
from noisy_world.core.datasets.images import as_float, rgb_bytes
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.execution import perturb_colour
from noisy_world.core.perturbing.kinds import ColourPerturbation, FrameContext
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.perturbing.steps import Step
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

from . import tables

SEED = 3
TURNS = 5  # chosen: the median of five is little disturbed by other load on the machine
EXACT = (
    "brightness",
    "contrast",
    "pixelate",
    "gaussian_blur",
    "defocus_blur",
    "motion_blur",
    "haze",
    "fog_depth",
    "defocus_depth",
)
GIVEN = {"motion_blur": {"max_angle_deg": 0.0, "angle_deg": 30.0}}  # a fixed angle, so that nothing is random


def step_of(name: str, severity: float) -> Step:
    """Return a step of one severity."""
    (step,) = parse_steps([{name: {"severity": severity}}], ConfigPath("report"), registry())
    return step


def slope(size_px: tuple[int, int]) -> NDArray[np.float32]:
    """Return planar depth (H, W) in metres, from 0.5 to 9, with void."""
    depth_m = np.repeat(np.linspace(0.5, 9.0, size_px[1], dtype=np.float32)[:, None], size_px[0], axis=1)
    depth_m[size_px[1] // 4 : size_px[1] // 3, size_px[0] // 4 : size_px[0] // 3] = 0
    return depth_m


def composited(
    frames: NDArray[np.uint8], steps: Mapping[str, Sequence[Step]], *, seed: int = SEED
) -> dict[str, list[NDArray[np.uint8]]]:
    """Perturb (N, H, W, 3) frames by chains; return by the chains' names an image for each frame."""
    size_px = frames.shape[2], frames.shape[1]
    made: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in steps}
    with Compositor(size_px, steps, size_px[0]) as compositor:
        for k, frame in enumerate(frames):
            results = compositor.perturb(frame, dict.fromkeys(steps, (k, (seed, "", ""))), slope(size_px))
            for name, (image, _) in results.items():
                made[name].append(frame if image is None else image)
    return made


def errors(frames: NDArray[np.uint8]) -> str:
    """Compare the groups without randomness with the reference on a frame, in float values."""
    rgb = as_float(frames[0])
    size_px = rgb.shape[1], rgb.shape[0]
    depth_m = slope(size_px)
    rows = []
    for name in (*EXACT, "jpeg_compression"):
        row: list[object] = [name]
        for severity in (1, 2, 3, 4, 5):
            values = {"severity": severity, **GIVEN.get(name, {})}
            (step,) = parse_steps([{name: values}], ConfigPath("report"), registry())
            with Compositor(size_px, {"x": [step]}, size_px[0]) as compositor:
                found = evaluated(compositor, rgb, depth_m)
            context = step.context(FrameContext(0, (SEED, "", ""), read_depth_m=lambda: depth_m))
            wanted = np.clip(perturb_colour(step, rgb, severity, context), 0, 1)
            apart = np.abs(found - wanted) * 255
            row.append(f"{apart.max():.2f} ({apart.mean():.3f})")
        rows.append(row)
    text = "Largest difference (mean in brackets) from the reference, in 255ths, float to float, at severities 1 to 5."
    return "\n\n".join([text, tables.table(("perturbation", "1", "2", "3", "4", "5"), rows)])


def evaluated(compositor: Compositor, rgb: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what the chain "x" makes of the first frame of a sequence."""
    image = compositor.evaluate(rgb, {"x": (0, (SEED, "", ""))}, depth_m)[0]["x"]
    assert image is not None, "no severity is 0"
    return image


def times(names: Sequence[str], frames: NDArray[np.uint8], reference_ms: Mapping[str, float]) -> str:
    """Time every group, less the time of a pass-through taken in turns, and all groups of severity 3 in one call."""
    size_px = frames.shape[2], frames.shape[1]
    rgb, depth_m = as_float(frames[0]), slope(size_px)
    rows, nets = [], []
    for name in names:
        chains = {"none": (), **{f"{severity}": (step_of(name, severity),) for severity in (3, 5)}}
        took = timed(size_px, rgb, depth_m, chains)
        net = {key: took[key] - took["none"] for key in ("3", "5")}
        nets.append(net["3"])
        rows.append((name, 1e3 * net["3"], 1e3 * net["5"], reference_ms.get(name, "-")))
    together = timed(size_px, rgb, depth_m, {"none": (), **{name: (step_of(name, 3),) for name in names}}, at_once=True)
    net_s, pass_s = sum(nets), together["none"]
    text = (
        f"Net of a pass-through of {1e3 * pass_s:.0f} ms (upload, evaluation, reading, rounding). "
        f"Median at severity 3: {1e3 * float(np.median(nets)):.0f} ms. "
        f"All {len(names)} in one call: {together['all']:.2f} s, which is "
        f"{together['all'] / (net_s + len(names) * pass_s):.2f} times a call for each, "
        f"and {together['all'] / (net_s + pass_s):.2f} times their net times with one pass-through."
    )
    head = ("perturbation", "nodes, severity 3, ms", "severity 5, ms", "reference, severity 3, ms")
    return "\n\n".join([text, tables.table(head, rows)])


def building(names: Sequence[str]) -> str:
    """Time describing every group and making it in an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    start_s = time.perf_counter()
    for name in names:
        perturbation = registry()[name]
        assert isinstance(perturbation, ColourPerturbation)
        ensure_group(build_group(perturbation))
    nodes = sum(len(tree.nodes) for tree in bpy.data.node_groups)
    return f"Making all {len(names)} groups, {nodes} nodes: {time.perf_counter() - start_s:.2f} s."


def timed(
    size_px: tuple[int, int],
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    chains: Mapping[str, Sequence[Step]],
    *,
    at_once: bool = False,
) -> dict[str, float]:
    """Return the median seconds of each chain, taken in turns; `at_once`: of "none", and of the others in one call."""
    calls = (
        {"none": ["none"], "all": [name for name in chains if name != "none"]} if at_once else {n: [n] for n in chains}
    )
    found: dict[str, list[float]] = {name: [] for name in calls}
    with Compositor(size_px, chains, size_px[0]) as compositor:
        for turn in range(TURNS + 1):
            for name, wanted in calls.items():
                start_s = time.perf_counter()
                compositor.perturb(rgb, dict.fromkeys(wanted, (turn, (SEED, "", ""))), depth_m)
                if turn:
                    found[name].append(time.perf_counter() - start_s)
    return {name: float(np.median(values)) for name, values in found.items()}


def previews(names: Sequence[str], frames: NDArray[np.uint8]) -> str:
    """Compare a preview at half size, scaled up, with the frame; and the frame itself, scaled down and up."""
    size_px = frames.shape[2], frames.shape[1]
    half_px = size_px[0] // 2, size_px[1] // 2
    rgb, depth_m = as_float(frames[0]), slope(size_px)
    small = np.asarray(cv2.resize(rgb, half_px, interpolation=cv2.INTER_AREA), np.float32)
    small_depth_m = slope(half_px)
    rows = []
    for name in names:
        step = step_of(name, 3)
        with Compositor(size_px, {"x": [step]}, size_px[0]) as compositor:
            whole = evaluated(compositor, rgb, depth_m)
        with Compositor(half_px, {"x": [step]}, size_px[0]) as compositor:
            preview = evaluated(compositor, small, small_depth_m)
        resampled = np.asarray(cv2.resize(whole, half_px, interpolation=cv2.INTER_AREA), np.float32)
        rows.append((name, *(f"{similarity(whole, item, size_px):.3f}" for item in (preview, resampled))))
    text = f"SSIM with the frame at severity 3, of what is {half_px[0]} x {half_px[1]}, scaled up."
    return "\n\n".join([text, tables.table(("perturbation", "preview", "frame, resampled"), rows)])


def similarity(whole: NDArray[np.float32], small: NDArray[np.float32], size_px: tuple[int, int]) -> float:
    """Return the SSIM (mean of the channels) of a frame and a small picture scaled up, both as bytes."""
    large = np.asarray(cv2.resize(small, size_px, interpolation=cv2.INTER_LINEAR), np.float32)
    ssim_of = cv2.quality.QualitySSIM_compute  # pyright: ignore[reportAttributeAccessIssue]  not in OpenCV's stubs
    values, _ = ssim_of(rgb_bytes(whole), rgb_bytes(large))
    return float(np.mean(values[:3]))
