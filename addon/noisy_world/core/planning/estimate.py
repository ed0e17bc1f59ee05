# SPDX-License-Identifier: GPL-3.0-or-later
"""A rough estimate of a plan's time and disk space, for --dry-run and the warning of a disk that is too small."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..channels.channel import PixelBytes
from ..datasets.layouts import Modality
from ..perturbing.steps import Setting
from .numbers import Numbers, array_of
from .plan import Plan, Render

# Measured on two cores at 1200 x 680 (docs/cost.md), and rounded.
SECONDS_PER_SAMPLE = 2.4e-7  # a ray in Cycles: 0.20 s for a frame of one sample
SECONDS_PER_PIXEL = 2e-8  # reading or encoding and writing a frame's two images: 0.016 s
SECONDS_PER_RAY = 6.5e-8  # engine embree: 0.05 s a frame
AVERAGED_SHARE = 0.1  # of pixels get all their samples with it: 0.02 of a scanned room's, 0.2 of the embedded rooms'
SECONDS_PER_RENDER = 4.0  # loading a scene
SECONDS_PER_LINK = 1e-4  # an image that is there already under another name
SECONDS_PER_PERTURBED_PIXEL = 1.2e-8  # perturbing, encoding and writing an image: 0.01 s, the mean of the benchmark's
SECONDS_PER_COMPOSITED_PIXEL = 6.5e-8  # in Blender's compositor, in addition: 0.05 s an image


@dataclass(frozen=True)
class CostEstimate:
    """A rough guess of what a plan takes on two cores.

    least_bytes, most_bytes: what the content of its images makes likely.
    """

    bytes_written: int
    seconds: float
    least_bytes: int
    most_bytes: int


def image_bytes(plan: Plan, render: Render, modality: Modality) -> int:
    """Estimate the bytes of an image of a render."""
    return int(_pixels(render, modality) * CHANNELS[modality].pixel_bytes(plan.format).usual)


def _pixels(render: Render, modality: Modality) -> int:
    camera = render.depth_camera if CHANNELS[modality].paired else render.camera
    return camera.width_px * camera.height_px


def size_text(count: int) -> str:
    """Return a number of bytes in words: "3.2 GB", "17 MB", "1.4 MB", "600 bytes"."""
    for size, unit in ((10**12, "TB"), (10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}" if count < 10 * size else f"{count / size:.0f} {unit}"
    return f"{count} bytes"


def estimate(plan: Plan) -> CostEstimate:
    """Estimate the bytes and the time of a plan from the measured costs of a pixel."""
    least, most = np.sum([_byte_bounds(plan, render) for render in plan.renders], axis=0)
    usual = sum(_bytes_of(plan, render) for render in plan.renders)  # of presets of many perturbations
    seconds = sum(_seconds_of(plan, render) for render in plan.renders)
    return CostEstimate(int(min(max(usual, least), most)), seconds, int(least), int(most))


def frame_seconds(plan: Plan, render: Render, frames: Sequence[int]) -> NDArray[np.float64]:
    """Estimate the seconds (N,) that some source frames of a render take, with all images that show them."""
    pixels = render.camera.width_px * render.camera.height_px
    each_s = pixels * SECONDS_PER_PIXEL
    if render.scene.source.capabilities.rendered:
        render_spec, own = plan.preset.spec.render, render.scene.source.capabilities.own
        engine, samples = (render_spec.engine, render_spec.samples) if own is None else (own.engine, own.samples)
        rays_s = pixels * rendering_seconds(engine, samples)
        each_s = rays_s if engine == "embree" else each_s + rays_s
    images_s: dict[Numbers, float] = {}  # of all images that show the same source frames one after another
    for modality in plan.format.modalities:
        made = plan.parts_made.of(render.name, render.sequences, modality)
        for sequence in render.sequences:
            pixel_s = SECONDS_PER_PERTURBED_PIXEL
            if CHANNELS[modality].steps == "rgb" and plan.composites and sequence.setting.composited:
                pixel_s += SECONDS_PER_COMPOSITED_PIXEL
            image_s = SECONDS_PER_LINK + made.get(sequence.folder, 0.0) * pixels * pixel_s
            sources = sequence.sources_shown(modality)
            images_s[sources] = images_s.get(sources, 0.0) + image_s
    seconds = np.full(max(render.frames[-1:], default=-1) + 1, each_s)
    for sources, image_s in images_s.items():
        if isinstance(sources, range):
            seconds[sources.start : sources.stop : sources.step] += image_s
        else:
            seconds += image_s * np.bincount(sources.values, minlength=len(seconds))
    return seconds[array_of(frames)]


def rendering_seconds(engine: str, samples: int) -> float:
    """Estimate the seconds that a pixel takes, without writing it."""
    if engine == "embree":
        return SECONDS_PER_RAY * (1 if samples == 1 else 1 + AVERAGED_SHARE * samples)
    return SECONDS_PER_SAMPLE * samples


def _seconds_of(plan: Plan, render: Render) -> float:
    loading_s = SECONDS_PER_RENDER if render.scene.source.capabilities.rendered else 0.0
    return loading_s + float(frame_seconds(plan, render, render.frames).sum())


def _bytes_of(plan: Plan, render: Render) -> float:
    pixels = render.camera.width_px * render.camera.height_px
    format_ = plan.format
    sizes = {modality: CHANNELS[modality].pixel_bytes(format_) for modality in format_.modalities}
    clean = len(render.frames) * sum(size.usual for size in sizes.values())
    perturbed = 0.0
    for modality, size in sizes.items():
        made = plan.parts_made.of(render.name, render.sequences, modality)
        images = sum(made.get(sequence.folder, 0.0) * len(sequence.frames) for sequence in render.sequences)
        perturbed += size.perturbed * images
    return pixels * (clean + perturbed)


def _byte_bounds(plan: Plan, render: Render) -> NDArray[np.float64]:
    """Return (2,): the least and the most bytes that the images of a render are likely to take."""
    bounds = np.zeros(2)
    for modality in plan.format.modalities:
        size, pixels = CHANNELS[modality].pixel_bytes(plan.format), _pixels(render, modality)
        bounds += pixels * len(render.frames) * np.array(size.clean)
        made = plan.parts_made.of(render.name, render.sequences, modality)
        for sequence in render.sequences:
            images = made.get(sequence.folder, 0.0) * len(sequence.frames)
            bounds += pixels * images * np.array(_bytes_per_pixel(sequence.setting, modality, size))
    return bounds


def _bytes_per_pixel(setting: Setting, modality: Modality, size: PixelBytes) -> tuple[float, float]:
    """Return between which figures the bytes of a pixel lie after a setting's steps."""
    grain = [step.perturbation.grain for step in setting.on(modality)]
    if not any(grain):
        return size.changed
    least = size.grainy if grain[-1] else size.changed  # a step after it, such as JPEG's, may take the noise away
    return least[0], size.grainy[1]
