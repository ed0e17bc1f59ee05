# SPDX-License-Identifier: GPL-3.0-or-later
"""A rough estimate of a plan's time and disk space, for --dry-run and the warning of a disk that is too small."""

from dataclasses import dataclass

from ..datasets.layouts import Modality
from .plan import Plan, Render

# Measured on two cores at 1200 x 680, and rounded.
SECONDS_PER_SAMPLE = 3.5e-7  # a ray in Cycles: 0.29 s for a frame of one sample
SECONDS_PER_PIXEL = 1.0e-7  # reading the render, encoding and writing: 0.08 s a frame
SECONDS_PER_RAY = 1.7e-7  # engine embree, encoding and writing included: 0.14 s a frame
SECONDS_PER_RENDER = 4.0  # loading a scene
SECONDS_PER_PERTURBED_PIXEL = 6e-8  # perturbing and encoding: 0.05 s a frame
SECONDS_PER_COMPOSITED_PIXEL = 1.6e-7  # in Blender's compositor, in addition: 0.13 s a frame
BYTES_PER_PIXEL = {"jpg": 0.8, "png": 1.2, "depth": 0.5}


@dataclass(frozen=True)
class Estimate:
    """A rough guess of what a plan takes on two cores."""

    bytes_written: int
    seconds: float


def image_bytes(plan: Plan, render: Render, modality: Modality) -> int:
    """Estimate the bytes of an image of a render."""
    kind = plan.format.image if modality == "rgb" else "depth"
    return int(render.camera.width_px * render.camera.height_px * BYTES_PER_PIXEL[kind])


def size_text(count: int) -> str:
    """Return a number of bytes in words: "3.2 GB", "17 MB", "1.4 MB", "600 bytes"."""
    for size, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}" if count < 10 * size else f"{count / size:.0f} {unit}"
    return f"{count} bytes"


def estimate(plan: Plan) -> Estimate:
    """Estimate the bytes and the time of a plan from the measured costs of a pixel."""
    parts = [_of_render(plan, render) for render in plan.renders]
    return Estimate(int(sum(size for size, _ in parts)), sum(seconds for _, seconds in parts))


def _of_render(plan: Plan, render: Render) -> tuple[float, float]:
    """Estimate the bytes and the seconds of a render."""
    pixels = render.camera.width_px * render.camera.height_px
    format_ = plan.format
    kinds = {modality: format_.image if modality == "rgb" else "depth" for modality in format_.modalities}
    clean = len(render.frames) * sum(BYTES_PER_PIXEL[kind] for kind in kinds.values())
    perturbed = [
        (kind, len(sequence.frames))
        for sequence in render.sequences
        for modality, kind in kinds.items()
        if getattr(sequence.setting, modality)
    ]
    size = pixels * (clean + sum(BYTES_PER_PIXEL[kind] * count for kind, count in perturbed))
    seconds = sum(count for _, count in perturbed) * pixels * SECONDS_PER_PERTURBED_PIXEL
    if plan.composites:
        composited = sum(len(sequence.frames) for sequence in render.sequences if sequence.setting.composited)
        seconds += composited * pixels * SECONDS_PER_COMPOSITED_PIXEL
    if render.scene.source.gives.rendered:
        spec = plan.preset.spec.render
        in_blender = spec.samples * SECONDS_PER_SAMPLE + SECONDS_PER_PIXEL
        per_pixel = in_blender if spec.in_blender else SECONDS_PER_RAY
        seconds += SECONDS_PER_RENDER + len(render.frames) * pixels * per_pixel
    return size, seconds
