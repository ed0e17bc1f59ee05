# SPDX-License-Identifier: GPL-3.0-or-later
"""Carrying out each kind of perturbation. Only this module calls `apply` and `choose`."""

import contextlib
import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, Generic, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.frame_request import AT_ONCE, RequestedRays
from ..core.geometry import Intrinsics
from ..core.mirrored import Mirrored
from ..core.srgb import decoded, encoded
from ..core.trajectory import Trajectory
from ..images.pixels import as_bytes, as_float, read_only, rgb_bytes
from .kinds import (
    Channels,
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    Identifiers,
    MotionPerturbation,
    PairingPerturbation,
    Perturbation,
    SceneAround,
    TakenImages,
)
from .shares import mixed
from .steps import SENSOR_STREAM, Step

# Code of perturbations, carried out. Settings share clean images, so what it is given is read-only: otherwise one that
# writes in place would change the frames of all others.


_REFUSED = re.compile("read-?only")  # numpy's words and OpenCV's


@contextlib.contextmanager
def left_alone(perturbation: Perturbation) -> Iterator[None]:
    """Carry out code of a perturbation. Raises NoisyWorldError, which names it, where it writes into what is given."""
    try:
        yield
    except Exception as error:  # OpenCV's own is none of Python's
        if isinstance(error, OSError) or not _REFUSED.search(str(error)):
            raise
        package = perturbation.distribution
        whose = f"{perturbation.name} of {package}" if package else perturbation.name
        problem = f"{whose}: writes into what it is given, which other settings share ({error})"
        raise NoisyWorldError(problem, remedy="its code has to copy that first") from error


Kind = TypeVar("Kind", ColourPerturbation, DepthPerturbation)
P = TypeVar("P", bound=ColourPerturbation | DepthPerturbation)

MotionSteps: TypeAlias = Sequence[Step[MotionPerturbation]]
MotionPart: TypeAlias = tuple[Step[MotionPerturbation], ...]
Notes: TypeAlias = list[dict[str, Any]]
"""What was done to a frame, step by step, for the provenance."""

Active: TypeAlias = tuple[tuple[Step[Kind], FrameContext, float | None], ...]
"""Steps, each with its context and the severity that it has in a frame: above all those that do something to it."""


def _acting(drawn: Active[Kind]) -> Active[Kind]:
    return tuple(item for item in drawn if item[2] != 0)


def work_key(active: Active[Any]) -> tuple[Hashable, ...]:
    """Return what makes equal images of the same clean frame, whatever the sequence.

    That is each step's perturbation and parameters, and the random numbers that it is given, unless it asks for none;
    and the camera's motion, if it looks at that.
    """
    return tuple(_key_of(step, context, step.parameters(severity)) for step, context, severity in active)


def _key_of(step: Step[Any], context: FrameContext, parameters: Any) -> tuple[Hashable, ...]:
    kind = step.perturbation
    named: tuple[Hashable, ...] = kind.name, tuple(asdict(parameters).items())
    if step.share is not None:
        named = *named, step.share.key(context.index)
    if isinstance(kind, ColourPerturbation) and kind.is_repeatable(parameters):
        return *named, None, None
    drawn = context.identifiers, context.index, context.temporal, context.earlier_key
    return *named, drawn, None if context.motion is None else context.motion.key


# --- motion ---


def split_motion(steps: MotionSteps, *, exposed: bool = False) -> tuple[MotionPart, MotionPart]:
    """Split steps of motion after the last one that moves poses. exposed: whether a setting has steps of exposure.

    The first part leads to other poses, so its frames have to be rendered; the second only chooses among these frames.
    Where an exposure looks at what is between frames, all are in the first: a camera that leaves poses out is faster
    there too. Steps of severity 0 do nothing and are in neither.
    """
    active = tuple(step for step in steps if step.severity != 0)
    if exposed:
        return active, ()
    moves = [place for place, step in enumerate(active) if step.perturbation.apply is not None]
    end = moves[-1] + 1 if moves else 0
    return active[:end], active[end:]


def move(steps: MotionSteps, trajectory: Trajectory, identifiers: Identifiers) -> Trajectory:
    """Return a path after steps of motion, carried out in order. identifiers: of the sequence.

    Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    for step in steps:
        if step.severity == 0:
            continue
        if step.perturbation.apply is None:
            trajectory = take_poses(trajectory, _chosen(step, len(trajectory), identifiers))
            continue
        context = step.sequence_context(identifiers)
        with left_alone(step.perturbation):
            moved = step.perturbation.apply(trajectory, step.parameters(step.severity), context)
        if len(moved) != len(trajectory) or not np.array_equal(moved.stamps_s, trajectory.stamps_s):
            raise NoisyWorldError(
                f"{step.perturbation.name}: made {len(moved)} poses of {len(trajectory)}, or other time stamps; apply "
                "has to keep both, and choose is what leaves poses out"
            )
        name, posed = step.perturbation.name, trajectory.posed if moved.posed is None else moved.posed
        moved = replace(moved, posed=posed, shots=trajectory.shots)
        if step.perturbation.continuous:
            trajectory = moved
        else:
            trajectory = replace(moved, curve=None, independent=f"{name} moves each pose by itself")
    return trajectory


def chosen_poses(steps: MotionSteps, count: int, identifiers: Identifiers) -> NDArray[np.int64] | None:
    """Return (N,): the numbers of the poses that are shown, of `count`, after all choices; None without a choice.

    identifiers: of the sequence. Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    shown: NDArray[np.int64] | None = None
    for step in steps:
        if step.severity == 0 or step.perturbation.choose is None:
            continue
        chosen = _chosen(step, count if shown is None else len(shown), identifiers)
        shown = chosen if shown is None else shown[chosen]
    return shown


def drawn_motion(steps: MotionSteps, count: int, identifiers: Identifiers) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Return by perturbation what steps of motion drew for each pose of the path after them: by name, (N, ...).

    count: the poses of the path before them. identifiers: of the sequence. Only perturbations that say so are named.
    Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    found: dict[str, dict[str, NDArray[np.float64]]] = {}
    for step in steps:
        if step.severity == 0:
            continue
        if step.perturbation.choose is not None:
            chosen = _chosen(step, count, identifiers)
            found = {name: {key: values[chosen] for key, values in made.items()} for name, made in found.items()}
            count = len(chosen)
        elif step.perturbation.drawn is not None:
            found[step.perturbation.name] = _drawn(step, count, identifiers)
    return found


def _drawn(step: Step[MotionPerturbation], count: int, identifiers: Identifiers) -> dict[str, NDArray[np.float64]]:
    assert step.perturbation.drawn is not None
    made = step.perturbation.drawn(count, step.parameters(step.severity), step.sequence_context(identifiers))
    values = {key: np.asarray(value, np.float64) for key, value in made.items()}
    if wrong := [key for key, value in values.items() if value.shape[:1] != (count,) or not np.isfinite(value).all()]:
        raise NoisyWorldError(
            f"{step.perturbation.name}: drawn has to return finite numbers for each of {count} poses, but "
            f"{wrong[0]} is {format_value(values[wrong[0]])}"
        )
    return values


def take_poses(trajectory: Trajectory, chosen: NDArray[np.int64] | None) -> Trajectory:
    """Return the chosen poses of a path, with the path's first stamps; the whole path for None."""
    if chosen is None:
        return trajectory
    return trajectory.followed(chosen)


def _chosen(step: Step[MotionPerturbation], count: int, identifiers: Identifiers) -> NDArray[np.int64]:
    assert step.perturbation.choose is not None
    chosen = step.perturbation.choose(count, step.parameters(step.severity), step.sequence_context(identifiers))
    if not _holds_indices(chosen, 0, count) or not 1 <= len(chosen) <= count:
        raise NoisyWorldError(
            f"{step.perturbation.name}: choose has to return 1 to {count} whole numbers from 0 to {count - 1}, one for "
            f"each pose that is shown of {count}, not {format_value(chosen)}"
        )
    return np.asarray(chosen, dtype=np.int64)


# --- colour ---


@dataclass(frozen=True)
class _ImageWork(Generic[P]):
    """What the steps of one kind do to one image of a sequence. drawn: all of them, those of severity 0 too."""

    drawn: Active[P]

    @classmethod
    def of(cls, steps: Sequence[Step[P]], where: FrameContext) -> Self:
        """Draw the severities. where: the frame that the image belongs to, with the identifiers of its sequence."""
        found = [(step, step.context(where)) for step in steps]
        return cls(tuple((step, context, step.severity_of(context)) for step, context in found))

    @cached_property
    def active(self) -> Active[P]:
        """The steps that do something to the image."""
        return _acting(self.drawn)

    @property
    def notes(self) -> Notes:
        """What is done, for the provenance."""
        return [step.note(context, severity) for step, context, severity in self.drawn]

    @property
    def key(self) -> Hashable:
        """What is equal for equal work on the same clean frame, whatever the sequence."""
        return work_key(self.active)


class ColourWork(_ImageWork[ColourPerturbation]):
    """What the steps of colour do to the colour of one frame."""

    @cached_property
    def active(self) -> Active[ColourPerturbation]:
        """The steps that do something; what the camera's automatics decide is found when it is first asked for."""
        return deciding(_acting(self.drawn))

    @property
    def decided(self) -> Mapping[str, float]:
        """What the camera's automatics decided for the frame, by name; empty without any."""
        return self.active[-1][1].decided if self.active else {}

    @property
    def needs_depth(self) -> bool:
        """Whether a step that does something looks at the frame's depth."""
        return any(step.perturbation.needs_depth for step, _, _ in self.active)

    @property
    def takes_bytes(self) -> bool:
        """Whether it is a single step that works on bytes: float colour is then rounded before it, as its file is."""
        if len(self.active) != 1:
            return False
        step = self.active[0][0]
        return step.share is None and step.perturbation.apply_bytes is not None

    def on(self, rgb: NDArray[Any]) -> NDArray[np.uint8] | None:
        """Do it to a colour image as `perturb_rgb` says; None where it is the identity."""
        if not self.active:
            return None
        if self.takes_bytes:
            ((step, context, severity),) = self.active
            assert step.perturbation.apply_bytes is not None, "it takes bytes"
            with left_alone(step.perturbation):
                return step.perturbation.apply_bytes(read_only(as_bytes(rgb)), step.parameters(severity), context)
        return on_encoded(self.active, as_float(rgb))


def deciding(active: Active[ColourPerturbation]) -> Active[ColourPerturbation]:
    """Return the steps with contexts that hold what automatics decide, each its own and those of steps before it."""
    if all(step.perturbation.automatic is None for step, _, _ in active):
        return active
    found: list[tuple[Step[ColourPerturbation], FrameContext, float | None]] = []
    before: Callable[[], Mapping[str, float]] = dict[str, float]
    for step, context, severity in active:
        own = replace(context, read_decided=before)
        if step.perturbation.automatic is not None:
            before = cache(partial(_decisions, step, severity, own))
            own = replace(context, read_decided=before)
        found.append((step, own, severity))
    return tuple(found)


def _decisions(step: Step[ColourPerturbation], severity: float | None, context: FrameContext) -> Mapping[str, float]:
    automatic = step.perturbation.automatic
    assert automatic is not None
    with left_alone(step.perturbation):
        made = automatic.decides(step.parameters(severity), context)
    if wrong := [name for name, value in made.items() if not math.isfinite(value)]:
        raise NoisyWorldError(f"{step.perturbation.name}: decides has to return finite numbers, but {wrong[0]} is not")
    return {**context.decided, **{name: float(value) for name, value in made.items()}}


def on_encoded(active: Active[ColourPerturbation], image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Carry out steps on (H, W, 3), encoded, float32 in [0, 1], and round once at the end.

    What is brighter than white passes between steps that act on light in the sensor, which alone decides what it holds.
    """
    for number, (step, context, severity) in enumerate(active):
        if number:
            bright = step.perturbation.on_light and active[number - 1][0].perturbation.on_light
            # What a step returns may be what it was given, which is not to be written into.
            image = np.clip(image, 0.0, None if bright else 1.0, out=image if image.flags.writeable else None)
        bright = step.perturbation.on_light and any(
            item.perturbation.on_light for item, _, _ in active[number + 1 :][:1]
        )
        image = shown_share(step, image, perturb_colour(step, image, severity, context), context, bright=bright)
    return rgb_bytes(image)  # which clips what the last step made


def perturb_rgb(
    steps: Sequence[Step[ColourPerturbation]], rgb: NDArray[Any], where: FrameContext
) -> tuple[NDArray[np.uint8] | None, Notes]:
    """Perturb a colour image and round it once, at the end; before a single step that works on bytes.

    rgb: (H, W, 3) sRGB-encoded RGB, float32 in [0, 1] or uint8. Between the steps values are float, clipped to [0, 1].
    where: the frame, with the identifiers of its sequence and its depth for steps that ask for it.
    Returns (H, W, 3) uint8, or None where every severity is 0, which is the identity; and what was done.
    """
    work = ColourWork.of(steps, where)
    return work.on(rgb), work.notes


def perturb_colour(
    step: Step[ColourPerturbation], rgb: NDArray[np.float32], severity: float | None, context: FrameContext
) -> NDArray[np.float32]:
    """Carry out the whole effect of a step on (H, W, 3) float32; the result may lie outside [0, 1].

    context: the step's own. `shown_share` then takes the share of it that shows.
    """
    if step.perturbation.needs_depth and context.read_depth_m is None:
        raise TypeError(f"{step.perturbation.name} needs the frame's depth; give depth_m")
    if step.perturbation.automatic is not None and context.read_decided is None:
        ((_, context, _),) = deciding(((step, context, severity),))
    with left_alone(step.perturbation):
        made = step.perturbation.apply(read_only(rgb), step.parameters(severity), context)
    return _checked_image(step, made, rgb)


def shown_share(
    step: Step[ColourPerturbation],
    before: NDArray[np.float32],
    made: NDArray[np.float32],
    context: FrameContext,
    *,
    bright: bool,
) -> NDArray[np.float32]:
    """Return what a step's mix and mask leave of its effect: all of it, as it is, where it has neither.

    before, made: (H, W, 3), the image and the whole effect. bright: what is brighter than white stays.
    """
    if step.share is None:
        return made
    clipped = np.clip(made, 0.0, None if bright else 1.0)
    return mixed(before, clipped, step.share.at(context.index, (made.shape[1], made.shape[0])))


# --- depth ---


class DepthWork(_ImageWork[DepthPerturbation]):
    """What the steps of depth do to the depth of one frame."""

    def parted(self, camera: Intrinsics, read_rgb: Callable[[], NDArray[np.float32]]) -> "tuple[DepthWork, DepthWork]":
        """Return what a rig's sensor does, by its own camera and the colour that it sees, and what is done then."""
        own = [
            (step, replace(context, intrinsics=camera, read_rgb=read_rgb if context.read_rgb else None), severity)
            for step, context, severity in self.active
            if step.stream == SENSOR_STREAM
        ]
        rest = [item for item in self.active if item[0].stream != SENSOR_STREAM]
        return DepthWork(tuple(own)), DepthWork(tuple(rest))

    def on(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Do it to planar depth (H, W) in metres, 0 = void; None where it is the identity."""
        image = None
        for step, context, severity in self.active:
            if step.perturbation.needs_rgb and context.read_rgb is None:
                raise TypeError(f"{step.perturbation.name} needs the frame's colour; give rgb")
            before = depth_m if image is None else image
            with left_alone(step.perturbation):
                made = step.perturbation.apply(read_only(before), step.parameters(severity), context)
            image = _checked_image(step, made, before)
        return image


def perturb_depth(
    steps: Sequence[Step[DepthPerturbation]], depth_m: NDArray[np.float32], where: FrameContext
) -> tuple[NDArray[np.float32] | None, Notes]:
    """Perturb planar depth (H, W) in metres, 0 = void. Returns None where every severity is 0; and what was done.

    where: the frame that the depth belongs to, with the identifiers of its sequence, and its colour for steps that ask
    for it.
    """
    work = DepthWork.of(steps, where)
    return work.on(depth_m), work.notes


def _checked_image(step: Step[Any], made: NDArray[np.float32], before: NDArray[np.float32]) -> NDArray[np.float32]:
    if not isinstance(made, np.ndarray) or made.shape != before.shape or made.dtype != np.float32:
        wanted = f"a float32 array of shape {before.shape}"
        raise NoisyWorldError(f"{step.perturbation.name}: apply has to return {wanted}, not {format_value(made)}")
    return made


# --- pairing ---


def paired_depth(
    steps: Sequence[Step[PairingPerturbation]], count: int, identifiers: Identifiers
) -> NDArray[np.int64] | None:
    """Return (count,): for each frame the one whose depth is paired with it, -1 if it is left out; None without steps.

    Each step acts on the pairs that the steps before it made; a frame that is left out stays out.
    identifiers: of the sequence. Raises NoisyWorldError naming a perturbation that breaks its contract.
    """
    paired: NDArray[np.int64] | None = None
    for step in steps:
        if step.severity == 0:
            continue
        made = step.perturbation.apply(count, step.parameters(step.severity), step.sequence_context(identifiers))
        if not _holds_indices(made, -1, count) or len(made) != count:
            raise NoisyWorldError(
                f"{step.perturbation.name}: apply has to return {count} whole numbers from -1 to {count - 1}, one for "
                f"each frame, not {format_value(made)}"
            )
        paired = made.astype(np.int64) if paired is None else _followed(paired, made)
    return paired


def _followed(first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    through = np.where(second >= 0, first[second], -1)
    return np.where(first >= 0, through, -1)


def _holds_indices(found: Any, lowest: int, count: int) -> bool:
    """Tell whether something is an array (N,) of whole numbers from `lowest` to `count - 1`."""
    if not isinstance(found, np.ndarray) or found.ndim != 1 or not np.issubdtype(found.dtype, np.integer):
        return False
    return bool(((found >= lowest) & (found < count)).all())


def format_value(found: Any) -> str:
    """Return what a perturbation gave in place of an array, or the array's type and shape, for messages."""
    if not isinstance(found, np.ndarray):
        return f"a {type(found).__name__}"
    spread = f", values {found.min()} to {found.max()}" if found.ndim == 1 and found.size else ""
    return f"{found.dtype} of shape {found.shape}{spread}"


# Carrying out perturbations of exposure. Only this module calls their `apply` and `rays`.


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


# --- light ---


def acts_on_light(work: ColourWork) -> bool:
    """Tell whether a step acts on light, so before the view transform."""
    return any(step.perturbation.acts_on_light for step, _, _ in work.active)


def on_light(work: ColourWork, rgb: NDArray[np.float32], mirrored: Mirrored | None = None) -> NDArray[np.float32]:
    """Do what acts on light to scene-linear light (H, W, 3), of any brightness; return light.

    mirrored: what its surfaces mirror, which is seen through the air behind them first; None where that counts as near
    as they are.
    """
    if mirrored is not None:
        rgb = _seen_in_mirrors(work, rgb, mirrored)
    for step, context, severity in work.active:
        if step.perturbation.acts_on_light:
            rgb = perturb_light(step, rgb, severity, context)
    return rgb


def _seen_in_mirrors(work: ColourWork, rgb: NDArray[np.float32], mirrored: Mirrored) -> NDArray[np.float32]:
    """Return light (H, W, 3) whose mirrored part has come through the air that the steps lay behind the mirrors."""
    own: NDArray[np.float32] = rgb * mirrored.share
    rest: NDArray[np.float32] = rgb - own
    for step, context, severity in work.active:
        if step.perturbation.even_air is not None:
            air = step.perturbation.even_air(rgb, step.parameters(severity), replace(context, lit=True))
            own = shown_share(step, own, mirrored.through(air, own), context, bright=True)
    return np.add(rest, own, dtype=np.float32)


def after_light(work: ColourWork, shown: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Do the rest to what the view transform has made of `on_light`: (H, W, 3), display-encoded in [0, 1]."""
    return on_encoded(tuple(item for item in work.active if not item[0].perturbation.acts_on_light), shown)


def perturb_light(
    step: Step[ColourPerturbation], light: NDArray[np.float32], severity: float | None, context: FrameContext
) -> NDArray[np.float32]:
    """Carry out one step on scene-linear light (H, W, 3) float32, of any brightness; the result is at least 0.

    Some carry out their node group. What only averages works on light itself; the others as ever, on encoded values, by
    sRGB's curve, which goes on above 1.
    """
    context = replace(context, lit=True)
    if step.perturbation.nodes is not None and step.perturbation.nodes.draws_lit:
        from .as_nodes import as_nodes

        made = as_nodes(step.perturbation, light, step.parameters(severity), context)
    elif step.perturbation.averages:
        made = perturb_colour(step, light, severity, context)
    else:
        made = decoded(perturb_colour(step, encoded(light), severity, context))
    return shown_share(step, light, np.maximum(made, np.float32(0)), context, bright=True)


# --- frames that were shown before ---
