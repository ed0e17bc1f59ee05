# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation is: its parameters, its severities, its executions; and the order of the stages.

A perturbation is one file in `noisy_world.perturbations` with a `PERTURBATION`. Presets, panels, sockets, `--list` and
the tests are derived from it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..streams import stream

type Category = Literal["motion", "environment", "lens", "sensor", "post", "depth", "sync"]
"""A stage of the image's way, in the paper's propagation order (section "Perturbation Taxonomy")."""

CATEGORIES: tuple[Category, ...] = ("motion", "environment", "lens", "sensor", "post", "depth", "sync")
RGB_CATEGORIES: tuple[Category, ...] = ("environment", "lens", "sensor", "post")

type Temporal = Literal["fresh", "fixed", "drift"]
"""How a random pattern goes on from frame to frame: redrawn, kept, or moved smoothly."""

SEVERITIES = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Frame:
    """Where in which sequence an image stands, and the randomness that belongs there.

    index: the frame's number. identifiers: name the stream (preset's seed, scene, setting, perturbation, its place
    among equals). temporal: how patterns go on. Every frame draws the same numbers alone as in the whole sequence.
    """

    index: int
    identifiers: tuple[str | int, ...]
    temporal: Temporal = "fresh"

    def stream(self, *purpose: str) -> np.random.Generator:
        """Return a generator of this frame's own."""
        return stream(*self.identifiers, *purpose, frame=self.index)

    def pattern_stream(self, *purpose: str) -> np.random.Generator:
        """Return the generator of what `temporal` keeps: this frame's own, or the sequence's."""
        if self.temporal == "fresh":
            return self.stream(*purpose)
        return stream(*self.identifiers, *purpose, "sequence")

    @property
    def drift_frames(self) -> int:
        """How many frames a kept pattern has moved on: 0 unless it drifts."""
        return self.index if self.temporal == "drift" else 0


type RgbApply = Callable[[NDArray[np.float32], Any, Frame], NDArray[np.float32]]
"""(H, W, 3) float32 RGB, sRGB-encoded, in [0, 1]; parameters; frame -> a new array alike. The input is left alone.

The result may lie outside [0, 1]: whoever calls clips.
"""

type BytesApply = Callable[[NDArray[np.uint8], Any, Frame], NDArray[np.uint8]]
"""(H, W, 3) uint8 RGB; parameters; frame -> a new array alike. The input is left alone.

Byte for byte what `apply` makes of `rgb / np.float32(255)`, rounded by `images.rgb_bytes`: a faster way, no other one.
"""

type GroupBuild = Callable[[Any, Mapping[str, Any], Mapping[str, float]], Any]
"""groups.Canvas; a socket for each parameter, sizes in pixels of the image that arrives, angles in degrees; the largest
values to be served -> the socket of the perturbed image, encoded as the canvas's. It may lie outside [0, 1].
"""

type DepthApply = Callable[[NDArray[np.float32], Any, Frame], NDArray[np.float32]]
"""(H, W) float32 planar depth in metres, 0 = void; parameters; frame -> a new array alike. The input is left alone."""


@dataclass(frozen=True)
class Perturbation:
    """One perturbation of the taxonomy.

    name: as in presets. label: as in panels. parameters: a frozen dataclass of `schema.key` fields with defaults.
    severities: for each parameter that severity sets, its value at severities 1 to 5. source: of those values.
    apply: the reference execution; None for what acts on trajectories or on the pairing of frames.
    apply_bytes: the same on bytes, where a frame comes as bytes, goes as bytes and nothing else stands between.
    temporals: what `temporal` may be; () where nothing is random.
    counts: parameters that are whole numbers, which a fractional severity rounds.
    build: the same definition as a compositor node group. capacity: for parameters that the number of its nodes depends
    on, the largest value that the group serves by default. needs_depth: the group has an input for planar depth.
    """

    name: str
    label: str
    category: Category
    parameters: type
    severities: Mapping[str, Sequence[float]]
    source: str
    apply: RgbApply | DepthApply | None = None
    apply_bytes: BytesApply | None = None
    temporals: tuple[Temporal, ...] = ()
    counts: frozenset[str] = field(default_factory=frozenset)
    build: GroupBuild | None = None
    capacity: Mapping[str, float] = field(default_factory=dict)
    needs_depth: bool = False

    def __post_init__(self) -> None:
        known = {item.name for item in fields(self.parameters)}
        for name, values in self.severities.items():
            if name not in known or len(values) != len(SEVERITIES):
                raise ValueError(f"{self.name}: {name} has to be a parameter with {len(SEVERITIES)} severities")

    def at_severity(self, severity: float, **given: Any) -> Any:
        """Return the parameters of a severity, linearly between the table's; `given` stand over them.

        severity: 1 to 5. Raises ValueError for any other: 0 is the identity, which has no parameters, and between 0
        and 1 there is nothing to interpolate from.
        """
        if not SEVERITIES[0] <= severity <= SEVERITIES[-1]:
            raise ValueError(f"severity is {severity}, but has to be 0 or from 1 to 5")
        values: dict[str, Any] = {}
        for name, table in self.severities.items():
            value = float(np.interp(severity, SEVERITIES, table))
            values[name] = math.floor(value + 0.5) if name in self.counts else value
        return replace(self.parameters(), **(values | given))
