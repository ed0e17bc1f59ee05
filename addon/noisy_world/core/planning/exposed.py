# SPDX-License-Identifier: GPL-3.0-or-later
"""A render's source, opened: where the render has an exposure, each frame is taken at several moments."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..linear_light import decoded, encoded
from ..perturbing.execution import expose
from ..perturbing.exposing import TakenImages
from ..trajectories.frame_request import FrameRequest
from ..trajectories.sensor_paths import SensorPaths
from .plan import Render
from .source import OpenSource, PreparedSource, RenderedFrame, RenderOptions, SceneLight, SourceFrame, light_of


@dataclass(frozen=True)
class ExposedSource:
    """A source whose frames are exposed as a render says."""

    opened: OpenSource
    render: Render

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request, of what the source shows around its moment."""
        lights: list[SceneLight] = []

        def take(after_s: float) -> TakenImages:
            frame = self.opened.frame(request.after(after_s))
            if (light := light_of(frame)) is None:
                return frame
            lights.append(light)
            return _TakenLight(encoded(light.rgb), frame.depth_m)

        rgb, depth_m = expose(self.render.exposure, take)
        if rgb is None or not lights:
            return RenderedFrame(rgb, depth_m)
        exposed = replace(lights[-1], rgb=np.maximum(decoded(rgb), np.float32(0)))
        return RenderedFrame(exposed.show(exposed.rgb), depth_m, light=exposed)


@dataclass(frozen=True)
class _TakenLight:
    """A lit frame's images for an exposure: its light, encoded by sRGB's curve, which goes on above 1."""

    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32] | None


def open_render(
    prepared: PreparedSource, render: Render, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]
) -> OpenSource:
    """Return what gives the clean frames of a render. paths: the render's. note: hears what a user should know."""
    opened = prepared.open(paths, options, note)
    return ExposedSource(opened, render) if render.exposure else opened
