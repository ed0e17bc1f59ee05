# SPDX-License-Identifier: GPL-3.0-or-later
"""The five kinds of perturbation, each with the signature of its execution, and the order of the stages.

The five kinds of perturbation, each with the signature of its execution, and the order of the stages.

A perturbation is one file with a `PERTURBATION`. Presets, panels, sockets, `--list` and the tests are derived from it.
"""

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import MISSING, InitVar, dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, Protocol, TypeAlias, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..core.camera_motion import CameraMotion
from ..core.frame_request import RequestedRays, Shutter
from ..core.geometry import Intrinsics
from ..core.mirrored import EvenAir
from ..core.packages import Distribution
from ..core.srgb import quick_light
from ..core.streams import Identifiers, integers_of_frames, stream
from ..core.trajectory import Trajectory
from ..images.pixels import as_bytes, read_only

# What a perturbation is said to be: in menus, in the tables and pictures of the docs, and by a preset of its own.


@dataclass(frozen=True)
class Example:
    """A preset in the embedded room, where that is not clean and severities 1, 3 and 5.

    text: what it shows, after its label or in a sentence. settings: one line of YAML each; () for the severities.
    render: the preset's key, in YAML. frames, rate_hz: of the walk.
    """

    text: str = ""
    settings: Sequence[str] = ()
    render: str = ""
    frames: int = 6
    rate_hz: int = 1


STANDARD = Example()


@dataclass(frozen=True)
class About:
    """What is said of a perturbation to people; no pixel depends on it.

    sentence: what it does to what is seen, for menus. law: what it is, for the table of the docs. caption, picture:
    what the gallery's picture shows, below it and in its place; by default the sentence, and severities 1, 3 and 5.
    twin: the name of the physical one of the same cause. of_paper: it is one of the paper's taxonomy.
    of_imagenet_c: it is one of ImageNet-C's that the paper does without.
    """

    sentence: str = ""
    law: str = ""
    caption: str = ""
    picture: str = ""
    twin: str = ""
    of_paper: bool = False
    of_imagenet_c: bool = False
    example: Example = STANDARD


UNSAID = About()


# What a camera's automatics have seen before a frame: the clean frames of its sequence, small, in linear light.


LONGEST_PX = 32  # of a small image's longer side: a meter has some hundred fields; chosen


@dataclass(frozen=True, eq=False)
class EarlierFrame:
    """A frame as a meter sees it.

    stamp_s: its time stamp, seconds. light: (h, w, 3) float32, linear, at most 32 pixels a side; each pixel the mean of
    what it stands for; read-only. asked: what automatics would have, seeing it, by what decides that;
    frames of one light share it, as each is looked at from many later ones.
    """

    stamp_s: float
    light: NDArray[np.float32]
    asked: dict[Hashable, NDArray[np.float64]] = field(default_factory=dict[Hashable, NDArray[np.float64]], repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "light", read_only(self.light))


ReadEarlier: TypeAlias = Callable[[float], tuple[EarlierFrame, ...]]
"""Seconds -> the frames that a sequence showed so long before one, the oldest first, as `earlier_than` says."""


def earlier_than(stamps_s: Sequence[float] | NDArray[np.float64], frame: int, span_s: float) -> range:
    """Return the frames of a sequence from the one shown `span_s` before a frame up to it, without itself.

    Before its first frame a sequence has shown that frame.
    """
    if frame == 0:
        return range(1)
    shown = bisect_right(stamps_s, float(stamps_s[frame]) - span_s, 0, frame)
    return range(max(shown - 1, 0), frame)


def small_light(rgb: NDArray[Any]) -> NDArray[np.float32]:
    """Return a clean frame (H, W, 3), sRGB-encoded, as `EarlierFrame.light`.

    It is rounded to bytes, so that a frame which was read from a file is the same as when it was rendered.
    """
    return small_of(quick_light(as_bytes(rgb)))


def small_of(whole: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light (H, W, 3) as `EarlierFrame.light`."""
    import cv2

    high, wide = whole.shape[:2]
    scale = max(1.0, max(high, wide) / LONGEST_PX)
    size = max(1, round(wide / scale)), max(1, round(high / scale))
    small = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32).reshape(*size[::-1], 3)
    small = small.copy() if np.shares_memory(small, whole) else small
    small.setflags(write=False)
    return small


def alone(rgb: NDArray[Any]) -> ReadEarlier:
    """Return what there was before an image that stands alone: itself, as before the first frame of a sequence."""
    return lambda _span_s: (EarlierFrame(0.0, small_light(rgb)),)


# What a perturbation is given beside what it acts on.


Temporal: TypeAlias = Literal["fresh", "fixed", "drift"]
"""How a random pattern changes from frame to frame: drawn anew, kept, or moved smoothly."""


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
    whether the image is light of any brightness, as of a lit scene, and was not clipped to [0, 1]. read_earlier: as
    `earlier` says. earlier_key: equal where that is. read_decided: as `decided` says. shutter: when the lines of the
    frame are exposed, as steps of exposure say; None where there are none.

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
    read_earlier: ReadEarlier | None = field(default=None, compare=False, repr=False)
    earlier_key: Hashable = field(default=None, compare=False, repr=False)
    read_decided: Callable[[], Mapping[str, float]] | None = field(default=None, compare=False, repr=False)
    shutter: Shutter | None = field(default=None, compare=False)

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
        return read_only(self.read_rgb())

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Clean planar depth (H, W), metres, 0 = void, read-only.

        Raises TypeError for a perturbation that does not say needs_depth.
        """
        if self.read_depth_m is None:
            raise TypeError("the context holds no depth: it is given to perturbations of colour that say needs_depth")
        return read_only(self.read_depth_m())

    def earlier(self, span_s: float) -> tuple[EarlierFrame, ...]:
        """Return the clean frames that the sequence showed up to some seconds before this one, the oldest first.

        There is one at least: before its first frame a sequence showed that one. Raises TypeError for a perturbation
        that does not say looks_back_s.
        """
        if self.read_earlier is None:
            raise TypeError(
                "the context holds no earlier frames: they are given to perturbations that say looks_back_s"
            )
        return self.read_earlier(span_s)

    @property
    def decided(self) -> Mapping[str, float]:
        """What the camera's automatics decided for this frame, by name: this step's own and those before it."""
        return {} if self.read_decided is None else self.read_decided()

    def for_sequence(self) -> "FrameContext":
        """Return this context without what belongs to one frame: to keep what is drawn once for a sequence."""
        return FrameContext(0, self.identifiers, self.temporal, chosen_by=self.chosen_by, lit=self.lit)


# What a node group is told for each frame where nodes cannot find it: what automatics decided by earlier frames.


GREY = 0.18  # of white: the light that a meter takes for the middle
MID_GREY = EarlierFrame(0.0, np.full((1, 1, 3), GREY, np.float32))


@dataclass(frozen=True)
class FrameValue:
    """A number that a group is told for each frame: a socket, which an artist keys. default: of the socket."""

    meaning: str
    default: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class ByFrame:
    """All that a group is told for a frame.

    values: by name, as parameters are named; the group has a socket for each, and none for parameters, since these
    decide them. Without any, the sockets are those of parameters, and some of these are told. of: parameters; the
    frame's context -> each value, or each parameter that is told.
    """

    values: Mapping[str, FrameValue]
    of: Callable[[Any, FrameContext], Mapping[str, float]]


def without_frames(context: FrameContext) -> FrameContext:
    """Return a context for where no earlier frames are known, as in a live preview: as if all had been mid-grey."""
    return replace(context, stamp_s=context.stamp_s or 0.0, read_earlier=lambda _span_s: (MID_GREY,))


# What a perturbation of exposure is given, and what it returns.


Channels: TypeAlias = frozenset[str] | None
"""The channels of which images are looked at; None for all that there are."""


class TakenImages(Protocol):
    """The clean images of a frame; one that was not asked for is None."""

    @property
    def rgb(self) -> NDArray[Any] | None:
        """Colour (H, W, 3), float32 in [0, 1] or uint8; RGB, sRGB-encoded."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres; 0 = void."""
        ...


def _still(_times_s: NDArray[np.float64]) -> float:
    return 0.0


@dataclass(frozen=True)
class SceneAround:
    """The scene around a frame's time stamp; calling it takes the clean images some seconds after that.

    take: does so; channels says which images are looked at, others may be None. travel_px: times (N,), seconds after
    the stamp, increasing -> how far what any pixel sees goes on the image, from one to the next, at most; pixels.
    """

    take: Callable[[float, Channels], TakenImages]
    travel_px: Callable[[NDArray[np.float64]], float] = field(default=_still)

    def __call__(self, seconds: float, channels: Channels = None) -> TakenImages:
        """Return the images: of an instant or, where another exposure acts before, of that around the moment."""
        return self.take(seconds, channels)


ExposureApply: TypeAlias = Callable[[SceneAround, Any], tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]]
"""A function that takes the clean images some seconds after the frame's time stamp; parameters -> its own colour and
depth, of the same shapes, as float32, None for an image that is not asked for.

What it takes is an instant or, where another exposure acts before it, that exposure around the moment.
"""


# What the parameters of a perturbation have to be.


def check_parameters(name: str, parameters: type, *, files: bool) -> None:
    """Raise ValueError where they are no dataclass of keys with defaults, of kinds that presets and sockets know.

    files: whether a text may name a file, which no socket of a node can.
    """
    if not (isinstance(parameters, type) and is_dataclass(parameters)):
        raise ValueError(f"{name}: parameters has to be a dataclass")
    hints = get_type_hints(parameters)
    for item in fields(parameters):
        if "key" not in item.metadata or item.default is MISSING:
            raise ValueError(f"{name}: the parameter {item.name} has to be a key(...) with a default")
        hint = hints[item.name]
        chosen = get_origin(hint) is Literal and all(isinstance(value, str) for value in get_args(hint))
        named = files and hint is str and item.metadata["key"].file is not None and item.default == ""
        if hint not in (float, int, bool) and not chosen and not named:
            more = ', a text "" with the key\'s file' if files else ""
            raise ValueError(
                f"{name}: the parameter {item.name} has to be a float, an int, a bool{more} or a Literal of texts"
            )


def check_no_temporals(name: str, temporals: Sequence[str]) -> None:
    """Raise ValueError where a perturbation that acts on a whole sequence has temporals. name: the perturbation's."""
    if temporals:
        raise ValueError(f"{name}: acts on a whole sequence, so it has no temporals")


ColourStage: TypeAlias = Literal["environment", "lens", "sensor", "post"]
Stage: TypeAlias = Literal["motion", "exposure", ColourStage, "depth", "pairing"]
"""A stage of propagation, as in "From Perfect to Noisy World Simulation"; STAGES has them in order."""

STAGES: tuple[Stage, ...] = ("motion", "exposure", "environment", "lens", "sensor", "post", "depth", "pairing")
COLOUR_STAGES: tuple[ColourStage, ...] = ("environment", "lens", "sensor", "post")
LIGHT_STAGES: tuple[ColourStage, ...] = ("environment", "lens")
"""Those before a sensor: on lit frames they act on scene-linear light, before the view transform."""

SEVERITIES = (1, 2, 3, 4, 5)  # as ImageNet-C and the paper
# Of a parameter, a bool by which steps that are newly written do nearly the same in less time.
QUICK = "coarse"
RESERVED = ("severity", "mode", "levels", "temporal")  # keys of every perturbation in a preset, beside its parameters


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
"""groups.Canvas; a socket for each parameter, or for each value of by_frame, sizes in pixels of the input image, angles
in degrees; the largest values to serve -> the socket of the perturbed image, encoded or linear as the canvas's. The
result may lie outside [0, 1].
"""

DepthApply: TypeAlias = Callable[[NDArray[np.float32], Any, FrameContext], NDArray[np.float32]]
"""(H, W) float32 planar depth, metres, 0 = void; parameters; context -> a new array of the same shape and type.

The input is not changed.
"""

Decides: TypeAlias = Callable[[Any, FrameContext], Mapping[str, float]]
"""Parameters; context -> by name what a camera's automatic sets for a frame; it is recorded in frames.jsonl."""

PairingApply: TypeAlias = Callable[[int, Any, SequenceContext], NDArray[np.int64]]
"""The number of frames; parameters; context -> (count,) for each frame the one whose depth is paired with it.

-1 leaves the frame out.
"""


ByDepth: TypeAlias = Callable[[NDArray[np.float32]], tuple[Mapping[str, Any], str]]
"""Clean planar depth (H, W) of a scene, metres, 0 = void -> parameters that follow from it, and why, in words."""


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """What all kinds share; a perturbation is one of the five kinds below.

    name: as in presets: small letters, digits and underscores. label: as in panels. stage: in the order of
    propagation. order: its rank inside the stage; ours are even, and names decide between equal ones. parameters: a
    frozen dataclass of `schema.key` fields with defaults, each a float, an int, a bool or a Literal of texts; of depth
    also a text that names a file, which `key(file=...)` reads.
    severities: for each parameter that severity sets, its value at severities 1 to 5; {} if severity sets none.
    source: of those values. temporals: the values that `temporal` may have; () for a pattern that is not random.
    natural_temporal: the one that looks as it does in the world, which an artist is offered first; by default
    drift, where it has that. counts: parameters that are whole numbers, which a fractional severity rounds.
    implied: for a parameter that only counts with a value of another one, that one and the value, which it has
    where the first is given and it is not. other_severities: by a parameter that is a bool, the table that holds
    where it is true, of the same parameters. stretched: for a parameter of the table, another one by which its values
    are multiplied; that is 1 by default. contradiction: parameters -> what cannot be in their values together, ""
    for nothing; a preset with it is refused. newly: parameters that a step which is newly written into a preset has, in
    place of the defaults that presets of before count on. by_depth: the clean depth (H, W) of the scene, metres, 0 =
    void -> what of its parameters follows from that, and why, in words; asked where a step is newly written.
    version: raised when equal parameters give other results, so that datasets of before do not grow.
    about: what is said of it to people. distribution: the installed package that brought it, set when it is found; None
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
    stretched: Mapping[str, str] = field(default_factory=dict)
    contradiction: Callable[[Any], str] | None = None
    newly: Mapping[str, Any] = field(default_factory=dict)
    by_depth: ByDepth | None = None
    version: int = 1
    about: About = UNSAID
    distribution: Distribution | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.name):
            raise ValueError(f"{self.name!r} is no name: small letters, digits and underscores, a letter first")
        check_parameters(self.name, self.parameters, files=self.stage == "depth")
        if self.stage not in STAGES:
            raise ValueError(f"{self.name}: stage is {self.stage!r}, but has to be one of {', '.join(STAGES)}")
        known = {item.name for item in fields(self.parameters)}
        for name, values in self.severities.items():
            if name not in known or len(values) != len(SEVERITIES):
                raise ValueError(f"{self.name}: {name} has to be a parameter with {len(SEVERITIES)} severities")
        if any(table.keys() != self.severities.keys() for table in self.other_severities.values()):
            raise ValueError(f"{self.name}: each of other_severities has to have the parameters of severities")
        if self.stretched.keys() - self.severities.keys() or set(self.stretched.values()) - known:
            raise ValueError(f"{self.name}: stretched has to name parameters, the first of each pair of severities")
        own = [*(RESERVED[:3] if self.severities else ()), *(RESERVED[3:] if self.temporals else ())]
        if taken := sorted(known.intersection(own)):
            raise ValueError(f"{self.name}: a parameter may not be called {taken[0]}, a key of every perturbation")
        if unknown := sorted(self.newly.keys() - known):
            raise ValueError(f"{self.name}: newly gives {unknown[0]}, which is no parameter")
        if self.natural_temporal is not None and self.natural_temporal not in self.temporals:
            raise ValueError(f"{self.name}: natural_temporal has to be one of its temporals")

    @property
    def natural(self) -> Temporal:
        """How its pattern changes where nothing else is said to an artist. Raises IndexError where nothing is drawn."""
        return self.natural_temporal or ("drift" if "drift" in self.temporals else self.temporals[0])

    @property
    def sentence(self) -> str:
        """What it does to what is seen, in a sentence; by default the first line of what its parameters say."""
        return self.about.sentence or (self.parameters.__doc__ or "").split("\n")[0].strip().rstrip(".")

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
            value = float(np.interp(severity, SEVERITIES, table)) * given.get(self.stretched.get(name, ""), 1)
            values[name] = math.floor(value + 0.5) if name in self.counts else value
        return replace(self.parameters(), **(values | given))


@dataclass(frozen=True, kw_only=True)
class MotionPerturbation(Perturbation):
    """Acts on the camera's path, once in a sequence: it moves poses, or chooses among them. One of the two is given.

    apply: returns other poses, from which frames are rendered again. continuous: whether there are poses between these,
    on the path that the trajectory says by `curve`, or else on the smooth one through them. choose: returns which poses
    are shown; nothing is rendered again. drawn: beside `apply`, what it draws, to be recorded. highest_hz: parameters
    -> the highest frequency that it moves with, where it tells. Raises ValueError where both or neither of apply and
    choose are given, drawn without apply, or temporals.
    """

    stage: Stage = field(default="motion", init=False)
    apply: MotionApply | None = None
    choose: MotionChoose | None = None
    drawn: MotionDrawn | None = None
    continuous: bool = False
    highest_hz: Callable[[Any], float] | None = None

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


@dataclass(frozen=True)
class Nodes:
    """How a node group of Blender's compositor carries out a perturbation of colour.

    build: the same definition as a group: sockets -> a socket. capacity: for each parameter that the number of its
    nodes depends on, the largest value that the group serves by default. linear: it gives linear light, of any
    brightness, so that what is brighter than 1 stays so. draws_lit: on lit frames arrays carry out the group itself, so
    that both executions draw one picture. by_camera: of the group's parameters, what a known camera decides. by_frame:
    what the group is told for each frame, in place of parameters or of some of them.
    """

    build: GroupBuild
    capacity: Mapping[str, float] = field(default_factory=dict)
    linear: bool = False
    draws_lit: bool = False
    by_camera: Callable[[Intrinsics], Mapping[str, Any]] | None = None
    by_frame: ByFrame | None = None

    @property
    def values(self) -> Mapping[str, FrameValue]:
        """What the group has sockets for in place of parameters; {} where it has those of parameters."""
        return {} if self.by_frame is None else self.by_frame.values


@dataclass(frozen=True, kw_only=True)
class Automatic:
    """What a camera sets by itself for a frame.

    looks_back_s: parameters -> how many seconds of earlier frames it asks its context for. decides: what it sets; the
    contexts of its own and of later steps of the setting hold it.
    """

    looks_back_s: Callable[[Any], float] | None = None
    decides: Decides


@dataclass(frozen=True, kw_only=True)
class ColourPerturbation(Perturbation):
    """Acts on a colour image; several of the same name may act after one another.

    stage: environment, lens, sensor or post.

    How it is carried out. apply: the reference execution. apply_bytes: the same on bytes, used where it is the only
    step on a frame. nodes: the same as a compositor node group; None for none. `build` and `capacity`, as arguments,
    are those of `nodes`. averages: it only moves and averages values, so where light is not clipped it works on light
    itself, as a lens does. on_light: of the sensor, but before anything is encoded, so on lit frames it acts on light
    too, and takes and gives what is brighter than 1.

    What it looks at. needs_depth: the context holds the frame's depth, and the group has an input for it. uses_motion:
    `apply` looks at the camera's motion, where the context has it, and the group has inputs for it. goes_with_camera: a
    fixed pattern does. automatic: what it decides for a frame, by earlier ones.

    What its results are. repeatable: they depend on image, parameters, intrinsics and depth alone, so that sequences
    which do the same to a frame share a file; it draws nothing and does not look at the frame's number or stamp.
    repeats: tells of which parameters it is repeatable, and looks at no motion, though it has temporals. grain: each
    pixel has noise of its own, which files of images hardly compress; estimates of sizes ask for it. limits:
    parameters, camera -> what `apply` draws less of there than they ask for, to be said in the plan after its name; ""
    where nothing. breaks_depth: it moves what colour shows, so that depth no longer fits, which is said in the plan.
    overlay: it lays something light over the whole frame, so that several of them add up to white. tinted: it lays
    light or matter over the image, to which a step may give a colour. even_air: (light (H, W, 3), linear; parameters;
    context) -> the air that it lays before a scene, for what surfaces mirror, which is farther than they are.

    Raises ValueError for another stage, for temporals of what is repeatable, and where it decides and is repeatable.
    """

    apply: ColourApply
    apply_bytes: BytesApply | None = None
    nodes: Nodes | None = None
    build: InitVar[GroupBuild | None] = None
    capacity: InitVar[Mapping[str, float] | None] = None
    averages: bool = False
    on_light: bool = False
    needs_depth: bool = False
    uses_motion: bool = False
    goes_with_camera: bool = False
    automatic: Automatic | None = None
    repeatable: bool = False
    repeats: Callable[[Any], bool] | None = None
    grain: bool = False
    limits: Callable[[Any, Intrinsics], str] | None = None
    breaks_depth: bool = False
    overlay: bool = False
    tinted: bool = False
    even_air: Callable[[NDArray[np.float32], Any, FrameContext], EvenAir] | None = None

    @property
    def has_parameter_sockets(self) -> bool:
        """Whether its node group has sockets for its parameters, not for what they decide in a frame."""
        return self.nodes is None or not self.nodes.values

    @property
    def group_severities(self) -> Mapping[str, Sequence[float]]:
        """The table of severities that its node group has."""
        return self.severities if self.has_parameter_sockets else {}

    @property
    def group_temporals(self) -> tuple[Temporal, ...]:
        """How its node group's pattern may change; () where it draws none itself."""
        return self.temporals if self.has_parameter_sockets else ()

    @property
    def acts_on_light(self) -> bool:
        """Whether it acts on scene-linear light of lit frames, before the view transform."""
        return self.on_light or self.stage in LIGHT_STAGES

    def is_repeatable(self, parameters: Any) -> bool:
        """Tell whether with these parameters the result depends on image, depth and intrinsics alone."""
        return self.repeatable or (self.repeats is not None and self.repeats(parameters))

    def __post_init__(self, build: GroupBuild | None, capacity: Mapping[str, float] | None) -> None:
        super().__post_init__()
        if build is not None:
            object.__setattr__(self, "nodes", Nodes(build, capacity or {}))
        if self.stage not in COLOUR_STAGES:
            raise ValueError(f"{self.name}: stage is {self.stage!r}, but has to be one of {', '.join(COLOUR_STAGES)}")
        if self.repeatable and self.temporals:
            raise ValueError(f"{self.name}: what is repeatable has no random pattern, so it has no temporals")
        if self.repeatable and self.automatic is not None:
            raise ValueError(f"{self.name}: what is repeatable neither looks back nor decides")


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
