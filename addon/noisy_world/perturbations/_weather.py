# SPDX-License-Identifier: GPL-3.0-or-later
"""What falling rain and snow share: their parameters, and their execution on arrays.

Each pixel's light is image * t + light * (1 - t), linear, with t the transmission of the streaks before its depth and
of the veil of all particles too small to be seen by themselves, as Koschmieder's law has it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.linear_light import LUMINANCE, decoded, encoded
from ..core.perturbing.kinds import FrameContext
from ..core.schema import Choice, key
from ..core.trajectories.camera_state import camera_state_of
from ._air_light import AIR_TOOLTIPS, air_light, colour_of
from ._bands import by_bands
from ._lamp_light import lamps_key
from ._particles import Air, AirCamera, affordable, in_sight, slopes_of
from ._patterns import three_channels
from ._precipitation import Precipitation, veil_depth
from ._streaks import Lens, optical_depth, streaks_of
from ._view import camera_of
from ._void import SKY_M

Float32: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class Falling:
    """The parameters of all that falls."""

    rate_mm_h: float = key("water that falls", default=1.0, unit="mm/h", minimum=0.01, maximum=500)
    size: float = key("a particle's diameter, times the measured one", default=1.0, minimum=0.05, maximum=20)
    brightness: float = key("its light, times the scene's mean", default=1.0, minimum=0, maximum=100)
    tint: float = key("how far its light has the colour of the scene's mean", default=0.25, minimum=0, maximum=1)
    wind_m_s: float = key("wind to the right", default=0.0, unit="m/s", minimum=-50, maximum=50)
    gusts_m_s: float = key(
        "standard deviation of each particle's own velocity", default=0.0, unit="m/s", minimum=0, maximum=10
    )
    fall: float = key("speed of fall, times that in still air", default=1.0, minimum=0, maximum=10)
    shutter_ms: float = key("how long the shutter is open", default=5.0, unit="ms", minimum=0, maximum=1000)
    aperture_mm: float = key("diameter of the lens; 0 is a pinhole", default=2.0, unit="mm", minimum=0, maximum=100)
    focus_m: float = key(
        "planar depth of what is sharp", default=5.0, unit="m", minimum=0.1, maximum=10000, slider=(0.1, 10)
    )
    least_mrad: float = key(
        "what spans less is not drawn but veils", default=1.0, unit="mrad", minimum=0.2, maximum=100
    )
    reach_m: float = key("what is farther is not drawn but veils", default=20.0, unit="m", minimum=0.5, maximum=200)
    air: Literal["auto", "scene", "mean", "colour"] = key(
        "where its light comes from: auto is scene on lit scenes, whose light is not clipped, else mean; scene: the "
        "sky's colour where there is sky, else a mean that lamps do not move; mean: of the frame; colour: as given",
        default="auto",
        choices={
            "auto": Choice("Automatic", "Scene on lit scenes, whose light is not clipped, else Mean"),
            "scene": Choice("Scene", "The sky's colour where there is sky, else a mean that lamps do not move"),
            "mean": Choice("Mean", "The mean of the picture"),
            "colour": Choice("Colour", "As given below"),
        },
    )
    air_red: float = key("red of its light, sRGB-encoded", default=0.5, minimum=0, maximum=20)
    air_green: float = key("green of its light, sRGB-encoded", default=0.5, minimum=0, maximum=20)
    air_blue: float = key("blue of its light, sRGB-encoded", default=0.5, minimum=0, maximum=20)
    lamps: float = lamps_key()
    leave_sky: bool = key("no veil over the sky", default=False)
    void_m: float = key("void counts as this far", default=500.0, unit="m", minimum=0.1, maximum=100000)
    view_deg: float = key(
        "horizontal field of view, where the camera is unknown", default=90.0, unit="deg", minimum=1, maximum=170
    )
    frame_rate_hz: float = key(
        "frames a second, by which it drifts", default=20.0, unit="Hz", minimum=0.001, maximum=100000
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = AIR_TOOLTIPS | {
        "size": "Higher: every particle is larger",
        "tint": "Higher: particles take more of the color of the scene",
        "fall": "Higher: they fall faster, in longer streaks",
        "aperture_mm": "Higher: particles out of focus become larger, fainter disks",
        "focus_m": "How far away particles are sharp; nearer and further ones are blurred",
        "least_mrad": "Higher: fewer small particles are drawn, and the veil in the distance gets denser instead",
        "reach_m": "Lower: less of what is far is drawn, and the veil takes its place",
        "void_m": "Higher: where nothing is, the veil gets denser",
        "view_deg": "Higher: a wider view, so particles are smaller in it",
        "frame_rate_hz": "Lower: with the pattern Drift, particles move further from frame to frame",
    }


GIVEN_AIR = {f"air_{name}": ("air", "colour") for name in ("red", "green", "blue")}
"""What giving a colour implies."""


@dataclass(frozen=True)
class Kind:
    """Rain or snow. particles: of a rate in mm/h. speed_m_s: of fall in still air, by the diameter in metres.

    brightness: that with which it has the very colour of the sky, or that which is given.
    """

    particles: Callable[[float], Precipitation]
    speed_m_s: Callable[[Float32], Float32]
    brightness: float

    def air(self, parameters: Falling) -> Air:
        """Return what falls."""
        return Air(
            self.particles(parameters.rate_mm_h).sized(parameters.size),
            parameters.least_mrad * 1e-3,
            parameters.reach_m,
            # A larger particle falls no faster than the measured one that it stands for.
            lambda diameter_m: (
                self.speed_m_s(diameter_m * np.float32(1 / parameters.size)) * np.float32(parameters.fall)
            ),
            parameters.wind_m_s,
            parameters.gusts_m_s,
        )


def fallen_on(kind: Kind, rgb: Float32, parameters: Falling, context: FrameContext) -> Float32:
    """Let it fall on (H, W, 3), by the context's planar depth (H, W), metres; 0 is void, as is a sky."""
    import cv2

    height, width = context.depth_m.shape
    air = drawn_air(kind, parameters, camera_of(context.intrinsics, (width, height), parameters.view_deg))
    surface = (context.depth_m > 0) & (context.depth_m <= SKY_M)
    depth_m = np.where(surface, context.depth_m, np.float32(parameters.void_m))
    opaque = streaks_on(air, depth_m, parameters, context)
    linear = by_bands(rgb, rgb.dtype, decoded)
    # A row of it: three numbers beside an image take ten times as long.
    light = np.tile(_light(linear, kind, parameters, context), depth_m.shape[1])

    def veiled(band: Float32, band_depth_m: Float32, band_opaque: Float32, veiled_here: NDArray[np.bool_]) -> Float32:
        veil = veil_depth(band_depth_m, air.particles, air.least_rad, air.reach_m)
        veil *= veiled_here
        veil += band_opaque
        seen = three_channels(np.asarray(cv2.exp(-veil), np.float32).reshape(veil.shape))
        rows = band.reshape(len(band), -1)
        rows -= light
        rows *= seen.reshape(rows.shape)
        rows += light
        return encoded(band)

    return by_bands(linear, rgb.dtype, veiled, depth_m, opaque, surface | (not parameters.leave_sky))


@lru_cache(maxsize=64)
def drawn_air(kind: Kind, parameters: Falling, camera: Intrinsics) -> Air:
    """Return what falls, and is drawn by itself, before a camera: no more than can be afforded."""
    slopes = slopes_of(*_lens(camera))
    return affordable(kind.air(parameters), slopes, parameters.shutter_ms * 1e-3)


def limits_of(kind: Kind, parameters: Falling, camera: Intrinsics) -> str:
    """Return what is drawn less of before a camera than the parameters ask for, "" where nothing."""
    least_mrad = drawn_air(kind, parameters, camera).least_rad * 1e3
    if least_mrad <= parameters.least_mrad * (1 + 1e-9):
        return ""
    return (
        f"falls through more air than a frame can be drawn of, as the camera sees so wide: what spans less than "
        f"{least_mrad:.3g} mrad is not drawn but veils, instead of {parameters.least_mrad:g} mrad (least_mrad)"
    )


def _lens(camera: Intrinsics) -> tuple[tuple[float, float], tuple[float, float], tuple[int, int]]:
    """Return focal lengths, middle and size of the image in pixels, each along x and y."""
    return (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px), (camera.width_px, camera.height_px)


def _light(linear: Float32, kind: Kind, parameters: Falling, context: FrameContext) -> Float32:
    """Return (3,): the linear light of what falls before (H, W, 3) of linear light."""
    if parameters.air == "colour":
        given = colour_of(parameters.air_red, parameters.air_green, parameters.air_blue)
        return (given * (parameters.brightness / kind.brightness)).astype(np.float32)
    if parameters.air == "mean" or (parameters.air == "auto" and not context.lit):
        return light_of(linear, parameters)
    air = air_light(linear, context.depth_m)
    own = kind.brightness * _greyed(air.surfaces, parameters.tint)
    return (air.over(own) * (parameters.brightness / kind.brightness)).astype(np.float32)


def light_of(linear: Float32, parameters: Falling) -> Float32:
    """Return (3,): the linear light of what falls before (H, W, 3) of linear light.

    The mean's colour is in part the surfaces', not the light's, so it is made grey but for a share.
    """
    import cv2

    return (parameters.brightness * _greyed(np.array(cv2.mean(linear)[:3]), parameters.tint)).astype(np.float32)


def _greyed(mean: NDArray[np.float64], tint: float) -> NDArray[np.float64]:
    grey = mean @ LUMINANCE
    return grey + tint * (mean - grey)


def streaks_on(air: Air, depth_m: Float32, parameters: Falling, context: FrameContext) -> Float32:
    """Return (H, W): the optical depth of the streaks before each pixel."""
    time_s = context.drift_frames / parameters.frame_rate_hz
    view = view_of(depth_m, parameters, context)
    hashed = int(context.pattern_stream().integers(2**64, dtype=np.uint64))
    particles = in_sight(air, view, hashed, time_s)
    streaks = streaks_of(particles, view, Lens(parameters.aperture_mm * 1e-3, parameters.focus_m))
    return optical_depth(streaks, depth_m)


def view_of(depth_m: Float32, parameters: Falling, context: FrameContext) -> AirCamera:
    """Return the camera of a frame in the air.

    Without a path the camera is level and at rest. A pattern that is fixed goes with the camera; others stay in the air
    while it moves.
    """
    height, width = depth_m.shape
    camera = camera_of(context.intrinsics, (width, height), parameters.view_deg)
    lens = (*_lens(camera), float(depth_m.max()), parameters.shutter_ms * 1e-3)
    camera_state = camera_state_of(None if context.temporal == "fixed" else context.motion)
    return AirCamera(
        camera_state.rotation, camera_state.position_m, camera_state.velocity_m_s, camera_state.turning_rad_s, *lens
    )
