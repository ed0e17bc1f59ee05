# SPDX-License-Identifier: GPL-3.0-or-later
"""A render's source, opened along its paths; where the render has an exposure, its frames are exposed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import pair_channels
from ..channels.depth import CHANNEL as DEPTH
from ..core.curve import NaturalSpline
from ..core.frame_request import FrameRequest, RequestedRays, SensorPaths, Shutter
from ..core.geometry import Intrinsics
from ..core.srgb import decoded, encoded
from ..core.trajectory import Trajectory, rounded_path
from ..images.pixels import as_float
from ..perturbations.execution import Notes, chosen_poses, expose, exposure_notes, move, rays_of, take_poses
from ..perturbations.kinds import Channels, SceneAround, TakenImages
from ..render.source import (
    OpenSource,
    OwnRendering,
    PreparedSource,
    RenderedFrame,
    RenderOptions,
    SceneLight,
    SourceFrame,
    motion_between,
)
from ..trajectories.rig import sensor_trajectory
from .identity import render_seed
from .plan import ClockedSource, Plan, Render

FIRST_FRAMES = 3  # a path whose first three frames see nothing is taken for a mistake; chosen


@dataclass(frozen=True)
class ExposedSource:
    """A source whose frames are exposed as a render says."""

    opened: OpenSource
    render: Render

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request, of what the source shows around its moment."""
        steps = self.render.exposure
        around = _Around(self.opened, self.render, request, rays_of(steps))
        taken = dict[str, int]()
        if any(step.perturbation.apply is not None for step in steps):
            rgb, depth_m = expose(steps, SceneAround(around.take, around.travel_px), taken)
        else:
            once = around.take(0.0, None)
            rgb, depth_m = None if once.rgb is None else as_float(once.rgb), once.depth_m
        notes, rays = self._notes(request, taken), around.colour_rays or None
        if rgb is None or around.light is None:
            return RenderedFrame(rgb, depth_m, colour_rays=rays, behind_glass_m=around.behind_m, exposure=notes)
        light = replace(around.light, rgb=np.maximum(decoded(rgb), np.float32(0)))
        seen = {"light": light, "behind_glass_m": around.behind_m}
        return RenderedFrame(light.show(light.rgb), depth_m, colour_rays=rays, exposure=notes, **seen)

    def _notes(self, request: FrameRequest, taken: Mapping[str, int]) -> Notes:
        """Return what was done to a frame, with the poses of its lines where a step tells them."""
        steps = self.render.exposure
        notes = exposure_notes(steps)
        for step, note in zip(steps, notes, strict=True):
            if (count := taken.get(step.perturbation.name)) is not None:
                note["moments"] = count
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


class _Around:
    """What a source shows around the moment of a request.

    colour_rays: how many have been cast for colour. light: of the last lit frame; None where no frame was lit.
    behind_m: depth behind panes of the last frame whose depth was looked at; None where there are none.
    """

    def __init__(self, opened: OpenSource, render: Render, request: FrameRequest, rays: RequestedRays) -> None:
        self._opened = opened
        self._render = render
        self._request = request
        self._rays = rays
        self.light: SceneLight | None = None
        self.behind_m: NDArray[np.float32] | None = None
        self._whole: tuple[float, TakenImages] | None = None  # the last frame of which all images were taken, and when
        self.colour_rays = 0

    def take(self, seconds: float, channels: Channels) -> TakenImages:
        """Return the clean images some seconds after the request's moment; those that are not looked at may be None."""
        if self._whole is not None and abs(self._whole[0] - seconds) < 1e-12:
            return self._whole[1]
        frame = self._opened.frame(replace(self._request.after(seconds), rays=self._rays, channels=channels))
        if isinstance(frame, RenderedFrame) and frame.colour_rays is not None:
            self.colour_rays += frame.colour_rays
        taken: TakenImages = frame
        if (behind_m := frame.behind_glass_m) is not None:
            self.behind_m = behind_m
        if (light := frame.light) is not None:
            self.light, taken = light, _TakenLight(encoded(light.rgb), frame.depth_m)
        if channels is None:
            self._whole = seconds, taken
        return taken

    def travel_px(self, times_s: NDArray[np.float64]) -> float:
        """Return how far what any pixel sees goes on the image, at most: see `Moments`. Depth is of the middle time."""
        from ..core.camera_motion import travel_px

        middle_s = float(times_s[len(times_s) // 2])
        depth_m = self.take(middle_s, None).depth_m
        assert depth_m is not None, "a step that measures travel has depth"
        here, (c2w, _) = self._request.after(middle_s), self._request.poses_after(times_s)
        cameras, lens = (self._render.measured_camera, self._render.camera), self._render.optics.distortion
        longest_px = travel_px(depth_m, here.depth_c2w, c2w, *cameras, lens=lens)
        if not self._render.scene.source.capabilities.moving:
            return longest_px
        first, last = (self._request.after(float(times_s[at])) for at in (0, -1))
        moved = motion_between(self._opened, first, last)
        return (
            longest_px if moved is None else max(longest_px, float(np.nanmax(np.hypot(*np.moveaxis(moved[0], -1, 0)))))
        )


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
    exposed = ExposedSource(opened, render) if render.exposure else opened
    if render.unit is None or render.unit.clock is None:
        return exposed
    stamps = render.scene.source.frame_stamps
    return ClockedSource(exposed, np.round(stamps.depth.seconds - stamps.rgb.seconds, 9), options.channels)


def render_options(plan: Plan, render: Render, *, judging: bool = False, threads: int = 0) -> RenderOptions:
    """Return how frames of a render are made.

    judging: whether the first frames of the path are looked at, whoever makes them, unless the preset allows that they
    see nothing. threads: of the renderer, 0 for all that there are.
    """
    spec = plan.preset.spec
    rendering_spec = OwnRendering(
        spec.render.engine, spec.render.samples, spec.mesh_camera.near_m, spec.mesh_camera.far_m
    )
    rendering = render.scene.source.capabilities.own or rendering_spec
    led_on = pair_channels(plan.format.modalities)
    channels = frozenset(plan.format.modalities).union(render.needed_besides, [DEPTH.name] if led_on else ())
    needed_frames = tuple(render.frames[:FIRST_FRAMES]) if judging and not spec.render.allow_empty else ()
    return RenderOptions(
        near_m=rendering.near_m,
        far_m=rendering.far_m,
        samples=rendering.samples,
        seed=0 if rendering.engine == "embree" else render_seed(spec.seed),  # rays need none, so a scene serves any
        engine=rendering.engine,
        device=spec.render.device,
        channels=channels.difference(item.name for item in led_on),
        threads=threads,
        first_frames=needed_frames,
        through_glass=any(sequence.setting.needs_depth for sequence in render.sequences),
        depth_camera=_own_depth_camera(render),
        instants=bool(render.exposure),
        read_lines=any(step.perturbation.rays for step in render.exposure),
    )


def _own_depth_camera(render: Render) -> Intrinsics | None:
    """Return the camera of a rig's depth sensor, where it is not colour's."""
    own = render.unit is not None and render.unit.camera is not None
    return render.measured_camera if own and render.scene.source.capabilities.depth_cameras else None


# The paths of the sensors in a render, which its source frames are seen along.


def source_paths(plan: Plan, render: Render, count: int | None = None) -> SensorPaths:
    """Return the sensors' paths of a render, after its steps of motion; with "nominal" where these deviate.

    All are rounded, so that what is rendered along them, and drawn of it, is the same everywhere.

    count: how many of the scene's first poses are taken, if not all.
    """
    planned = render.scene.path
    planned = planned if count is None else planned.at(slice(count), planned.stamps_s[:count])
    if not render.moving:
        return _sensor_paths(plan, planned)
    moved = move(render.moving, planned, render.identifiers)
    chosen = chosen_poses(render.moving, len(planned), render.identifiers)
    found = _sensor_paths(plan, moved)
    if chosen is not None:
        found = replace(found, clock=NaturalSpline(planned.stamps_s[: len(chosen)], planned.stamps_s[chosen, None]))
    if all(step.perturbation.apply is None for step in render.moving):
        return found
    return replace(found, nominal=_sensor_paths(plan, take_poses(planned, chosen)).rgb)


def _sensor_paths(plan: Plan, trajectory: Trajectory) -> SensorPaths:
    if plan.rig is None:
        return SensorPaths(rounded_path(trajectory))
    depth = None if plan.rig.depth is None else sensor_trajectory(trajectory, plan.rig.depth)
    return SensorPaths(sensor_trajectory(trajectory, plan.rig.rgb), depth, trajectory).each(rounded_path)
