# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto-exposure: a camera sets exposure time and gain by the frames before, and follows changes of light late."""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import Choice, key
from ...core.srgb import LUMINANCE, decoded, encoded
from ..groups import Canvas
from ..kinds import (
    About,
    Automatic,
    ByFrame,
    ColourPerturbation,
    EarlierFrame,
    Example,
    FrameContext,
    FrameValue,
    Nodes,
)
from ._arrays import by_bands

# What a camera's automatics make of earlier frames: a first-order lag, sampled at frames that need not be regular.


LEAST_WEIGHT = 1e-4  # what is so far back that all before it weighs less counts with the oldest frame that is looked at


def lag_span_s(lag_s: float) -> float:
    """Return how many seconds of earlier frames an automatic of this time constant looks at."""
    return -math.log(LEAST_WEIGHT) * lag_s


def lag_weights(stamps_s: Sequence[float], now_s: float, lag_s: float) -> NDArray[np.float64]:
    """Return (N,) weights of frames at increasing stamps (N,) before now; their sum is 1.

    x' = (wanted - x) / lag_s, where each frame's wish holds until the next frame: x now is the sum of
    (exp(-(now - t[j + 1]) / lag) - exp(-(now - t[j]) / lag)) wanted[j]; the oldest frame's wish held ever before. A
    lag of 0 does what the last frame asks for.
    """
    ends = np.append(np.asarray(stamps_s[1:], np.float64), now_s)
    if lag_s == 0:
        return np.append(np.zeros(len(ends) - 1), 1.0)
    reached = np.exp(-np.maximum(now_s - ends, 0.0) / lag_s)
    return np.diff(reached, prepend=0.0)


def lagged(
    context: FrameContext, lag_s: float, wanted: Callable[[EarlierFrame], NDArray[np.float64]], by: Hashable
) -> NDArray[np.float64]:
    """Return what an automatic is at in a frame. wanted: what it would have, seeing a frame. by: what decides that."""
    frames = context.earlier(lag_span_s(lag_s))
    now_s = frames[-1].stamp_s if context.stamp_s is None else context.stamp_s
    weights = lag_weights([frame.stamp_s for frame in frames], now_s, lag_s)
    for frame in frames:
        if by not in frame.asked:
            frame.asked[by] = wanted(frame)
    return np.sum([weight * frame.asked[by] for weight, frame in zip(weights, frames, strict=True)], axis=0)


DB_PER_STOP = 20 * math.log10(2)
CENTRE = 0.25  # standard deviation of the centre's weight, of width and height; chosen


@dataclass(frozen=True)
class AutoExposure:
    """Exposure time and gain by the light of earlier clean frames, the time first, in linear light.

    In stops of exposure it goes to what the last frame asks for, log2(target / mean light), as
    1 - exp(-t / lag), within what time and gain allow. The light of an image is light x 2^light_stops x exposure /
    reference x gain. It begins settled. What other steps do to earlier frames is not metered.
    """

    target: float = key("mean light that it aims at, of white", default=0.18, above=0, maximum=1)
    meter: Literal["average", "centre"] = key(
        "which part of the image counts",
        default="average",
        choices={
            "average": Choice("Average", "All of the picture alike"),
            "centre": Choice("Centre", "The middle of the picture most"),
        },
    )
    lag_s: float = key("time constant of following", default=0.4, unit="s", minimum=0, maximum=5)
    light_stops: float = key(
        "how much brighter the scene's light is than in the image; below 0 darker", default=0.0, minimum=-20, maximum=8
    )
    reference_ms: float = key(
        "exposure that shows the image as it is, at no gain", default=10.0, unit="ms", above=0, maximum=1e4
    )
    min_ms: float = key("shortest exposure", default=0.05, unit="ms", above=0, maximum=1e4)
    max_ms: float = key("longest exposure", default=33.0, unit="ms", above=0, maximum=1e4)
    max_gain_db: float = key(
        "most gain, where the exposure is at its longest", default=24.0, unit="dB", minimum=0, maximum=72
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "target": "Higher: the picture gets lighter",
        "meter": "Which part of the picture is made as light as the target",
        "lag_s": "Higher: the picture stays too light or too dark for longer after the light changes",
        "light_stops": "Lower: a darker scene, so a longer exposure and more gain, with more noise",
        "reference_ms": "Higher: all exposures get longer alike",
        "min_ms": "Higher: bright scenes get too light",
        "max_ms": "Lower: gain begins earlier, with more noise",
        "max_gain_db": "Lower: dark scenes stay dark",
    }


def decides(parameters: AutoExposure, context: FrameContext) -> Mapping[str, float]:
    """Return exposure_ms and gain_db of a frame."""
    shortest, longest = (math.log2(each / parameters.reference_ms) for each in (parameters.min_ms, parameters.max_ms))
    most = longest + parameters.max_gain_db / DB_PER_STOP

    def wanted(frame: EarlierFrame) -> NDArray[np.float64]:
        light = metered(frame.light, parameters.meter) * 2.0**parameters.light_stops
        asked = math.log2(parameters.target / light) if light > 0 else most
        return np.array(min(max(asked, shortest), most))

    stops = float(lagged(context, parameters.lag_s, wanted, ("auto_exposure", parameters)))
    time_stops = min(stops, longest)
    return {
        "exposure_ms": parameters.reference_ms * 2.0**time_stops,
        "gain_db": max(stops - time_stops, 0.0) * DB_PER_STOP,
    }


def metered(light: NDArray[np.float32], meter: str) -> float:
    """Return the mean luminance of (h, w, 3) linear light, of all or of a Gaussian around the middle."""
    luminance = light.astype(np.float64) @ np.array(LUMINANCE)
    if meter == "average":
        return float(luminance.mean())
    places = ((np.arange(side) + 0.5) / side - 0.5 for side in luminance.shape)
    down, across = (np.exp(-0.5 * np.square(place / CENTRE)) for place in places)
    weights = np.outer(down, across)
    return float((luminance * weights).sum() / weights.sum())


def apply(rgb: NDArray[np.float32], parameters: AutoExposure, context: FrameContext) -> NDArray[np.float32]:
    """Expose (H, W, 3)."""
    decided = context.decided
    times = decided["exposure_ms"] / parameters.reference_ms * 10.0 ** (decided["gain_db"] / 20.0)
    factor = np.float32(times * 2.0**parameters.light_stops)
    return by_bands(rgb, rgb.dtype, lambda band: encoded(decoded(band) * factor))


def stops_of(parameters: AutoExposure, context: FrameContext) -> Mapping[str, float]:
    """Return by how many stops a frame is brighter than its image: by the scene's light, exposure time and gain."""
    decided = context.decided
    times = math.log2(decided["exposure_ms"] / parameters.reference_ms)
    return {"exposure": times + decided["gain_db"] / DB_PER_STOP + parameters.light_stops}


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Multiply the light."""
    graph = canvas.graph
    with graph.section("Exposure"):
        factor = graph.math("POWER", 2.0, given["exposure"])
    with graph.section("Light"):
        return canvas.image * graph.vector(factor, factor, factor)


def contradiction(parameters: AutoExposure) -> str:
    """Return what cannot be in these values; "" for nothing."""
    if parameters.min_ms <= parameters.max_ms:
        return ""
    return f"min_ms is {parameters.min_ms:g}, more than max_ms, {parameters.max_ms:g}"


PERTURBATION = ColourPerturbation(
    name="auto_exposure",
    label="Auto-exposure",
    stage="sensor",
    order=2,
    parameters=AutoExposure,
    severities={"lag_s": (0.1, 0.2, 0.4, 0.8, 1.6)},
    source="our own: chosen, from two frames of 20 Hz to a slow webcam",
    about=About(
        "Sets exposure and gain by the frames before, so that changes of light are followed late",
        "exposure time and gain by the frames before, with a lag ([the camera](camera.md#exposure-gain-and-noise))",
        caption="exposure time and gain by the frames before. Here 0.4 s after the light rose eightfold, with time "
        "constants of 0.1, 0.4 and 1.6 s.",
        picture="0.4 s after the light rose eightfold, at severities 1, 3 and 5",
        example=Example(
            text="Auto-exposure along a walk in the embedded room: quick and slow, and in a sixteenth and a "
            "thousandth of the light.",
            settings=(
                "{name: quick, perturb: [{auto_exposure: {severity: 1}}]}",
                "{name: slow, perturb: [{auto_exposure: {severity: 5}}]}",
                "{name: dim, perturb: [{auto_exposure: {light_stops: -4}}]}",
                "{name: dark, perturb: [{auto_exposure: {light_stops: -10}}]}",
            ),
            render="{backend: reference}",
            frames=24,
            rate_hz=4,
        ),
    ),
    apply=apply,
    contradiction=contradiction,
    on_light=True,
    automatic=Automatic(looks_back_s=lambda parameters: lag_span_s(parameters.lag_s), decides=decides),
    nodes=Nodes(
        build,
        linear=True,
        by_frame=ByFrame({"exposure": FrameValue("Stops by which the image is brighter", 1.0, -32.0, 32.0)}, stops_of),
    ),
)
