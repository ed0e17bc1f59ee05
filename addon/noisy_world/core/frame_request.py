# SPDX-License-Identifier: GPL-3.0-or-later
"""What a source is asked for: a frame, at an instant or while a shutter is open, from sensors on their paths."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .curve import NaturalSpline
from .errors import NoisyWorldError
from .trajectory import Trajectory

ReadoutDirection: TypeAlias = Literal["down", "up", "right", "left"]


@dataclass(frozen=True)
class Shutter:
    """When the rows of a frame see light, in seconds from its time stamp, at which the ground truth's pose is taken.

    opens_s: when the exposure of the first line begins; negative is before the stamp. exposure_s: how long each line is
    exposed; 0 is an instant. readout_s: how much later all lines have been read; 0 is a global shutter. direction: in
    which rows (down, up) or columns (right, left) follow one another.

    Raises ValueError for times that are not finite, and for exposures and readouts below 0.
    """

    opens_s: float = 0.0
    exposure_s: float = 0.0
    readout_s: float = 0.0
    direction: ReadoutDirection = "down"

    def __post_init__(self) -> None:
        if not all(map(np.isfinite, (self.opens_s, self.exposure_s, self.readout_s))):
            raise ValueError(f"a shutter's times are finite numbers of seconds: {self}")
        if self.exposure_s < 0.0 or self.readout_s < 0.0:
            raise ValueError(f"exposure and readout take 0 seconds or more: {self}")

    @classmethod
    def centred(cls, exposure_s: float, readout_s: float = 0.0, direction: ReadoutDirection = "down") -> "Shutter":
        """Return a shutter whose middle line is in the middle of its exposure at the frame's time stamp."""
        return cls(-(exposure_s + readout_s) / 2.0, exposure_s, readout_s, direction)

    def with_another(self, other: "Shutter") -> "Shutter":
        """Return the shutter of two that act one inside the other: a blur whose lines are read one after another."""
        direction = self.direction if self.readout_s else other.direction
        exposure_s, readout_s = self.exposure_s + other.exposure_s, self.readout_s + other.readout_s
        return Shutter(self.opens_s + other.opens_s, exposure_s, readout_s, direction)

    def line_times_s(self, count: int) -> NDArray[np.float64]:
        """Return (count,) the middle of the exposure of each row or column, in the image's order from top or left."""
        places = (np.arange(count) + 0.5) / count
        order = places if self.direction in ("down", "right") else places[::-1]
        return self.opens_s + self.exposure_s / 2.0 + self.readout_s * order


@dataclass(frozen=True)
class RequestedRays:
    """Which rays make a frame, where they are not those of one instant.

    readout: when each line sees light, from the frame's time on; None where all lines do at once. depth_rolls: whether
    depth is read out so too, or all of it is of the frame's time.
    """

    readout: Shutter | None = None
    depth_rolls: bool = True


AT_ONCE = RequestedRays()
"""The rays of one instant."""

PosesAt: TypeAlias = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""(N,) seconds later -> (N, 4, 4) camera-to-world of the colour sensor, and of the depth sensor."""


@dataclass(frozen=True, eq=False)
class FrameRequest:
    """One frame, as a source is asked for it: what the sensors see at an instant, or line by line around it.

    index: the frame's number on the path; None between its frames. time_s: on the source's own clock, by which what
    moves in the scene moves. rgb_c2w, depth_c2w: (4, 4) float64 camera-to-world of the colour and of the depth sensor,
    OpenCV axes, metres. along_path: returns the request for an instant some seconds later; None where the sensors stand
    still.
    poses: returns the poses at several instants some seconds later; None where the sensors stand still. rays: those of
    the frame. channels: the images that are looked at, of those that the source was opened for; None for all of them.
    """

    index: int | None
    time_s: float
    rgb_c2w: NDArray[np.float64]
    depth_c2w: NDArray[np.float64]
    along_path: "Callable[[float], FrameRequest] | None" = field(default=None, repr=False)
    poses: PosesAt | None = field(default=None, repr=False)
    rays: RequestedRays = AT_ONCE
    channels: frozenset[str] | None = None

    @property
    def frame(self) -> int:
        """The number of the frame. Raises NoisyWorldError between frames, which a recording cannot answer."""
        if self.index is None:
            raise NoisyWorldError(f"there is no frame at {self.time_s:g} s, between those that were recorded")
        return self.index

    def after(self, seconds: float) -> "FrameRequest":
        """Return the request for an instant some seconds later, or earlier; this one for 0.

        Raises NoisyWorldError where the paths have no pose then.
        """
        if seconds == 0.0:
            return self
        if self.along_path is None:
            return replace(self, index=None, time_s=self.time_s + seconds)
        return self.along_path(seconds)

    def poses_after(self, seconds: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N,) seconds -> (N, 4, 4) poses of the colour and of the depth sensor so much later.

        Raises NoisyWorldError where the paths have no pose then.
        """
        if self.poses is not None:
            return self.poses(seconds)
        still = (np.broadcast_to(pose, (len(seconds), 4, 4)) for pose in (self.rgb_c2w, self.depth_c2w))
        return next(still), next(still)

    def looks_at(self, channel: str) -> bool:
        """Tell whether the image of a channel is looked at, where the source was opened for it."""
        return self.channels is None or channel in self.channels


# The paths of a sequence's sensors, each under its name.


@dataclass(frozen=True)
class SensorPaths:
    """The paths of a sequence, all with the same stamps; None where there is no such path of its own.

    rgb: the colour sensor's. depth: the depth sensor's, if its pose is another. robot: the carrying robot's, if there
    is a rig. nominal: the path that the colour sensor was meant to follow, if it deviates from it. clock: the time on
    the source's clock at each time of the paths; None where it is the same: it is, unless a path is followed faster.
    """

    rgb: Trajectory
    depth: Trajectory | None = None
    robot: Trajectory | None = None
    nominal: Trajectory | None = None
    clock: NaturalSpline | None = None

    def __len__(self) -> int:
        return len(self.rgb)

    def request(self, index: int) -> FrameRequest:
        """Return the request for a frame of the path, at its time stamp."""
        return replace(self.at(float(self.rgb.stamps_s[index])), index=index)

    def at(self, time_s: float) -> FrameRequest:
        """Return the request for an instant, on a frame or between two.

        Raises NoisyWorldError where the paths have no pose then.
        """
        depth = self.rgb if self.depth is None else self.depth
        source_s = time_s if self.clock is None else float(self.clock.at(time_s)[0])
        return FrameRequest(
            None,
            source_s,
            self.rgb.pose_at(time_s),
            depth.pose_at(time_s),
            lambda after_s: self.at(time_s + after_s),
            lambda after_s: (self.rgb.poses_at(time_s + after_s), depth.poses_at(time_s + after_s)),
        )

    def named(self) -> dict[str, Trajectory]:
        """Return the paths that are not None, by name."""
        paths = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "clock"}
        return {name: path for name, path in paths.items() if path is not None}

    def each(self, change: Callable[[Trajectory], Trajectory]) -> "SensorPaths":
        """Return the paths with the same change made to each."""
        return replace(self, **{name: change(path) for name, path in self.named().items()})
