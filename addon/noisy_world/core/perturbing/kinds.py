# SPDX-License-Identifier: GPL-3.0-or-later
"""The five kinds of perturbation, each with the signature of its execution, and the order of the stages.

A perturbation is one file with a `PERTURBATION`. Presets, panels, sockets, `--list` and the tests are derived from it.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from ..installed import Distribution
from ..streams import integers_of_frames, stream
from ..trajectories.frame_request import RequestedRays, Shutter
from ..trajectories.motion import CameraMotion
from ..trajectories.trajectory import Trajectory
from .exposing import ExposureApply
from .parameter_rules import check_no_temporals, check_parameters

Identifiers: TypeAlias = tuple[str | int, ...]
"""Identifiers of random streams: the preset's seed, scene, setting; then the perturbation and its occurrence."""

ColourStage: TypeAlias = Literal["environment", "lens", "sensor", "post"]
Stage: TypeAlias = Literal["motion", "exposure", ColourStage, "depth", "pairing"]
"""A stage of propagation, as in "From Perfect to Noisy World Simulation"; STAGES has them in order."""

STAGES: tuple[Stage, ...] = ("motion", "exposure", "environment", "lens", "sensor", "post", "depth", "pairing")
COLOUR_STAGES: tuple[ColourStage, ...] = ("environment", "lens", "sensor", "post")
LIGHT_STAGES: tuple[ColourStage, ...] = ("environment", "lens")
"""Those before a sensor: on lit frames they act on scene-linear light, before the view transform."""

Temporal: TypeAlias = Literal["fresh", "fixed", "drift"]
"""How a random pattern changes from frame to frame: drawn anew, kept, or moved smoothly."""

SEVERITIES = (1, 2, 3, 4, 5)  # as ImageNet-C and the paper
RESERVED = ("severity", "mode", "levels", "temporal")  # keys of every perturbation in a preset, beside its parameters


# --- what an execution is given ---


@dataclass(frozen=True)
class SequenceContext:
    """What a perturbation of motion or pairing is given: its own random streams in a sequence."""

    identifiers: Identifiers

    def stream(self, *purpose: str, frame: int | None = None) -> np.random.Generator:
        """Return the generator of a frame or, without one, of the whole sequence."""
        if frame is None:
            return stream(*self.identifiers, *purpose, "sequence")
        return stream(*self.identifiers, *purpose, frame=frame)

    def integers(self, count: int, low: int, high: int) -> NDArray[np.int64]:
        """Return (count,): the first `stream(frame=k).integers(low, high)` of each frame k, all at once."""
        return integers_of_frames(*self.identifiers, count=count, low=low, high=high)


@dataclass(frozen=True)
class FrameContext:
    """What a perturbation of colour or depth is given beside its image.

    index: the frame's number in its sequence. identifiers: of its random streams; a frame made alone draws the same
    numbers as in the whole sequence. temporal: how patterns change from frame to frame. stamp_s: the frame's time
    stamp, seconds. intrinsics: of the camera that took the image. Both are None only where a caller of the library did
    not give them. motion: of the camera, for perturbations that say uses_motion, None where its path is unknown.
    read_rgb, read_depth_m: read the other clean image of the same moment, as `rgb` and `depth_m` say.
    chosen_by: the identifiers of the stream that chooses the frame's severity, where they are not `identifiers`. lit:
    whether the image is light of any brightness, as of a lit scene, and was not clipped to [0, 1].

    Two contexts are equal if their index, identifiers and temporal are, since these decide the random numbers.
    """

    index: int
    identifiers: Identifiers
    temporal: Temporal = "fresh"
    stamp_s: float | None = field(default=None, compare=False)
    intrinsics: Intrinsics | None = field(default=None, compare=False)
    motion: CameraMotion | None = field(default=None, compare=False, repr=False)
    read_rgb: Callable[[], NDArray[np.float32]] | None = field(default=None, compare=False, repr=False)
    read_depth_m: Callable[[], NDArray[np.float32]] | None = field(default=None, compare=False, repr=False)
    chosen_by: Identifiers | None = field(default=None, compare=False)
    lit: bool = field(default=False, compare=False)

    def stream(self, *purpose: str) -> np.random.Generator:
        """Return the generator of this frame."""
        return stream(*self.identifiers, *purpose, frame=self.index)

    def pattern_stream(self, *purpose: str) -> np.random.Generator:
        """Return the generator of a pattern: this frame's where patterns are fresh, else the sequence's."""
        if self.temporal == "fresh":
            return self.stream(*purpose)
        return stream(*self.identifiers, *purpose, "sequence")

    @property
    def drift_frames(self) -> int:
        """By how many frames a kept pattern has moved on: 0 unless it drifts."""
        return self.index if self.temporal == "drift" else 0

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Clean colour (H, W, 3), sRGB-encoded in [0, 1], read-only.

        Raises TypeError for a perturbation that does not say needs_rgb.
        """
        if self.read_rgb is None:
            raise TypeError("the context holds no colour: it is given to perturbations of depth that say needs_rgb")
        return _read_only(self.read_rgb())

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Clean planar depth (H, W), metres, 0 = void, read-only.

        Raises TypeError for a perturbation that does not say needs_depth.
        """
        if self.read_depth_m is None:
            raise TypeError("the context holds no depth: it is given to perturbations of colour that say needs_depth")
        return _read_only(self.read_depth_m())


def _read_only(image: NDArray[np.float32]) -> NDArray[np.float32]:
    view = image.view()
    view.setflags(write=False)
    return view


# --- the kinds ---

MotionApply: TypeAlias = Callable[[Trajectory, Any, SequenceContext], Trajectory]
"""A path; parameters; context -> a path of the same number of poses, with the same stamps."""

MotionChoose: TypeAlias = Callable[[int, Any, SequenceContext], NDArray[np.int64]]
"""The number of poses; parameters; context -> (N,) indices of the poses that are shown, in this order.

N is from 1 to the number of poses; indices may repeat. The frames' stamps are the path's first N.
"""

MotionDrawn: TypeAlias = Callable[[int, Any, SequenceContext], Mapping[str, NDArray[np.float64]]]
"""The number of poses; parameters; context -> by name what `apply` draws for each pose, (count, ...).

It is recorded in frames.jsonl.
"""

ColourApply: TypeAlias = Callable[[NDArray[np.float32], Any, FrameContext], NDArray[np.float32]]
"""(H, W, 3) float32 RGB, sRGB-encoded, in [0, 1]; parameters; context -> a new array of the same shape and type.

The input is not changed. The result may lie outside [0, 1]: the caller clips it. On lit frames environment and lens are
given light of any brightness, encoded by the same curve, which goes on above 1; what `averages` gets light itself.
"""

BytesApply: TypeAlias = Callable[[NDArray[np.uint8], Any, FrameContext], NDArray[np.uint8]]
"""(H, W, 3) uint8 RGB; parameters; context -> a new array of the same shape and type. The input is not changed.

The result is byte for byte that of `apply` on `rgb / np.float32(255)`, rounded by `images.rgb_bytes`; only faster.
"""

GroupBuild: TypeAlias = Callable[[Any, Mapping[str, Any], Mapping[str, float]], Any]
"""groups.Canvas; a socket for each parameter, sizes in pixels of the input image, angles in degrees; the largest values
to serve -> the socket of the perturbed image, encoded or linear as the canvas's. The result may lie outside [0, 1].
"""

DepthApply: TypeAlias = Callable[[NDArray[np.float32], Any, FrameContext], NDArray[np.float32]]
"""(H, W) float32 planar depth, metres, 0 = void; parameters; context -> a new array of the same shape and type.

The input is not changed.
"""

PairingApply: TypeAlias = Callable[[int, Any, SequenceContext], NDArray[np.int64]]
"""The number of frames; parameters; context -> (count,) for each frame the one whose depth is paired with it.

-1 leaves the frame out.
"""


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """What all kinds share; a perturbation is one of the five kinds below.

    name: as in presets: small letters, digits and underscores. label: as in panels. stage: in the order of
    propagation. order: its rank inside the stage; ours are even, and names decide between equal ones. parameters: a
    frozen dataclass of `schema.key` fields with defaults, each a float, an int, a bool or a Literal of texts.
    severities: for each parameter that severity sets, its value at severities 1 to 5; {} if severity sets none.
    source: of those values. temporals: the values that `temporal` may have; () for a pattern that is not random.
    natural_temporal: the one that looks as it does in the world, which an artist is offered first; by default
    drift, where it has that. counts: parameters that are whole numbers, which a fractional severity rounds.
    implied: for a parameter that only counts with a value of another one, that one and the value, which it has
    where the first is given and it is not. other_severities: by a parameter that is a bool, the table that holds
    where it is true, of the same parameters. version: raised when equal parameters give other results, so that
    datasets of before do not grow. distribution: the installed package that brought it, set when it is found; None
    for our own.

    Raises ValueError for a name, parameters, severities or a natural_temporal that are not as described, and for a
    parameter with the name of a key that every perturbation has in a preset.
    """

    name: str
    label: str
    stage: Stage
    order: int
    parameters: type
    severities: Mapping[str, Sequence[float]]
    source: str
    temporals: tuple[Temporal, ...] = ()
    natural_temporal: Temporal | None = None
    counts: frozenset[str] = frozenset()
    implied: Mapping[str, tuple[str, Any]] = field(default_factory=dict)
    other_severities: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    version: int = 1
    distribution: Distribution | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.name):
            raise ValueError(f"{self.name!r} is no name: small letters, digits and underscores, a letter first")
        check_parameters(self.name, self.parameters)
        if self.stage not in STAGES:
            raise ValueError(f"{self.name}: stage is {self.stage!r}, but has to be one of {', '.join(STAGES)}")
        known = {item.name for item in fields(self.parameters)}
        for name, values in self.severities.items():
            if name not in known or len(values) != len(SEVERITIES):
                raise ValueError(f"{self.name}: {name} has to be a parameter with {len(SEVERITIES)} severities")
        if any(table.keys() != self.severities.keys() for table in self.other_severities.values()):
            raise ValueError(f"{self.name}: each of other_severities has to have the parameters of severities")
        own = [*(RESERVED[:3] if self.severities else ()), *(RESERVED[3:] if self.temporals else ())]
        if taken := sorted(known.intersection(own)):
            raise ValueError(f"{self.name}: a parameter may not be called {taken[0]}, a key of every perturbation")
        if self.natural_temporal is not None and self.natural_temporal not in self.temporals:
            raise ValueError(f"{self.name}: natural_temporal has to be one of its temporals")

    @property
    def natural(self) -> Temporal:
        """How its pattern changes where nothing else is said to an artist. Raises IndexError where nothing is drawn."""
        return self.natural_temporal or ("drift" if "drift" in self.temporals else self.temporals[0])

    def table_of(self, given: Mapping[str, Any]) -> Mapping[str, Sequence[float]]:
        """Return the table of severities that holds where some parameters are given."""
        return next((table for name, table in self.other_severities.items() if given.get(name)), self.severities)

    def at_severity(self, severity: float, **given: Any) -> Any:
        """Return the parameters at a severity, interpolated linearly in the table; `given` override them.

        severity: 1 to 5. Raises ValueError for any other: 0 is the identity, which has no parameters, and between 0
        and 1 there is nothing to interpolate from.
        """
        if not SEVERITIES[0] <= severity <= SEVERITIES[-1]:
            raise ValueError(f"severity is {severity}, but has to be 0 or from 1 to 5")
        values: dict[str, Any] = {}
        for name, table in self.table_of(given).items():
            value = float(np.interp(severity, SEVERITIES, table))
            values[name] = math.floor(value + 0.5) if name in self.counts else value
        return replace(self.parameters(), **(values | given))


@dataclass(frozen=True, kw_only=True)
class MotionPerturbation(Perturbation):
    """Acts on the camera's path, once in a sequence: it moves poses, or chooses among them. One of the two is given.

    apply: returns other poses, from which frames are rendered again. continuous: whether there are poses between these,
    on the path that the trajectory says by `curve`, or else on the smooth one through them. choose: returns which poses
    are shown; nothing is rendered again. drawn: beside `apply`, what it draws, to be recorded. Raises ValueError where
    both or neither of apply and choose are given, drawn without apply, or temporals.
    """

    stage: Stage = field(default="motion", init=False)
    apply: MotionApply | None = None
    choose: MotionChoose | None = None
    drawn: MotionDrawn | None = None
    continuous: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.apply is None) == (self.choose is None):
            raise ValueError(f"{self.name}: a perturbation of motion has either apply or choose")
        if self.drawn is not None and self.apply is None:
            raise ValueError(f"{self.name}: drawn goes with apply: choose draws no poses")
        check_no_temporals(self.name, self.temporals)


@dataclass(frozen=True, kw_only=True)
class ExposurePerturbation(Perturbation):
    """Acts, in every frame of a sequence, on when its images see the scene: row by row, for a while, again and again.

    One of two is given. apply: takes the scene at other moments, so frames are rendered for it. rays: says which rays
    make a frame, of a source that casts rays as it is asked; what `apply` of others takes is made of these rays.
    shutter: parameters -> when the lines of a frame are exposed; it is recorded, as the ground truth is the pose at the
    frame's time stamp. tells_lines: the poses of the first, the middle and the last line are recorded too.
    measures_travel: `apply` asks how far what is seen goes on the image, which depth tells. It draws nothing.

    Raises ValueError where both or neither of apply and rays are given, or temporals.
    """

    stage: Stage = field(default="exposure", init=False)
    apply: ExposureApply | None = None
    rays: Callable[[RequestedRays, Any], RequestedRays] | None = None
    shutter: Callable[[Any], Shutter]
    tells_lines: bool = False
    measures_travel: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.apply is None) == (self.rays is None):
            raise ValueError(f"{self.name}: a perturbation of exposure has either apply or rays")
        check_no_temporals(self.name, self.temporals)


@dataclass(frozen=True, kw_only=True)
class ColourPerturbation(Perturbation):
    """Acts on a colour image; several of the same name may act after one another.

    stage: environment, lens, sensor or post. apply: the reference execution. apply_bytes: the same on bytes, used
    where it is the only step on a frame. build: the same definition as a compositor node group, or None. capacity:
    for each parameter that the number of its nodes depends on, the largest value that the group serves by default.
    needs_depth: the context holds the frame's depth, and the group has an input for it. repeatable: the result
    depends on image, parameters, intrinsics and depth alone, so that sequences which do the same to a frame share a
    file; it draws nothing and does not look at the frame's number or stamp. linear: `build` is given and gives
    linear light, of any brightness, so that what is brighter than 1 stays so. averages: it only moves and averages
    values, so where light is not clipped it works on light itself, as a lens does. uses_motion: `apply` looks at
    the camera's motion, where the context has it, and the group has inputs for it. goes_with_camera: a fixed
    pattern does. by_camera: of the group's parameters, what a known camera decides. repeats: tells of which
    parameters it is repeatable, and looks at no motion, though it has temporals. grain: each pixel has noise of its
    own, which files of images hardly compress; estimates of sizes ask for it.

    Raises ValueError for another stage, and for temporals of what is repeatable.
    """

    apply: ColourApply
    apply_bytes: BytesApply | None = None
    build: GroupBuild | None = None
    capacity: Mapping[str, float] = field(default_factory=dict)
    needs_depth: bool = False
    repeatable: bool = False
    linear: bool = False
    averages: bool = False
    uses_motion: bool = False
    goes_with_camera: bool = False
    by_camera: Callable[[Intrinsics], Mapping[str, Any]] | None = None
    repeats: Callable[[Any], bool] | None = None
    grain: bool = False

    def is_repeatable(self, parameters: Any) -> bool:
        """Tell whether with these parameters the result depends on image, depth and intrinsics alone."""
        return self.repeatable or (self.repeats is not None and self.repeats(parameters))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stage not in COLOUR_STAGES:
            raise ValueError(f"{self.name}: stage is {self.stage!r}, but has to be one of {', '.join(COLOUR_STAGES)}")
        if self.repeatable and self.temporals:
            raise ValueError(f"{self.name}: what is repeatable has no random pattern, so it has no temporals")


@dataclass(frozen=True, kw_only=True)
class DepthPerturbation(Perturbation):
    """Acts on a depth image; several of the same name may act after one another.

    needs_rgb: the context holds the clean colour of the same moment. grain: each pixel has noise of its own, which
    files of images hardly compress; estimates of sizes ask for it.
    """

    stage: Stage = field(default="depth", init=False)
    apply: DepthApply
    needs_rgb: bool = False
    grain: bool = False


@dataclass(frozen=True, kw_only=True)
class PairingPerturbation(Perturbation):
    """Acts, once in a sequence, on which depth is paired with which colour.

    Raises ValueError where temporals are given.
    """

    stage: Stage = field(default="pairing", init=False)
    apply: PairingApply

    def __post_init__(self) -> None:
        super().__post_init__()
        check_no_temporals(self.name, self.temporals)


KINDS: tuple[type[Perturbation], ...] = (
    *(MotionPerturbation, ExposurePerturbation),
    *(ColourPerturbation, DepthPerturbation, PairingPerturbation),
)
SEQUENCE_KINDS = (MotionPerturbation, ExposurePerturbation, PairingPerturbation)
"""The kinds that act on a whole sequence: a setting has each of their perturbations at most once, at one severity."""


def kind_name(perturbation: Perturbation) -> str:
    """Return the kind's name: motion, exposure, colour, depth or pairing."""
    return type(perturbation).__name__.removesuffix("Perturbation").lower()


def propagation_key(perturbation: Perturbation) -> tuple[int, int, str]:
    """Return the key by which perturbations are sorted: stage, order, name."""
    return STAGES.index(perturbation.stage), perturbation.order, perturbation.name
