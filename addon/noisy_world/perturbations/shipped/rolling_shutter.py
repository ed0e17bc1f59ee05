# SPDX-License-Identifier: GPL-3.0-or-later
"""Rolling shutter: the lines of an image are read one after another, each from where the camera is by then."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ...core.frame_request import ReadoutDirection, RequestedRays, Shutter
from ...core.schema import Choice, key
from ..kinds import About, Example, ExposurePerturbation

MS_PER_S = 1000.0


@dataclass(frozen=True)
class RollingShutter:
    """How long reading takes, which line comes first, and which moment of it the frame's time stamp is."""

    readout_ms: float = key(
        "how long reading all lines takes; each sees the scene in the middle of its own part of it",
        default=16.0,
        unit="ms",
        minimum=0,
        maximum=1000,
    )
    direction: ReadoutDirection = key(
        "where reading goes: over rows down or up, over columns right or left",
        default="down",
        choices={
            "down": Choice("Down", "The upper row is read first"),
            "up": Choice("Up", "The lower row is read first"),
            "right": Choice("Right", "The left column is read first"),
            "left": Choice("Left", "The right column is read first"),
        },
    )
    stamp: Literal["start", "middle", "end"] = key(
        "the moment of the readout that is the frame's time stamp, at which the ground truth's pose is taken",
        default="middle",
        choices={
            "start": Choice("Start", "When the first line is read"),
            "middle": Choice("Middle", "Half way from the first line to the last"),
            "end": Choice("End", "When the last line is read"),
        },
    )
    depth: Literal["rolling", "global"] = key(
        "rolling: each line of depth is of its own moment too; global: all depth is of the frame's time stamp",
        default="rolling",
        choices={
            "rolling": Choice("Rolling", "Each line of depth is of its own moment"),
            "global": Choice("Global", "All depth is of one moment, that of the time stamp"),
        },
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "readout_ms": "Higher: a moving camera skews and bends the picture more",
        "direction": "Where reading goes; what moves across that direction leans",
        "stamp": "Which moment of the readout has the time stamp and the pose of the frame",
        "depth": "Whether lines of depth are read one after another too, or all at once",
    }


def shutter(parameters: RollingShutter) -> Shutter:
    """Return when lines are read, in seconds from the frame's time stamp."""
    readout_s = parameters.readout_ms / MS_PER_S
    before = {"start": 0.0, "middle": 0.5, "end": 1.0}[parameters.stamp]
    return Shutter(-before * readout_s, 0.0, readout_s, parameters.direction)


def rays(of: RequestedRays, parameters: RollingShutter) -> RequestedRays:
    """Return rays that are cast line by line."""
    return replace(of, readout=shutter(parameters), depth_rolls=parameters.depth == "rolling")


PERTURBATION = ExposurePerturbation(
    name="rolling_shutter",
    label="Rolling shutter",
    order=10,
    parameters=RollingShutter,
    severities={"readout_ms": (5.0, 10.0, 16.0, 22.0, 30.0)},
    source="our own: chosen, from a fast sensor's readout to nearly a whole frame of 30 Hz",
    about=About(
        "Reads lines one after another, so that what moves is bent",
        "lines are read one after another, each from where the camera is by then ([the camera](camera.md))",
        caption="rows read within 5, 16 and 30 ms. Each frame is laid over that of one moment.",
        picture="Frames of a rolling shutter over frames of one moment",
        example=Example(
            text="A rolling shutter in the embedded room: fast, usual and slow readouts, and reading from right to "
            "left.",
            settings=(
                "{name: readout5ms, perturb: [{rolling_shutter: {severity: 1}}]}",
                "{name: readout16ms, perturb: [{rolling_shutter: {severity: 3}}]}",
                "{name: readout30ms, perturb: [{rolling_shutter: {severity: 5}}]}",
                "{name: sideways, perturb: [{rolling_shutter: {readout_ms: 30, direction: left}}]}",
                "{name: global_depth, perturb: [{rolling_shutter: {readout_ms: 30, depth: global}}]}",
            ),
            render="{engine: embree}",
            frames=24,
            rate_hz=4,
        ),
    ),
    shutter=shutter,
    rays=rays,
    tells_lines=True,
)
