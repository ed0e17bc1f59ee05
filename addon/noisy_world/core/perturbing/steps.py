# SPDX-License-Identifier: GPL-3.0-or-later
"""What a setting does to a sequence: its perturbations in the order of propagation.

The order is the paper's, whatever the order in the preset: motion, then colour (environment, lens, sensor,
post-processing) and depth, then pairing; within a stage as each perturbation says.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from .kinds import (
    ColourPerturbation,
    DepthPerturbation,
    FrameContext,
    Identifiers,
    MotionPerturbation,
    PairingPerturbation,
    Perturbation,
    SequenceContext,
    Temporal,
)

type Backend = Literal["compositor", "reference"]


@dataclass(frozen=True)
class Step[Kind: Perturbation]:
    """One perturbation of a setting.

    occurrence: its number among those of the same name, from 0. severity: None where parameters alone are given.
    levels: what each frame's severity is drawn from, in dynamic mode. given: parameters that stand over the severity's.
    """

    perturbation: Kind
    occurrence: int
    severity: float | None
    levels: tuple[float, ...] | None
    temporal: Temporal
    given: Mapping[str, Any]

    def context(self, where: FrameContext) -> FrameContext:
        """Return what this step is told of a frame. where: the frame, with the identifiers of its sequence.

        Other images are handed on only to a perturbation that says that it needs them.
        """
        kind = self.perturbation
        return replace(
            where,
            identifiers=(*where.identifiers, kind.name, self.occurrence),
            temporal=self.temporal,
            read_rgb=where.read_rgb if isinstance(kind, DepthPerturbation) and kind.needs_rgb else None,
            read_depth_m=where.read_depth_m if isinstance(kind, ColourPerturbation) and kind.needs_depth else None,
        )

    def sequence_context(self, identifiers: Identifiers) -> SequenceContext:
        """Return what this step is told of a whole sequence. identifiers: the sequence's."""
        return SequenceContext((*identifiers, self.perturbation.name, self.occurrence))

    def severity_of(self, context: FrameContext) -> float | None:
        """Return the severity of a frame; in dynamic mode it is drawn, evenly and for each frame alone."""
        if self.levels is None:
            return self.severity
        return self.levels[int(context.stream("severity").integers(len(self.levels)))]

    def parameters(self, severity: float | None) -> Any:
        """Return the parameters of a severity."""
        if severity is None:
            return self.perturbation.parameters(**self.given)
        return self.perturbation.at_severity(severity, **self.given)

    def note(self, context: FrameContext, severity: float | None) -> dict[str, Any]:
        """Say for the provenance what is done to a frame."""
        done: dict[str, Any] = {"name": self.perturbation.name, "stream": list(context.identifiers)}
        if severity is not None:
            done["severity"] = severity
        if severity != 0:
            done["parameters"] = asdict(self.parameters(severity))
        return done


def steps_of_kind[Kind: Perturbation](steps: Iterable[Step[Any]], kind: type[Kind]) -> tuple[Step[Kind], ...]:
    """Return the steps of a kind, in their order."""
    return tuple(step for step in steps if isinstance(step.perturbation, kind))


@dataclass(frozen=True)
class Setting:
    """A setting of the benchmark: a name and what is done to every scene, in propagation order. None is clean.

    backend: what executes the steps of colour.
    """

    name: str
    steps: tuple[Step[Any], ...] = ()
    backend: Backend = "reference"

    @property
    def motion(self) -> tuple[Step[MotionPerturbation], ...]:
        """What is done to the path."""
        return steps_of_kind(self.steps, MotionPerturbation)

    @property
    def rgb(self) -> tuple[Step[ColourPerturbation], ...]:
        """What is done to colour."""
        return steps_of_kind(self.steps, ColourPerturbation)

    @property
    def depth(self) -> tuple[Step[DepthPerturbation], ...]:
        """What is done to depth."""
        return steps_of_kind(self.steps, DepthPerturbation)

    @property
    def pairing(self) -> tuple[Step[PairingPerturbation], ...]:
        """What is done to which depth goes with which colour."""
        return steps_of_kind(self.steps, PairingPerturbation)

    @property
    def composited(self) -> bool:
        """Whether Blender's compositor has something to do."""
        return self.backend == "compositor" and bool(self.rgb)

    @property
    def needs_depth(self) -> bool:
        """Whether something is done to colour that depends on depth."""
        return any(step.perturbation.needs_depth for step in self.rgb)

    @property
    def needs_rgb(self) -> bool:
        """Whether something is done to depth that depends on colour."""
        return any(step.perturbation.needs_rgb for step in self.depth)
