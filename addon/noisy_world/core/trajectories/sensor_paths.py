# SPDX-License-Identifier: GPL-3.0-or-later
"""The paths of a sequence's sensors, each under its name."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from .curve import NaturalSpline
from .frame_request import FrameRequest
from .trajectory import Trajectory


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
