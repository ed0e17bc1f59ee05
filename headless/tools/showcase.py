# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame of the demo, and what each perturbation of colour makes of it in the compositor: for pictures of them."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from noisy_world.blender.compositor import Compositor
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.perturbing.steps import Step
from noisy_world.core.planning.exposed import render_options
from noisy_world.core.planning.source_paths import source_paths
from noisy_world.core.presets.preset import read_preset
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.pipeline.clean_frame import CleanFrame
from noisy_world.planning import make_plan

DEMO = Path(__file__).resolve().parents[2] / "presets" / "demo.yaml"
FRAME = 8  # chosen by eye: it shows near and far surfaces
SEED = 1


def shown_perturbations() -> list[ColourPerturbation]:
    """Return the perturbations of colour that have a node group, in the order of propagation."""
    return [item for item in registry().values() if isinstance(item, ColourPerturbation) and item.build]


def demo_camera() -> Intrinsics:
    """Return the demo's camera."""
    return make_plan(read_preset(DEMO, ["settings=[{name: clean}]"])).renders[0].camera


def demo_frame() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Render a frame of the demo: encoded colour (H, W, 3), planar depth (H, W) in metres. Empties the file."""
    plan = make_plan(read_preset(DEMO, ["settings=[{name: clean}]"]))
    render = plan.renders[0]
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan, render), print)
        frame = source.frame(paths.request(FRAME))
    clean = CleanFrame(FRAME, frame)
    return clean.float_rgb(), clean.depth_m


def perturbed(
    rgb: NDArray[np.float32], depth_m: NDArray[np.float32], severities: Iterable[float]
) -> dict[tuple[str, float], NDArray[np.uint8]]:
    """Return (H, W, 3) uint8 by the perturbation's name and the severity."""
    chains = {
        f"{item.name} {severity:g}": [step(item, severity)] for severity in severities for item in shown_perturbations()
    }
    with Compositor((rgb.shape[1], rgb.shape[0]), chains, rgb.shape[1]) as compositor:
        made = compositor.perturb(rgb, {name: (FRAME, (SEED, "showcase", name)) for name in chains}, depth_m)
    return {(name.split()[0], float(name.split()[1])): image for name, (image, _) in made.items() if image is not None}


def step(perturbation: ColourPerturbation, severity: float) -> Step:
    """Return the step of a preset's `{name: {severity: ...}}`."""
    (found,) = parse_steps([{perturbation.name: {"severity": severity}}], ConfigPath("showcase"), registry())
    return found
