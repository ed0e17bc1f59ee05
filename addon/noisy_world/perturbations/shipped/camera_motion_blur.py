# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur of the camera's own path: the light of many moments while the shutter is open, and depth of one."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.frame_request import Shutter
from ...core.schema import Choice, key
from ...core.srgb import decoded, encoded, quick_light
from ..kinds import About, Example, ExposurePerturbation, SceneAround

MS_PER_S = 1000.0
PLACES = {"start": 0.0, "middle": 0.5, "end": 1.0}
POSES = 33  # at which the path within the shutter is looked at: a vibration of eight periods is followed; chosen


@dataclass(frozen=True)
class CameraMotionBlur:
    """How long and how the shutter is open, and how many moments stand for it."""

    shutter_ms: float = key("how long the shutter is open", default=16.0, unit="ms", minimum=0, maximum=1000)
    stamp: Literal["start", "middle", "end"] = key(
        "the moment of the exposure that is the frame's time stamp, at which the ground truth's pose is taken",
        default="middle",
        choices={
            "start": Choice("Start", "When the shutter opens"),
            "middle": Choice("Middle", "Half way through the exposure"),
            "end": Choice("End", "When the shutter closes"),
        },
    )
    ramp: float = key(
        "the share of the time in which the shutter opens, and closes again: 0 is at once, 1 a triangle",
        default=0.0,
        minimum=0,
        maximum=1,
    )
    depth: Literal["start", "middle", "end"] = key(
        "the moment of the exposure that depth is of, which stays sharp",
        default="middle",
        choices={
            "start": Choice("Start", "Depth of when the shutter opens"),
            "middle": Choice("Middle", "Depth of half way through the exposure"),
            "end": Choice("End", "Depth of when the shutter closes"),
        },
    )
    moments_per_px: float = key(
        "moments whose light is averaged, for each pixel of the longest blur in the image",
        default=1.0,
        unit="1/px",
        minimum=0.01,
        maximum=16,
    )
    most_moments: int = key("no more moments than that", default=129, minimum=1, maximum=4097)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "shutter_ms": "Higher: a moving camera smears the picture more",
        "stamp": "Which moment of the exposure has the time stamp and the pose of the frame",
        "ramp": "Higher: the shutter opens and closes more slowly, and streaks fade out at their ends",
        "depth": "Which moment of the exposure depth shows; it stays sharp",
        "moments_per_px": "Higher: smoother streaks, and it takes longer",
        "most_moments": "Higher: long streaks are smooth too, and take longer",
    }


def shutter(parameters: CameraMotionBlur) -> Shutter:
    """Return when the shutter is open, in seconds from the frame's time stamp."""
    exposure_s = parameters.shutter_ms / MS_PER_S
    return Shutter(-PLACES[parameters.stamp] * exposure_s, exposure_s)


def moment_count(blur_px: float, parameters: CameraMotionBlur) -> int:
    """Return how many moments stand for a blur of some pixels: an odd number, so that one is the middle."""
    wanted = 2 * math.ceil(min(blur_px * parameters.moments_per_px, parameters.most_moments) / 2.0) + 1
    return min(wanted, parameters.most_moments - 1 + parameters.most_moments % 2)


def openness(places: NDArray[np.float64], ramp: float) -> NDArray[np.float64]:
    """Return how far the shutter is open at places (N,) of the exposure from 0 to 1: a trapezoid's height, (N,)."""
    if ramp == 0.0:
        return np.ones_like(places)
    return np.minimum(1.0, np.minimum(places, 1.0 - places) / (ramp / 2.0))


def apply(
    take: SceneAround, parameters: CameraMotionBlur
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the mean light of moments in the middle of equal parts of the exposure, and depth of one of them."""
    open_ = shutter(parameters)
    blur_px = take.travel_px(open_.opens_s + open_.exposure_s * np.linspace(0.0, 1.0, POSES))
    count = moment_count(blur_px, parameters)
    places = (np.arange(count) + 0.5) / count
    weights = openness(places, parameters.ramp)
    weights /= weights.sum()
    depth_m = take(open_.opens_s + open_.exposure_s * PLACES[parameters.depth], frozenset({"depth"})).depth_m
    light: NDArray[np.float32] | None = None
    for place, weight in zip(places, weights, strict=True):
        rgb = take(open_.opens_s + open_.exposure_s * place, frozenset({"rgb"})).rgb
        if rgb is None:
            return None, depth_m
        if count == 1:
            return np.asarray(rgb, np.float32), depth_m
        part = decoded(rgb) if rgb.dtype != np.uint8 and rgb.max(initial=0) > 1 else quick_light(rgb)
        part *= np.float32(weight)
        light = part if light is None else np.add(light, part, out=light)
    assert light is not None, "there is at least one moment"
    return encoded(light), depth_m


PERTURBATION = ExposurePerturbation(
    name="camera_motion_blur",
    label="Camera motion blur",
    order=20,
    parameters=CameraMotionBlur,
    severities={"shutter_ms": (4.0, 8.0, 16.0, 24.0, 33.0)},
    source="our own: chosen, from an exposure in daylight to all of a frame of 30 Hz",
    about=About(
        "Leaves the shutter open while the camera moves, so that near things smear more",
        "the light of the whole exposure along the camera's path ([the camera](camera.md))",
        caption="a shutter open for 4, 16 and 33 ms.",
        picture="Frames of a shutter that is open for 4, 16 and 33 ms",
        example=Example(
            text="Blur of the camera's own motion in the embedded room: short and long exposures, and a shutter "
            "that opens slowly.",
            settings=(
                "{name: shutter4ms, perturb: [{camera_motion_blur: {severity: 1}}]}",
                "{name: shutter16ms, perturb: [{camera_motion_blur: {severity: 3}}]}",
                "{name: shutter33ms, perturb: [{camera_motion_blur: {severity: 5}}]}",
                "{name: triangle, perturb: [{camera_motion_blur: {shutter_ms: 33, ramp: 1}}]}",
            ),
            render="{engine: embree}",
            frames=24,
            rate_hz=4,
        ),
    ),
    shutter=shutter,
    apply=apply,
    measures_travel=True,
)
