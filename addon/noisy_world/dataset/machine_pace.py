# SPDX-License-Identifier: GPL-3.0-or-later
"""What this machine takes for a plan's images: a few of them are made in a second, and time the rest."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..core.errors import NoisyWorldError
from ..core.geometry import Intrinsics
from ..core.machine import available_threads
from ..layouts import Modality
from ..perturbations.execution import ColourWork, DepthWork
from ..perturbations.kinds import FrameContext
from .plan import Plan, Render
from .sequence import PlannedSequence

LONGEST_S = 1.0  # that is spent; chosen: a dry run is waited for
SAMPLE_PX = 320  # the width of the images; what takes time in them grows with their pixels
THREADS = 2  # the constants of `estimate` were measured on as many
ENCODED_PIXEL_S = {"png": 2.8e-8, "jpg": 1.05e-8, "depth": 7.8e-9}  # of the sample, where those were measured
FACTOR_S = 0.1  # that encoding is repeated for, so that other work on the machine is felt; chosen
TRIED = 16  # frames among which one is looked for that is not left as it was, where the severity varies


@dataclass(frozen=True)
class MachinePace:
    """How fast this machine is. factor: how much longer things take than where the constants were measured.

    pixel_s: by setting and channel, seconds of a perturbed pixel with its encoding, of those that were tried.
    """

    factor: float = 1.0
    pixel_s: Mapping[tuple[str, Modality], float] = field(default_factory=dict)

    def perturbed_s(self, sequence: PlannedSequence, modality: Modality, usual_s: float) -> float:
        """Return the seconds of a perturbed pixel: as tried, else the mean of what was tried, else the usual."""
        known = self.pixel_s.get((sequence.setting.name, modality))
        if known is not None:
            return known
        others = [value for (_, other), value in self.pixel_s.items() if other == modality]
        return float(np.mean(others)) if others else self.factor * usual_s


def measured_pace(plan: Plan, longest_s: float = LONGEST_S) -> MachinePace:
    """Make an image of as many settings as the time allows, and return how long they take."""
    render = next((item for item in plan.renders if item.sequences), None)
    if render is None:
        return MachinePace()
    end_s = time.perf_counter() + longest_s
    sample = _Sample.of(render)
    factor = _machine_factor(plan, sample)
    found: dict[tuple[str, Modality], float] = {}
    settings = {sequence.setting.name: sequence for item in plan.renders for sequence in item.sequences}
    mixed = np.random.default_rng(0).permutation(len(settings))  # where time ends, every family has been tried
    for sequence in (list(settings.values())[place] for place in mixed):
        for modality in sample.held(plan):
            if time.perf_counter() > end_s:
                return MachinePace(factor, found)
            if not sequence.setting.on(modality) or (modality == "rgb" and sequence.setting.composited):
                continue
            seconds = _of_setting(plan, sequence, modality, sample)
            if seconds is not None:
                found[sequence.setting.name, modality] = (
                    seconds / sample.pixels / max(1, min(available_threads(), THREADS))
                )
    return MachinePace(factor, found)


def _machine_factor(plan: Plan, sample: "_Sample") -> float:
    """Return how much longer the sample's images take to encode than where the constants were measured."""
    held = [name for name in sample.held(plan) if name == "depth" or plan.format.colour == "rgb"]  # grey is a third

    def encoded() -> None:
        for name in held:
            CHANNELS[name].encode_clean(sample.image(name), plan.format)

    if not held:
        return 1.0
    encoded()  # once for what is only imported
    image = "png" if plan.format.image == "exr" else plan.format.image
    usual_s = sum(ENCODED_PIXEL_S["depth" if name == "depth" else image] for name in held)
    begun_s, count = time.perf_counter(), 0
    while time.perf_counter() - begun_s < FACTOR_S:
        encoded()
        count += 1
    return (time.perf_counter() - begun_s) / count / (usual_s * sample.pixels)


@dataclass(frozen=True, eq=False)
class _Sample:
    """A frame to try things on: a slanted, textured plane. rgb: (H, W, 3) float32; depth_m: (H, W)."""

    camera: Intrinsics
    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]

    @classmethod
    def of(cls, render: Render) -> "_Sample":
        camera = render.camera
        scale = min(1.0, SAMPLE_PX / camera.width_px)
        width, height = max(1, round(scale * camera.width_px)), max(1, round(scale * camera.height_px))
        small = replace(
            camera,
            width_px=width,
            height_px=height,
            **{name: scale * getattr(camera, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")},
        )
        across, down = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
        waves = 0.5 + 0.2 * np.sin(40 * across) * np.cos(30 * down)
        rgb = np.stack([waves, 0.8 * waves + 0.1 * across, 0.6 * waves + 0.2 * down], axis=-1)
        grain = np.random.default_rng(0).normal(0.0, 0.02, rgb.shape)  # as much as a textured room has
        return cls(small, np.clip(rgb + grain, 0, 1).astype(np.float32), (1.5 + 3 * across).astype(np.float32))

    @property
    def pixels(self) -> int:
        return self.depth_m.size

    def held(self, plan: Plan) -> list[Modality]:
        return [name for name in ("rgb", "depth") if name in plan.format.modalities]

    def image(self, modality: Modality) -> NDArray[Any]:
        return self.rgb if modality == "rgb" else self.depth_m


def _of_setting(plan: Plan, sequence: PlannedSequence, modality: Modality, sample: _Sample) -> float | None:
    """Return the seconds of a perturbed image; None where a step needs what the sample does not have."""
    setting = sequence.setting
    context = FrameContext(
        0,
        sequence.identifiers,
        stamp_s=0.0,
        intrinsics=sample.camera,
        read_rgb=(lambda: sample.rgb) if setting.needs_rgb else None,
        read_depth_m=(lambda: sample.depth_m) if setting.needs_depth else None,
        shutter=setting.shutter,
    )

    def work(index: int) -> ColourWork | DepthWork:
        where = replace(context, index=index)
        return ColourWork.of(setting.rgb, where) if modality == "rgb" else DepthWork.of(setting.depth, where)

    def made() -> None:
        image = work(acting).on(sample.image(modality))
        if image is not None:
            CHANNELS[modality].encode(image, plan.format)

    try:
        acting = next((index for index in range(TRIED) if work(index).active), 0)
        made()  # once for what is only done for the first frame
        return _seconds(made)
    except (NoisyWorldError, TypeError, ValueError):  # of a path, of frames before it, of a lit scene's light
        return None


def _seconds(work: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    work()
    return time.perf_counter() - start_s
