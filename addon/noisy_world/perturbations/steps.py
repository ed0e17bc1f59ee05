# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings and their steps: perturbations with parameters, in the order of propagation.

Settings and their steps: perturbations with parameters, in the order of propagation.

The order is the paper's, whatever the order in the preset: motion, then colour (environment, lens, sensor,
post-processing) and depth, then pairing. Within a stage, each perturbation's `order` decides.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from ..channels import CHANNELS
from ..core.file_access import path_in
from ..core.frame_request import Shutter
from ..core.schema import ConfigPath, KeyInfo
from .kinds import (
    ColourPerturbation,
    DepthPerturbation,
    ExposurePerturbation,
    FrameContext,
    Identifiers,
    MotionPerturbation,
    PairingPerturbation,
    Perturbation,
    SequenceContext,
    Temporal,
)
from .shares import Share, sha256_of

# Files that are parameters of a perturbation: found beside the preset, checked, and recorded by what they hold.


def with_files(parameters: type, given: Mapping[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return parameters that a preset gives with its files as whole paths; they are read once, to check them.

    parameters: the perturbation's. place: of these values. A path is relative to the preset, or to where the program
    runs where none is read from a file. Raises InputError where a file cannot be read or holds something else.
    """
    found = dict(given)
    for item in fields(parameters):
        info: KeyInfo = item.metadata["key"]
        if info.file is None or not given.get(item.name):
            continue
        where = place.at(item.name)
        path = path_in(place.folder, given[item.name], where).absolute()
        try:
            info.file(path)
        except FileNotFoundError as error:
            raise where.error(f"{path} is not there", "name the file, relative to the preset") from error
        except OSError as error:
            raise where.error(f"{path} cannot be read: {error.strerror or error}") from error
        except ValueError as error:
            raise where.error(f"{path} {error}") from error
        found[item.name] = str(path)
    return found


def files_of(parameters: Any) -> dict[str, Path]:
    """Return the files that parameters name, by the parameter."""
    values = {item.name: getattr(parameters, item.name) for item in fields(parameters) if item.metadata["key"].file}
    return {name: Path(value) for name, value in values.items() if value}


def deciding(parameters: Any) -> dict[str, Any]:
    """Return the parameters of a step as an identity has them: of a file its SHA-256, and none that is not given.

    One that came later than datasets were made is left out at its default, so these stay as they are.

    Raises OSError where a file is gone.
    """
    later = {each.name for each in fields(parameters) if each.metadata["key"].later and _is_default(parameters, each)}
    plain = {name: value for name, value in asdict(parameters).items() if name not in _names(parameters) | later}
    return plain | {name: {"sha256": sha256_of(path)} for name, path in files_of(parameters).items()}


def recorded(parameters: Any) -> dict[str, Any]:
    """Return them as a frame's record has them: as `deciding` does, with the names of files too."""
    named = {name: {"name": path.name, "sha256": sha256_of(path)} for name, path in files_of(parameters).items()}
    return deciding(parameters) | named


def _is_default(parameters: Any, item: Field[Any]) -> bool:
    return getattr(parameters, item.name) == item.default


def _names(parameters: Any) -> set[str]:
    return {item.name for item in fields(parameters) if item.metadata["key"].file is not None}


Kind = TypeVar("Kind", bound=Perturbation)

SENSOR_STREAM = "rig.depth"  # what a rig's depth sensor draws by, whatever the setting
DEFAULT_SEVERITY = 3.0  # chosen: the middle one; parameters that are not given and node groups have its values

Backend: TypeAlias = Literal["compositor", "reference"]


@dataclass(frozen=True)
class Step(Generic[Kind]):
    """One perturbation of a setting.

    occurrence: its number among the setting's steps of the same name, from 0. severity: None where only parameters are
    given. levels: the severities that each frame's is drawn from in dynamic mode; where it is keyed, those of the
    frames one after another, of which the last one holds. given: parameters that override the severity's. stream: the
    name under which colour and depth draw their random patterns; None is the setting's. share: of a step of colour, how
    much of its effect shows; None for all of it.
    """

    perturbation: Kind
    occurrence: int
    severity: float | None
    levels: tuple[float, ...] | None
    temporal: Temporal
    given: Mapping[str, Any]
    stream: str | None = None
    keyed: bool = False
    share: Share | None = None

    def context(self, where: FrameContext) -> FrameContext:
        """Return this step's context for a frame. where: the frame, with the identifiers of its sequence.

        With a `stream` the last of these, the setting's name, is replaced by it, but for the choice of the severity:
        settings of one stream draw equal patterns, and each has its own levels.

        Other images are handed on only to a perturbation that says that it needs them.
        """
        kind = self.perturbation
        own = (*where.identifiers, kind.name, self.occurrence)
        return replace(
            where,
            identifiers=own if self.stream is None else (*where.identifiers[:-1], self.stream, *own[-2:]),
            chosen_by=None if self.stream is None else own,
            temporal=self.temporal,
            motion=where.motion if self.uses_motion else None,
            read_rgb=where.read_rgb if isinstance(kind, DepthPerturbation) and kind.needs_rgb else None,
            read_depth_m=where.read_depth_m if isinstance(kind, ColourPerturbation) and kind.needs_depth else None,
            read_earlier=where.read_earlier if self.looks_back else None,
            earlier_key=where.earlier_key if self.looks_back else None,
        )

    @cached_property
    def uses_motion(self) -> bool:
        """Whether this step, with one of its severities, looks at the camera's motion."""
        kind = self.perturbation
        if not isinstance(kind, ColourPerturbation) or not kind.uses_motion:
            return False
        severities = (self.severity,) if self.levels is None else self.levels
        return any(not kind.is_repeatable(self.parameters(each)) for each in severities if each != 0)

    @cached_property
    def _span_s(self) -> Callable[[Any], float] | None:
        """Parameters -> how many seconds of earlier frames it asks for; None where it asks for none."""
        automatic = self.perturbation.automatic if isinstance(self.perturbation, ColourPerturbation) else None
        return None if automatic is None else automatic.looks_back_s

    @property
    def looks_back(self) -> bool:
        """Whether this step looks at earlier frames."""
        return self._span_s is not None

    @cached_property
    def looks_back_s(self) -> float:
        """How many seconds of earlier frames it asks for, with any of its severities."""
        if self._span_s is None:
            return 0.0
        severities = (self.severity,) if self.levels is None else self.levels
        return max((self._span_s(self.parameters(each)) for each in severities if each != 0), default=0.0)

    def sequence_context(self, identifiers: Identifiers) -> SequenceContext:
        """Return this step's context for a whole sequence. identifiers: the sequence's."""
        return SequenceContext((*identifiers, self.perturbation.name, self.occurrence))

    def severity_of(self, context: FrameContext) -> float | None:
        """Return the severity of a frame; in dynamic mode it is drawn uniformly and independently for each frame.

        Where nothing of the effect shows it is 0, which is the identity.
        """
        if self.share is not None and self.share.mix_of(context.index) == 0:
            return 0.0
        if self.levels is None:
            return self.severity
        if self.keyed:
            return self.levels[min(context.index, len(self.levels) - 1)]
        choosing = context if context.chosen_by is None else replace(context, identifiers=context.chosen_by)
        return self.levels[int(choosing.stream("severity").integers(len(self.levels)))]

    def parameters(self, severity: float | None) -> Any:
        """Return the parameters of a severity."""
        implied = dict(value for name, value in self.perturbation.implied.items() if name in self.given)
        given = {**implied, **self.given}
        own = self.perturbation.table_of(given) is self.perturbation.severities
        if severity is None and own and not given.keys() & set(self.perturbation.stretched.values()):
            return self.perturbation.parameters(**given)
        severity = DEFAULT_SEVERITY if severity is None else severity
        return self.perturbation.at_severity(severity, **given)

    def note(self, context: FrameContext, severity: float | None) -> dict[str, Any]:
        """Return a record of what is done to a frame, for frames.jsonl."""
        done: dict[str, Any] = {"name": self.perturbation.name, "stream": list(context.identifiers)}
        if severity is not None:
            done["severity"] = severity
        if severity != 0:
            done["parameters"] = recorded(self.parameters(severity))
        return done if self.share is None else done | self.share.note(context.index)


def steps_of_kind(steps: Iterable[Step[Any]], kind: type[Kind]) -> tuple[Step[Kind], ...]:
    """Return the steps of a kind, in their order."""
    return tuple(step for step in steps if isinstance(step.perturbation, kind))


@dataclass(frozen=True)
class Setting:
    """A setting of the benchmark: a name, and its steps in propagation order. Without steps it is clean.

    backend: what executes the steps of colour. keys: of its entry in the preset, those that decide bytes by their own
    values. sensor: the steps that every setting's depth has before its own, where a rig has a depth sensor of a kind.
    """

    name: str
    steps: tuple[Step[Any], ...] = ()
    backend: Backend = "reference"
    keys: Mapping[str, Any] = field(default_factory=dict)
    sensor: tuple[Step[DepthPerturbation], ...] = ()

    @cached_property
    def stream(self) -> str:
        """The name under which its steps of colour and depth draw their random patterns: its own, if not another."""
        return next((step.stream for step in self.steps if step.stream is not None), self.name)

    @cached_property
    def motion(self) -> tuple[Step[MotionPerturbation], ...]:
        """The steps that act on the path."""
        return steps_of_kind(self.steps, MotionPerturbation)

    @cached_property
    def exposure(self) -> tuple[Step[ExposurePerturbation], ...]:
        """The steps that act on when a frame's images see the scene, but those of severity 0."""
        return tuple(step for step in steps_of_kind(self.steps, ExposurePerturbation) if step.severity != 0)

    @cached_property
    def measures_travel(self) -> bool:
        """Whether a step of exposure asks how far what is seen goes on the image, which takes depth."""
        return any(step.perturbation.measures_travel for step in self.exposure)

    @cached_property
    def rgb(self) -> tuple[Step[ColourPerturbation], ...]:
        """The steps that act on colour."""
        return steps_of_kind(self.steps, ColourPerturbation)

    @cached_property
    def depth(self) -> tuple[Step[DepthPerturbation], ...]:
        """The steps that act on depth."""
        return (*self.sensor, *steps_of_kind(self.steps, DepthPerturbation))

    def on(self, modality: str) -> tuple[Step[ColourPerturbation], ...] | tuple[Step[DepthPerturbation], ...]:
        """Return the steps that act on the images of a channel; none where nothing does."""
        match CHANNELS[modality].steps:
            case "rgb":
                return self.rgb
            case "depth":
                return self.depth
            case None:
                return ()

    @cached_property
    def pairing(self) -> tuple[Step[PairingPerturbation], ...]:
        """The steps that act on which depth is paired with which colour."""
        return steps_of_kind(self.steps, PairingPerturbation)

    @cached_property
    def composited(self) -> bool:
        """Whether Blender's compositor executes a step."""
        return self.backend == "compositor" and bool(self.rgb)

    @cached_property
    def needs_depth(self) -> bool:
        """Whether a step of colour depends on depth."""
        return any(step.perturbation.needs_depth for step in self.rgb)

    @cached_property
    def uses_motion(self) -> bool:
        """Whether a step of colour looks at the camera's motion."""
        return any(step.uses_motion for step in self.rgb)

    @cached_property
    def looks_back(self) -> bool:
        """Whether a step of colour looks at earlier frames."""
        return any(step.looks_back for step in self.rgb)

    @cached_property
    def looks_back_s(self) -> float:
        """How many seconds of earlier frames its steps ask for."""
        return max((step.looks_back_s for step in self.rgb), default=0.0)

    @cached_property
    def shutter(self) -> Shutter | None:
        """When the lines of a frame are exposed, as its steps of exposure say together; None where there are none."""
        found: Shutter | None = None
        for step in self.exposure:
            own = step.perturbation.shutter(step.parameters(step.severity))
            found = own if found is None else found.with_another(own)
        return found

    @cached_property
    def needs_rgb(self) -> bool:
        """Whether a step of depth depends on colour."""
        return any(step.perturbation.needs_rgb for step in self.depth)
