# SPDX-License-Identifier: GPL-3.0-or-later
"""Carrying out perturbations of exposure. Only this module calls their `apply` and `rays`."""

from collections.abc import Hashable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..datasets.images import read_only
from ..errors import NoisyWorldError
from ..trajectories.frame_request import AT_ONCE, RequestedRays
from .execution import Notes, format_value
from .exposing import Channels, SceneAround, TakenImages
from .given import left_alone
from .kinds import ExposurePerturbation
from .steps import Step


def exposure_key(steps: Sequence[Step[ExposurePerturbation]]) -> tuple[Hashable, ...]:
    """Return what is equal for steps that take equal frames of the same path."""
    return tuple((step.perturbation.name, tuple(asdict(step.parameters(step.severity)).items())) for step in steps)


def exposure_notes(steps: Sequence[Step[ExposurePerturbation]]) -> Notes:
    """Return what is done to every frame: each step with its parameters, and when its lines are exposed, in seconds."""
    found: Notes = []
    for step in steps:
        parameters = step.parameters(step.severity)
        severity = {} if step.severity is None else {"severity": step.severity}
        shutter = asdict(step.perturbation.shutter(parameters))
        found.append({"name": step.perturbation.name, **severity, "parameters": asdict(parameters), "shutter": shutter})
    return found


def rays_of(steps: Sequence[Step[ExposurePerturbation]]) -> RequestedRays:
    """Return which rays make a frame, as steps of exposure say."""
    rays = AT_ONCE
    for step in steps:
        if step.perturbation.rays is not None:
            rays = step.perturbation.rays(rays, step.parameters(step.severity))
    return rays


def expose(
    steps: Sequence[Step[ExposurePerturbation]], moments: SceneAround, taken: dict[str, int] | None = None
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the colour and the depth of a frame after those steps of exposure that have `apply`, at least one.

    moments: the clean images around the frame's time stamp, of the rays that the other steps say. The steps act one
    inside the other: what a later one takes is what those before it make around that moment. taken: is told by the
    name of each of how many moments it took colour for one frame.

    Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    *before, last = (step for step in steps if step.perturbation.apply is not None)
    assert last.perturbation.apply is not None

    asked = set[float]()

    def take(seconds: float, channels: Channels) -> TakenImages:
        if channels is None or "rgb" in channels:
            asked.add(seconds)
        if not before:
            return _Given(moments(seconds, channels))
        later = SceneAround(
            lambda more_s, also: moments(seconds + more_s, also), lambda times_s: moments.travel_px(seconds + times_s)
        )
        return _Given(_Exposed(*expose(before, later, taken)))

    with left_alone(last.perturbation):
        made = last.perturbation.apply(SceneAround(take, moments.travel_px), last.parameters(last.severity))
    if taken is not None:
        taken[last.perturbation.name] = len(asked)
    if not isinstance(made, tuple) or len(made) != 2 or any(not _is_float_image(item) for item in made):
        lines = [format_value(item) for item in made] if isinstance(made, tuple) else format_value(made)
        raise NoisyWorldError(
            f"{last.perturbation.name}: apply has to return colour and depth, each a float32 array or None, not {lines}"
        )
    return made


@dataclass(frozen=True)
class _Exposed:
    """What an exposure has made, for the next one."""

    rgb: NDArray[np.float32] | None
    depth_m: NDArray[np.float32] | None


@dataclass(frozen=True)
class _Given:
    """Images that are taken, read-only: other moments may show them too."""

    taken: TakenImages

    @property
    def rgb(self) -> NDArray[Any] | None:
        """Colour; None where it was not asked for."""
        rgb = self.taken.rgb
        return None if rgb is None else read_only(rgb)

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth; None where it was not asked for."""
        depth_m = self.taken.depth_m
        return None if depth_m is None else read_only(depth_m)


def _is_float_image(found: Any) -> bool:
    return found is None or (isinstance(found, np.ndarray) and found.dtype == np.float32 and found.ndim in (2, 3))
