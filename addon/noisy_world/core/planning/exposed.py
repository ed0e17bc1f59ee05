# SPDX-License-Identifier: GPL-3.0-or-later
"""A render's source, opened: where the render has an exposure, each frame is taken line by line or again and again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..perturbing.execution import Notes, expose, exposure_notes, rays_of
from ..perturbing.exposing import Channels, Moments
from ..trajectories.frame_request import FrameRequest, Shutter
from ..trajectories.sensor_paths import SensorPaths
from .plan import Render
from .source import OpenSource, PreparedSource, RenderedFrame, RenderOptions, SourceFrame


@dataclass(frozen=True)
class ExposedFrame(RenderedFrame):
    """A frame that was exposed. exposure: what was done, for its record."""

    exposure: Notes = field(default_factory=Notes)


def exposure_of(frame: SourceFrame) -> Notes:
    """Return what the exposure of a frame did, for its record; empty without one."""
    return getattr(frame, "exposure", [])  # frames of other sources have none


@dataclass(frozen=True)
class ExposedSource:
    """A source whose frames are exposed as a render says."""

    opened: OpenSource
    render: Render

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request, of what the source shows around its moment."""
        steps = self.render.exposure
        rays, cast = rays_of(steps), list[int | None]()

        def take(seconds: float, channels: Channels) -> SourceFrame:
            frame = self.opened.frame(replace(request.after(seconds), rays=rays, channels=channels))
            cast.append(frame.colour_rays if isinstance(frame, RenderedFrame) else None)
            return frame

        if any(step.perturbation.apply is not None for step in steps):
            rgb, depth_m = expose(steps, Moments(take))
        else:
            once = take(0.0, None)
            rgb, depth_m = once.rgb, once.depth_m
        rays_cast = [count for count in cast if count is not None]
        return ExposedFrame(rgb, depth_m, colour_rays=sum(rays_cast) or None, exposure=self._notes(request))

    def _notes(self, request: FrameRequest) -> Notes:
        """Return what was done to a frame, with the poses of its lines where a step tells them."""
        steps = self.render.exposure
        notes = exposure_notes(steps)
        for step, note in zip(steps, notes, strict=True):
            if step.perturbation.tells_lines:
                note["lines"] = self._lines(step.perturbation.shutter(step.parameters(step.severity)), request)
        return notes

    def _lines(self, shutter: Shutter, request: FrameRequest) -> Mapping[str, Any]:
        """Return when the first, the middle and the last line that are read see the scene, and from where."""
        camera = self.render.camera
        count = camera.height_px if shutter.direction in ("down", "up") else camera.width_px
        times_s = np.sort(shutter.line_times_s(count))
        chosen_s = np.array([times_s[0], (times_s[0] + times_s[-1]) / 2, times_s[-1]]).round(12)
        c2w, _ = request.poses_after(chosen_s)
        return {
            name: {"after_s": float(after_s), "c2w": pose.tolist()}
            for name, after_s, pose in zip(("first", "middle", "last"), chosen_s, c2w, strict=True)
        }


def open_render(
    prepared: PreparedSource, render: Render, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]
) -> OpenSource:
    """Return what gives the clean frames of a render. paths: the render's. note: hears what a user should know."""
    opened = prepared.open(paths, options, note)
    return ExposedSource(opened, render) if render.exposure else opened
