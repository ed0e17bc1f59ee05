# SPDX-License-Identifier: GPL-3.0-or-later
"""A package of somebody else's with a perturbation of each kind, as it lies on Python's path when it is installed."""

import textwrap

NAME, VERSION = "studio-effects", "2.1"
ENTRY_POINTS = {"all": "studio_effects.effects", "backwards": "studio_effects.pairs:BACKWARDS"}

_HEAD = '''
"""{}"""

from dataclasses import dataclass

import numpy as np

from noisy_world.extend import {}


'''

MODULES = {
    "__init__.py": "",
    "effects/__init__.py": "",
    "effects/_shared.py": "WAVELENGTH_M = 4.0\n",
    "effects/lift.py": _HEAD.format("Motion: other poses.", "MotionPerturbation, Trajectory, key")
    + '''
@dataclass(frozen=True)
class Lift:
    """The camera hangs higher than planned, and shivers."""

    height_m: float = key("how much higher", unit="m", default=0.1, minimum=0, maximum=10)
    shiver_m: float = key("standard deviation along x, for each pose", unit="m", default=0.0, minimum=0, maximum=1)


def apply(trajectory, parameters, context):
    c2w = trajectory.c2w.copy()
    c2w[:, 2, 3] += parameters.height_m
    c2w[:, 0, 3] += [parameters.shiver_m * context.stream(frame=k).standard_normal() for k in range(len(c2w))]
    return Trajectory(c2w, trajectory.stamps_s)


PERTURBATION = MotionPerturbation(
    name="lift", label="Lift", order=15, parameters=Lift, source="none", apply=apply,
    severities={"height_m": (0.1, 0.2, 0.3, 0.4, 0.5)},
)
''',
    "effects/stutter.py": _HEAD.format("Motion: other frames.", "MotionPerturbation, key")
    + '''
@dataclass(frozen=True)
class Stutter:
    """Each pose is shown several times, and those that should follow are lost."""

    times: int = key("how often", default=2, minimum=1, maximum=100)


def choose(count, parameters, context):
    return np.arange(count) // parameters.times * parameters.times


PERTURBATION = MotionPerturbation(
    name="stutter", label="Stutter", order=30, parameters=Stutter, severities={}, source="none", choose=choose
)
''',
    "effects/warm.py": _HEAD.format("Colour.", "ColourPerturbation, key")
    + '''
@dataclass(frozen=True)
class Warm:
    """More red."""

    gain: float = key("what red is multiplied by", default=1.3, minimum=1, maximum=4)


def apply(rgb, parameters, context):
    made = rgb.copy()
    made[..., 0] *= np.float32(parameters.gain)
    return made


def build(canvas, given, served):
    graph = canvas.graph
    return graph.math("MULTIPLY", canvas.image, graph.vector(given["gain"], 1.0, 1.0))


PERTURBATION = ColourPerturbation(
    name="warm", label="Warm", stage="lens", order=5, parameters=Warm, source="none", apply=apply, build=build,
    severities={"gain": (1.1, 1.2, 1.3, 1.4, 1.5)},
)
''',
    "effects/grazing.py": _HEAD.format("Depth, by all that a sensor knows.", "DepthPerturbation, key")
    + '''
from ._shared import WAVELENGTH_M


@dataclass(frozen=True)
class Grazing:
    """Distance along the ray instead of depth, drifting with time, farther where it is dark, and uncertain."""

    drift_m_s: float = key("added for each second", unit="m/s", default=0.5, minimum=-10, maximum=10)
    dark_m: float = key("added where it is black", unit="m", default=0.2, minimum=0, maximum=10)
    jitter_m: float = key("added to a whole frame, at most", unit="m", default=0.05, minimum=0, maximum=1)


def apply(depth_m, parameters, context):
    rays = np.linalg.norm(context.intrinsics.ray_directions(), axis=-1)
    added_m = parameters.drift_m_s * context.stamp_s + parameters.dark_m * (1 - context.rgb.mean(axis=-1))
    added_m += parameters.jitter_m * context.stream("jitter").random()
    return np.where(depth_m > 0, depth_m * rays + added_m, 0).astype(np.float32)


PERTURBATION = DepthPerturbation(
    name="grazing", label="Grazing", order=5, parameters=Grazing, severities={}, source="none", apply=apply,
    needs_rgb=True,
)
''',
    "pairs.py": _HEAD.format("Pairing.", "PairingPerturbation, key")
    + '''
@dataclass(frozen=True)
class Backwards:
    """Depth runs backwards."""

    skip_last: bool = key("leave the last frame out", default=False)


def apply(count, parameters, context):
    paired = np.arange(count)[::-1].copy()
    if parameters.skip_last:
        paired[-1] = -1
    return paired


BACKWARDS = PairingPerturbation(
    name="backwards", label="Backwards", order=20, parameters=Backwards, severities={}, source="none", apply=apply
)
''',
}  # fmt: skip


def install(folder, name=NAME, version=VERSION, entry_points=ENTRY_POINTS, modules=MODULES, *, kind="perturbations"):
    """Write a distribution as an installer does; `modules` are texts by path inside its one package.

    kind: the group of its entry points; None where these are by kind already, a dictionary each.
    """
    package = folder / name.replace("-", "_")
    for path, text in modules.items():
        file = package / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text))
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    groups = entry_points if kind is None else {kind: entry_points}
    lines = []
    for group, entries in groups.items():
        lines += [f"[noisy_world.{group}]", *(f"{key} = {value}" for key, value in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder
