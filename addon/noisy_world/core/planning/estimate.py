# SPDX-License-Identifier: GPL-3.0-or-later
"""What a plan takes, roughly: for --dry-run, and for the warning of a disk that is too small."""

from dataclasses import dataclass

from .plan import Plan

# Measured on two cores: what a ray, a pixel and a scene cost, and what a pixel weighs.
SECONDS_PER_SAMPLE = 3.5e-7
SECONDS_PER_PIXEL = 1.0e-7
SECONDS_PER_RENDER = 4.0
SECONDS_PER_PERTURBED_PIXEL = 6e-8
SECONDS_PER_COMPOSITED_PIXEL = 1.6e-7
BYTES_PER_PIXEL = {"jpg": 0.8, "png": 1.2, "depth": 0.5}


@dataclass(frozen=True)
class Estimate:
    """A rough guess of what a plan takes on two cores."""

    bytes_written: int
    seconds: float


def estimate(plan: Plan) -> Estimate:
    """Guess the bytes and the time of a plan from what a pixel cost where it was measured."""
    pixels = plan.camera.width_px * plan.camera.height_px
    format_ = plan.format
    kinds = {modality: format_.image if modality == "rgb" else "depth" for modality in format_.modalities}
    clean = plan.frame_count * sum(BYTES_PER_PIXEL[kind] for kind in kinds.values())
    perturbed = [
        (kind, len(sequence.frames))
        for sequence in plan.sequences
        for modality, kind in kinds.items()
        if getattr(sequence.setting, modality)
    ]
    size = pixels * (clean + sum(BYTES_PER_PIXEL[kind] * count for kind, count in perturbed))
    seconds = sum(count for _, count in perturbed) * pixels * SECONDS_PER_PERTURBED_PIXEL
    if plan.composites:
        composited = sum(len(sequence.frames) for sequence in plan.sequences if sequence.setting.composited)
        seconds += composited * pixels * SECONDS_PER_COMPOSITED_PIXEL
    for render in plan.renders:
        if render.scene.source.gives.rendered:
            per_pixel = plan.preset.spec.render.samples * SECONDS_PER_SAMPLE + SECONDS_PER_PIXEL
            seconds += SECONDS_PER_RENDER + len(render.frames) * pixels * per_pixel
    return Estimate(int(size), seconds)
