# SPDX-License-Identifier: GPL-3.0-or-later
"""The lens that a preset asks for, and sessions of renderers that know pinholes alone, bent as it does."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.bending import Bending, overscanned
from ..core.geometry import Intrinsics
from ..core.messages import Message, PresetKey
from ..core.optics import Distortion
from ..core.planning.bent_frames import surfaces_bent
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.presets.distortion import DistortionSpec, sound_lens
from ..core.presets.preset import Preset
from ..core.schema import ConfigPath
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths

MOST_TIMES = 16.0  # as many pixels as the image has may be rendered for it; chosen


def lens_of(spec: DistortionSpec, camera: Intrinsics, place: ConfigPath, *, cast: bool) -> Distortion:
    """Return the lens that a mesh is seen through. cast: whether rays are cast through it, rather than a pinhole bent.

    Raises InputError where it folds over within the image, or a pinhole would take too long to render.
    """
    lens = sound_lens(spec, camera, place, all_around=cast)
    if cast:
        return lens
    pinhole = overscanned(camera, lens)
    times = pinhole.width_px * pinhole.height_px / (camera.width_px * camera.height_px)
    if times > MOST_TIMES:
        size = f"{pinhole.width_px} x {pinhole.height_px} px, {times:.0f} times the image"
        raise place.error(f"needs a pinhole's {size}", Message("use ", PresetKey("render.engine", "embree")))
    return lens


def check_light_lens(preset: Preset) -> None:
    """Refuse to undistort what is lit, whose light before its view transform is bent alone. Raises InputError."""
    camera = preset.spec.camera
    if camera is not None and camera.distortion is not None and camera.distortion.undistort:
        place = preset.place("camera").at("distortion").at("undistort")
        raise place.error("is true, but light before a view transform is not undistorted", "leave it out")


@dataclass
class BentSession:
    """A session of a renderer that knows pinholes alone, whose frames are bent as a lens does.

    session: of the pinhole of `bending`. own_depth: whether depth is of a camera of its own. origin_m: (3,) float64,
    around which it is rendered. notes: what a user should know about how it is rendered.
    """

    session: Any
    bending: Bending
    own_depth: bool = False
    origin_m: NDArray[np.float64] = field(init=False)
    notes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        pinhole = self.bending.pinhole
        size = f"{pinhole.width_px} x {pinhole.height_px}"
        said = f"rendered as a pinhole's {size} px, and bent as the lens does: interpolated"
        self.origin_m, self.notes = self.session.origin_m, (*self.session.notes, said)

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        return self.session.serves(paths, options)

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame, and bend it."""
        frame = self.session.frame(request)
        coloured = replace(frame, rgb=None if frame.rgb is None else self.bending.rgb(frame.rgb))
        return surfaces_bent(coloured, self.bending, own_depth=self.own_depth)

    def __enter__(self) -> "BentSession":
        self.session.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.session.__exit__(*error)
