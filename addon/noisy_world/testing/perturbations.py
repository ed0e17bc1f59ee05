# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a perturbation keeps its contract."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.images import as_float, rgb_bytes
from ..core.errors import NoisyWorldError
from ..core.perturbing.earlier_frames import alone
from ..core.perturbing.execution import move, perturb_colour, perturb_depth
from ..core.perturbing.exposing import SceneAround
from ..core.perturbing.exposures import expose
from ..core.perturbing.kinds import (
    KINDS,
    SEVERITIES,
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    MotionPerturbation,
    PairingPerturbation,
    Perturbation,
)
from ..core.perturbing.steps import Step
from ..core.trajectories.frame_request import AT_ONCE, RequestedRays
from .rules import CAMERA, images, path, require, require_name

FRAMES = 12
USUAL_SEVERITY = 3


def check_perturbation(perturbation: Perturbation) -> None:
    """Check a perturbation of any kind. Raises AssertionError with the rule that it breaks.

    Of all kinds: its defaults are its parameters at severity 3, and every severity from 1 to 5 gives parameters in
    their ranges. It gives the same twice, so a frame made alone equals that of a whole run, and it leaves what it is
    given as it is. Colour and depth keep shape and type and are finite; depth is never negative, and void stays void.
    A perturbation of colour that says repeatable gives the same in every frame; apply_bytes gives what apply does,
    rounded. Motion keeps the number of poses and their stamps, or chooses among those that there are; pairing names
    frames that there are, or -1.
    """
    require(isinstance(perturbation, KINDS), str(perturbation), f"is a {type(perturbation).__name__}, no perturbation")
    name = perturbation.name
    require_name(name)
    require(perturbation.label and perturbation.source, name, "needs a label, and the source of its severities")
    _check_severities(perturbation)
    for severity in (None, *SEVERITIES) if perturbation.severities else (None,):
        for temporal in perturbation.temporals or ("fresh",):
            step = Step[Any](perturbation, 0, severity, None, temporal, {})
            try:
                _check_work(perturbation, step)
            except NoisyWorldError as error:  # what a run would end with
                raise AssertionError(str(error)) from error


def _check_severities(perturbation: Perturbation) -> None:
    name, usual = perturbation.name, perturbation.parameters()
    for severity in SEVERITIES if perturbation.severities else ():
        try:
            found = perturbation.at_severity(severity)
        except (TypeError, ValueError) as error:
            raise AssertionError(f"{name}: severity {severity} gives no parameters: {error}") from error
        for key in perturbation.severities:
            value, default = getattr(found, key), getattr(usual, key)
            require(np.isfinite(value), name, f"{key} is {value} at severity {severity}")
            if severity == USUAL_SEVERITY:
                message = f"the default of {key} is {default}, but severity {USUAL_SEVERITY} says {value}"
                require(value == default, name, f"{message}: they have to be equal")


@dataclass(frozen=True)
class _Frame:
    """A frame to be perturbed, its arrays read-only."""

    index: int
    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]

    def context(self, step: Step[Any], index: int | None = None) -> FrameContext:
        """Return the context of a step on this frame; index: another number of it."""
        number = self.index if index is None else index
        where = FrameContext(
            number,
            (7, "scene", "setting"),
            step.temporal,
            stamp_s=0.05 * number,
            intrinsics=CAMERA,
            read_rgb=lambda: self.rgb,
            read_depth_m=lambda: self.depth_m,
            read_earlier=alone(self.rgb),
        )
        return step.context(where)


def _frame(index: int) -> _Frame:
    rgb, depth_m = images(0)
    for image in (rgb, depth_m):
        image.setflags(write=False)
    return _Frame(index, rgb, depth_m)


def _check_work(perturbation: Perturbation, step: Step[Any]) -> None:
    match perturbation:
        case ColourPerturbation():
            _check_colour(perturbation, step)
        case DepthPerturbation():
            _check_depth(perturbation, step)
        case MotionPerturbation():
            _check_motion(perturbation, step)
        case PairingPerturbation():
            _check_pairing(perturbation, step)
        case ExposurePerturbation():
            _check_exposure(perturbation, step)


def _twice(name: str, what: str, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Return what is made, which has to be equal when it is made again. What it is made from is read-only."""
    try:
        first, second = make(), make()
    except ValueError as error:
        changed = "read-only" in str(error)
        require(not changed, name, f"changes {what} that it is given; copy it")
        raise
    same = np.array_equal(first, second, equal_nan=True)
    require(same, name, f"gives another {what} for the same frame; draw from the context only")
    return first


def _check_colour(perturbation: ColourPerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)

    def made(index: int) -> NDArray[Any]:
        return perturb_colour(step, frame.rgb, step.severity, frame.context(step, index))

    image = _twice(name, "colour", lambda: made(4))
    require(np.isfinite(image).all(), name, "gives colour that is not finite")
    require(not np.shares_memory(image, frame.rgb), name, "returns the array that it is given; return a new one")
    if perturbation.repeatable:
        require(np.array_equal(image, made(5)), name, "says repeatable, but frames 4 and 5 differ for equal images")
    if (apply_bytes := perturbation.apply_bytes) is None:
        return
    rgb, parameters = rgb_bytes(frame.rgb), step.parameters(step.severity)
    rgb.setflags(write=False)
    found = _twice(name, "colour", lambda: apply_bytes(rgb, parameters, frame.context(step)))
    rounded = rgb_bytes(perturb_colour(step, as_float(rgb), step.severity, frame.context(step)))
    require(np.array_equal(found, rounded), name, "apply_bytes gives other bytes than apply, rounded")


def _check_depth(perturbation: DepthPerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)
    void = frame.depth_m == 0

    def made() -> NDArray[Any]:
        own = frame.context(step)
        found = perturbation.apply(frame.depth_m, step.parameters(step.severity), own)
        perturb_depth([step], frame.depth_m, FrameContext(4, (7, "", ""), intrinsics=CAMERA, read_rgb=own.read_rgb))
        return found

    depth_m = _twice(name, "depth", made)
    require(np.isfinite(depth_m).all(), name, "gives depth that is not finite; what has no depth is 0")
    require(depth_m.min() >= 0, name, f"gives depth of {depth_m.min():g} m; what has no depth is 0")
    require(not depth_m[void].any(), name, "gives depth where there was none; void (0) has to stay void")
    require(not np.shares_memory(depth_m, frame.depth_m), name, "returns the array that it is given; return a new one")


def _check_motion(perturbation: MotionPerturbation, step: Step[Any]) -> None:
    name, given, identifiers = perturbation.name, path(FRAMES), (7, "scene", "setting")
    c2w = _twice(name, "path", lambda: move([step], given, identifiers).c2w)
    rotations = c2w[:, :3, :3]
    rigid = np.abs(rotations @ rotations.swapaxes(-1, -2) - np.eye(3)).max() < 1e-6
    require(rigid and (np.linalg.det(rotations) > 0).all(), name, "gives poses that are not rigid")


def _check_pairing(perturbation: PairingPerturbation, step: Step[Any]) -> None:
    name, context = perturbation.name, step.sequence_context((7, "scene", "setting"))
    parameters = step.parameters(step.severity)
    paired = _twice(name, "pairing", lambda: np.asarray(perturbation.apply(FRAMES, parameters, context)))
    whole = paired.shape == (FRAMES,) and np.issubdtype(paired.dtype, np.integer)
    require(whole, name, f"has to give a whole number for each of {FRAMES} frames, not {paired.dtype} {paired.shape}")
    inside = (paired >= -1) & (paired < FRAMES)
    require(inside.all(), name, f"has to name frames from 0 to {FRAMES - 1}, or -1, not {paired[~inside][:1]}")


def _check_exposure(perturbation: ExposurePerturbation, step: Step[Any]) -> None:
    name, frame = perturbation.name, _frame(4)

    if perturbation.rays is not None:
        made_rays = [perturbation.rays(AT_ONCE, step.parameters(step.severity)) for _ in range(2)]
        require(
            isinstance(made_rays[0], RequestedRays), name, f"rays has to return RequestedRays, not {made_rays[0]!r}"
        )
        require(made_rays[0] == made_rays[1], name, "says other rays for the same parameters")
        return

    def made(which: int) -> NDArray[Any]:
        found = expose([step], SceneAround(lambda *_: frame))[which]
        require(found is not None, name, "leaves out an image that it is given")
        assert found is not None
        return found

    for which, (what, given) in enumerate((("colour", frame.rgb), ("depth", frame.depth_m))):
        image = _twice(name, what, lambda which=which: made(which))
        require(image.shape == given.shape, name, f"makes {what} of {image.shape} of {given.shape}")
        require(np.isfinite(image).all(), name, f"gives {what} that is not finite")
