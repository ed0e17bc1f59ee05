# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps on mains flicker: at twice its frequency, so frames differ and lines that are read one by one show bands."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.frame_request import Shutter
from ...core.node_graph import Socket
from ...core.schema import key
from ...core.srgb import decoded, encoded
from ..groups import Canvas
from ..kinds import About, Automatic, ByFrame, ColourPerturbation, Example, FrameContext, FrameValue, Nodes
from ._arrays import by_bands

MS_PER_S = 1000.0


@dataclass(frozen=True)
class Flicker:
    """Light is 1 + modulation cos(4 pi mains t + phase), here its mean while a line is exposed, in linear light.

    That is 1 + modulation sinc(2 mains exposure) cos(4 pi mains t + phase), at the middle t of the line's exposure; the
    phase is drawn. Exposure and lines are those of rolling_shutter and camera_motion_blur, where the setting has them;
    else the exposure is auto_exposure's, or as given.
    """

    mains_hz: float = key("frequency of the mains: 50 or 60", default=50.0, unit="Hz", above=0, maximum=10_000)
    modulation: float = key(
        "how much of its mean the light goes up and down: a lamp's percent flicker", default=0.2, minimum=0, maximum=1
    )
    exposure_ms: float = key(
        "how long a line is exposed, where no other step says", default=4.0, unit="ms", minimum=0, maximum=1e4
    )
    readout_ms: float = key(
        "how long reading all lines takes, from the top down, where no rolling_shutter says",
        default=0.0,
        unit="ms",
        minimum=0,
        maximum=1000,
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "mains_hz": "What the lamps hang on; bands are narrower at 60 than at 50",
        "modulation": "Higher: stronger bands, or frames that differ more",
        "exposure_ms": "Higher: weaker; lamps go out of sight at whole periods, as 10 or 20 ms at 50 Hz",
        "readout_ms": "Higher: more bands; 0 is a whole frame at once",
    }


def brightness(parameters: Flicker, shutter: Shutter, stamp_s: float, phase: float, lines: int) -> NDArray[np.float64]:
    """Return (lines,): the light of each over its mean. phase: of the lamps at time 0, radians."""
    lamps_hz = 2 * parameters.mains_hz
    times_s = shutter.line_times_s(lines)
    turns = math.fmod(stamp_s * lamps_hz, 1.0) + times_s * lamps_hz
    seen = parameters.modulation * np.sinc(lamps_hz * shutter.exposure_s)
    return 1.0 + seen * np.cos(2 * math.pi * turns + phase)


def shutter_of(parameters: Flicker, context: FrameContext) -> Shutter:
    """Return when the lines of a frame are exposed."""
    given = context.shutter or Shutter.centred(0.0)
    exposure_s = given.exposure_s or context.decided.get("exposure_ms", parameters.exposure_ms) / MS_PER_S
    if given.readout_s:
        return Shutter(
            given.opens_s - (exposure_s - given.exposure_s) / 2, exposure_s, given.readout_s, given.direction
        )
    readout_s = parameters.readout_ms / MS_PER_S
    middle_s = given.opens_s + given.exposure_s / 2
    return Shutter(middle_s - (exposure_s + readout_s) / 2, exposure_s, readout_s)


def phase_of(context: FrameContext) -> float:
    """Return the phase of the lamps at time 0, radians."""
    return float(context.pattern_stream("phase").uniform(0.0, 2 * math.pi))


def decides(parameters: Flicker, context: FrameContext) -> Mapping[str, float]:
    """Return the light of a frame's middle line over its mean."""
    shutter, stamp_s = shutter_of(parameters, context), context.stamp_s or 0.0
    return {"flicker": float(brightness(parameters, shutter, stamp_s, phase_of(context), 1)[0])}


def apply(rgb: NDArray[np.float32], parameters: Flicker, context: FrameContext) -> NDArray[np.float32]:
    """Light (H, W, 3) by lamps."""
    shutter = shutter_of(parameters, context)
    rows = shutter.direction in ("down", "up")
    lines = rgb.shape[0] if rows else rgb.shape[1]
    light = brightness(parameters, shutter, context.stamp_s or 0.0, phase_of(context), lines).astype(np.float32)
    if not rows:
        return by_bands(rgb, rgb.dtype, lambda band: encoded(decoded(band) * light[:, None]))
    return by_bands(rgb, rgb.dtype, lambda band, own: encoded(decoded(band) * own), light[:, None, None])


def bands_of(parameters: Flicker, context: FrameContext) -> Mapping[str, float]:
    """Return what a frame's lines are lit by, as its node group is told: see `build`."""
    shutter, lamps_hz = shutter_of(parameters, context), 2 * parameters.mains_hz
    middle_s = shutter.opens_s + (shutter.exposure_s + shutter.readout_s) / 2
    turns = math.fmod((context.stamp_s or 0.0) * lamps_hz, 1.0) + middle_s * lamps_hz
    bands = lamps_hz * shutter.readout_s * (1 if shutter.direction in ("down", "right") else -1)
    down = shutter.direction in ("down", "up")
    return {
        "swing": parameters.modulation * float(np.sinc(lamps_hz * shutter.exposure_s)),
        "phase": (turns + phase_of(context) / (2 * math.pi)) % 1.0,
        "bands_down": bands if down else 0.0,
        "bands_across": 0.0 if down else bands,
    }


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Light by 1 + swing cos(2 pi (phase + bands from the middle))."""
    graph = canvas.graph
    with graph.section("Bands"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
        down = graph.math("MULTIPLY_ADD", 0.5 - share.y, given["bands_down"], given["phase"])
        turns = graph.math("MULTIPLY_ADD", share.x - 0.5, given["bands_across"], down)
    with graph.section("Lamps"):
        wave = graph.math("COSINE", graph.math("FRACT", turns) * (2 * math.pi))
        factor = graph.math("MULTIPLY_ADD", wave, given["swing"], 1.0)
    with graph.section("Light"):
        return canvas.image * graph.vector(factor, factor, factor)


PERTURBATION = ColourPerturbation(
    name="flicker",
    label="Flicker",
    stage="sensor",
    order=4,
    parameters=Flicker,
    severities={"modulation": (0.05, 0.1, 0.2, 0.35, 0.6)},
    source="our own: chosen, from a filament's percent flicker to more than a fluorescent lamp on a magnetic ballast",
    about=About(
        "Makes frames lighter and darker, or bands across them, as lamps on the mains do",
        "lamps at twice the mains' frequency, with bands where lines are read one by one",
        caption="lamps on mains of 50 Hz, with lines that are read within 20 ms.",
        picture="Bands of flicker at severities 1, 3 and 5",
        example=Example(
            text="Lamps on mains of 50 Hz in the embedded room: whole frames that differ, and bands across lines "
            "read in 20 ms.",
            settings=(
                "{name: frames, perturb: [{flicker: {severity: 3}}]}",
                "{name: bands, perturb: [{flicker: {severity: 3, readout_ms: 20}}]}",
                "{name: strong_bands, perturb: [{flicker: {severity: 5, readout_ms: 20, exposure_ms: 1}}]}",
            ),
            render="{backend: reference}",
            frames=12,
            rate_hz=24,
        ),
    ),
    apply=apply,
    temporals=("fixed", "fresh"),
    on_light=True,
    automatic=Automatic(decides=decides),
    nodes=Nodes(
        build,
        linear=True,
        by_frame=ByFrame(
            {
                "swing": FrameValue("How much of its mean the light goes up and down", 0.2, -1.0, 1.0),
                "phase": FrameValue(
                    "Turns of the lamps' light at the image's middle; with keys that rise they go on", 0.0, -1e6, 1e6
                ),
                "bands_down": FrameValue(
                    "Turns of the lamps' light while lines are read from top to bottom; below 0 upwards", 2.0, -2e4, 2e4
                ),
                "bands_across": FrameValue(
                    "Turns of the lamps' light while lines are read from left to right; below 0 leftwards",
                    0.0,
                    -2e4,
                    2e4,
                ),
            },
            bands_of,
        ),
    ),
)
