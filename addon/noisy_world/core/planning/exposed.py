# SPDX-License-Identifier: GPL-3.0-or-later
"""A render's source, opened: where the render has an exposure, each frame is taken at several moments."""

from collections.abc import Callable
from dataclasses import dataclass

from ..perturbing.execution import expose
from ..trajectories.frame_request import FrameRequest
from ..trajectories.sensor_paths import SensorPaths
from .plan import Render
from .source import OpenSource, PreparedSource, RenderedFrame, RenderOptions, SourceFrame


@dataclass(frozen=True)
class ExposedSource:
    """A source whose frames are exposed as a render says."""

    opened: OpenSource
    render: Render

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request, of what the source shows around its moment."""
        return RenderedFrame(*expose(self.render.exposure, lambda after_s: self.opened.frame(request.after(after_s))))


def open_render(
    prepared: PreparedSource, render: Render, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]
) -> OpenSource:
    """Return what gives the clean frames of a render. paths: the render's. note: hears what a user should know."""
    opened = prepared.open(paths, options, note)
    return ExposedSource(opened, render) if render.exposure else opened
