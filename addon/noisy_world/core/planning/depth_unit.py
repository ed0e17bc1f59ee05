# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig's depth sensor that is a device of its own: another camera than colour's, another clock, registered or raw."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics, invert_pose
from ..optics import DepthCamera, Optics
from ..presets.preset import DepthSensorSpec
from ..scenes.mesh import Mesh
from ..trajectories.frame_request import FrameRequest
from ..trajectories.rig import Rig
from ..trajectories.rounding import rounded_poses
from ..trajectories.stamps import FrameStamps, Stamps
from ..trajectories.trajectory import Axes, Trajectory
from .source import (
    Motion,
    OpenSource,
    PreparedSource,
    RenderedFrame,
    Source,
    SourceCapabilities,
    SourceFrame,
    motion_between,
)

Float64 = NDArray[np.float64]
_SAME_POSE = 1e-12


@dataclass(frozen=True)
class DepthClock:
    """When a depth sensor exposes, on colour's clock, which is that of all stamps.

    rate_hz: its exposures a second of its own clock; None for one with each frame. delay_s: how much later than
    colour's first frame its first exposure is. drift_ppm: how much faster its clock goes.
    """

    rate_hz: float | None = None
    delay_s: float = 0.0
    drift_ppm: float = 0.0

    def exposures_s(self, stamps_s: Float64) -> Float64:
        """(N,) stamps of frames -> (N,) when the depth that each shows was exposed, in whole microseconds.

        With a rate that is the exposure which is nearest in time; of two the earlier one, and none before the first.
        """
        first_s, faster = float(stamps_s[0]), 1.0 + self.drift_ppm * 1e-6
        passed_s = stamps_s - first_s
        if self.rate_hz is None:
            return np.round(first_s + passed_s / faster + self.delay_s, 6)
        rate_hz = self.rate_hz * faster
        numbers = np.maximum(np.ceil((passed_s - self.delay_s) * rate_hz - 0.5 - 1e-9), 0.0)
        return np.round(first_s + self.delay_s + numbers / rate_hz, 6)


@dataclass(frozen=True)
class DepthUnit:
    """A rig's depth sensor.

    camera: where it is not colour's, None where it is. registered: whether its depth is laid into colour's pixels after
    it was measured. clock: None where it exposes with colour.
    """

    camera: DepthCamera | None = None
    registered: bool = False
    clock: DepthClock | None = None

    @property
    def raw(self) -> DepthCamera | None:
        """Its camera, where its depth is written as it was measured."""
        return None if self.registered else self.camera


def depth_unit(spec: DepthSensorSpec | None, rig: Rig | None, colour: Intrinsics) -> DepthUnit | None:
    """Return a rig's depth sensor; None where it has neither a camera nor a clock of its own. colour: the camera's."""
    if spec is None or rig is None:
        return None
    clock = DepthClock(spec.rate_hz, spec.delay_ms / 1e3, spec.clock_drift_ppm) if spec.has_clock else None
    if not spec.has_camera and not spec.registered:
        return None if clock is None else DepthUnit(clock=clock)
    rows = None
    if rig.depth is not None:
        between = invert_pose(rig.rgb.robot_from_sensor) @ rig.depth.robot_from_sensor
        if np.abs(between - np.eye(4)).max() > _SAME_POSE:
            rows = tuple(tuple(row) for row in rounded_poses(between).tolist())
    camera = DepthCamera(spec.intrinsics(colour), rows)
    if rows is None and camera.intrinsics == colour:
        return None if clock is None else DepthUnit(clock=clock)
    return DepthUnit(camera, spec.registered, clock)


@dataclass(frozen=True)
class MountedSource:
    """A source as it is seen by a rig whose depth sensor is a device of its own: its stamps and its optics."""

    source: Source
    unit: DepthUnit

    @property
    def location(self) -> str:
        """The source's."""
        return self.source.location

    @property
    def capabilities(self) -> SourceCapabilities:
        """The source's."""
        return self.source.capabilities

    @property
    def stamps_s(self) -> Float64:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.source.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the source, with depth's by its own clock."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        stamps = self.source.frame_stamps
        if self.unit.clock is None:
            return stamps
        return replace(stamps, depth=Stamps(self.unit.clock.exposures_s(self.stamps_s)))

    @property
    def repeats(self) -> NDArray[np.int64] | None:
        """(N,): the first frame that shows the exposure of depth which each shows; None where each shows its own."""
        if self.unit.clock is None:
            return None
        _, first, inverse = np.unique(self.frame_stamps.depth.seconds, return_index=True, return_inverse=True)
        shown = first[inverse].astype(np.int64)
        return None if len(first) == len(shown) else shown

    @property
    def robot_axes(self) -> Axes | None:
        """The source's."""
        return self.source.robot_axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics of colour."""
        return self.source.camera(asked)

    def optics(self, camera: Intrinsics) -> Optics:
        """Return what its cameras have beyond one pinhole: depth's own, where it is written raw."""
        own = self.source.optics(camera)
        return own if self.unit.raw is None else replace(own, depth=self.unit.raw)

    def trajectory(self) -> Trajectory:
        """Return the source's path."""
        return self.source.trajectory()

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """The source's."""
        return self.source.mesh

    def remarks(self, camera: Intrinsics) -> Iterable[str]:
        """Return the source's."""
        return self.source.remarks(camera)

    def hashes(self) -> dict[str, Any]:
        """Return what decides the source's bytes."""
        return self.source.hashes()

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Prepare the source."""
        return self.source.prepare(camera, note)


@dataclass(frozen=True)
class ClockedSource:
    """A source whose depth is of another moment than colour. after_s: (N,) how much later, for each frame."""

    opened: OpenSource
    after_s: Float64
    channels: frozenset[str]

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request: all but depth at its time, and depth when that is exposed."""
        if request.index is None or (after_s := float(self.after_s[request.index])) == 0.0:
            return self.opened.frame(request)
        wanted = self.channels if request.channels is None else self.channels & request.channels
        depth_m = None
        if "depth" in wanted:
            late = replace(request.after(after_s), rays=request.rays, channels=frozenset({"depth"}))
            depth_m = self.opened.frame(late).depth_m
        if wanted <= {"depth"}:
            return RenderedFrame(None, depth_m)
        seen = self.opened.frame(replace(request, channels=wanted - {"depth"}))
        if isinstance(seen, RenderedFrame):
            return replace(seen, depth_m=depth_m)
        others = {name: image for name in wanted - {"rgb", "depth"} if (image := seen.image(name)) is not None}
        rgb: Any = seen.rgb
        return RenderedFrame(rgb, depth_m, others, light=seen.light)

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return what the source says."""
        return motion_between(self.opened, here, there)
