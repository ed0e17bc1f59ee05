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
from ..trajectories.frame_request import RequestedRays, Shutter
from ..trajectories.trajectory import Trajectory
from .about import UNSAID, About
from .by_frame import ByFrame
from .contexts import FrameContext, SequenceContext, Temporal
from .contexts import Identifiers as Identifiers  # noqa: PLC0414 - is found here too
from .exposing import ExposureApply
from .parameter_rules import check_no_temporals, check_parameters

ColourStage: TypeAlias = Literal["environment", "lens", "sensor", "post"]
Stage: TypeAlias = Literal["motion", "exposure", ColourStage, "depth", "pairing"]
"""A stage of propagation, as in "From Perfect to Noisy World Simulation"; STAGES has them in order."""

STAGES: tuple[Stage, ...] = ("motion", "exposure", "environment", "lens", "sensor", "post", "depth", "pairing")
COLOUR_STAGES: tuple[ColourStage, ...] = ("environment", "lens", "sensor", "post")
LIGHT_STAGES: tuple[ColourStage, ...] = ("environment", "lens")
"""Those before a sensor: on lit frames they act on scene-linear light, before the view transform."""

SEVERITIES = (1, 2, 3, 4, 5)  # as ImageNet-C and the paper
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
    where it is true, of the same parameters. contradiction: parameters -> what cannot be in their values together, ""
    for nothing; a preset with it is refused. version: raised when equal parameters give other results, so that
    datasets of before do not grow. about: what is said of it to people. distribution: the installed package that
    brought it, set when it is found; None for our own.

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
    contradiction: Callable[[Any], str] | None = None
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
        own = [*(RESERVED[:3] if self.severities else ()), *(RESERVED[3:] if self.temporals else ())]
        if taken := sorted(known.intersection(own)):
            raise ValueError(f"{self.name}: a parameter may not be called {taken[0]}, a key of every perturbation")
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
    linear light, of any brightness, so that what is brighter than 1 stays so. lit_by_nodes: on lit frames arrays
    carry out the node group itself, so that both executions draw one picture. averages: it only moves and averages
    values, so where light is not clipped it works on light itself, as a lens does. uses_motion: `apply` looks at
    the camera's motion, where the context has it, and the group has inputs for it. goes_with_camera: a fixed
    pattern does. by_camera: of the group's parameters, what a known camera decides. repeats: tells of which
    parameters it is repeatable, and looks at no motion, though it has temporals. grain: each pixel has noise of its
    own, which files of images hardly compress; estimates of sizes ask for it. on_light: of the sensor, but before
    anything is encoded, so on lit frames it acts on light too, and takes and gives what is brighter than 1.
    looks_back_s: parameters -> how many seconds of earlier frames it asks its context for. decides: what it sets by
    these; the contexts of its own and of later steps of the setting hold it. by_frame: what the group is told for each
    frame, in place of parameters or of some of them. limits: parameters, camera -> what `apply` draws less of there
    than they ask for, to be said in the plan after its name; "" where nothing.

    Raises ValueError for another stage, for temporals of what is repeatable, and where it looks back and is repeatable.
    """

    apply: ColourApply
    apply_bytes: BytesApply | None = None
    build: GroupBuild | None = None
    capacity: Mapping[str, float] = field(default_factory=dict)
    needs_depth: bool = False
    repeatable: bool = False
    linear: bool = False
    averages: bool = False
    lit_by_nodes: bool = False
    uses_motion: bool = False
    goes_with_camera: bool = False
    by_camera: Callable[[Intrinsics], Mapping[str, Any]] | None = None
    repeats: Callable[[Any], bool] | None = None
    grain: bool = False
    on_light: bool = False
    looks_back_s: Callable[[Any], float] | None = None
    decides: Decides | None = None
    by_frame: ByFrame | None = None
    limits: Callable[[Any, Intrinsics], str] | None = None

    @property
    def has_parameter_sockets(self) -> bool:
        """Whether its node group has sockets for its parameters, not for what they decide in a frame."""
        return self.by_frame is None or not self.by_frame.values

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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stage not in COLOUR_STAGES:
            raise ValueError(f"{self.name}: stage is {self.stage!r}, but has to be one of {', '.join(COLOUR_STAGES)}")
        if self.repeatable and self.temporals:
            raise ValueError(f"{self.name}: what is repeatable has no random pattern, so it has no temporals")
        if self.repeatable and (self.looks_back_s is not None or self.decides is not None):
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
