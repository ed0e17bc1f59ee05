# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the sensors of a sequence go, each path under its name."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .trajectory import Trajectory


@dataclass(frozen=True)
class Moment:
    """What a source is asked for: a frame at poses and a time.

    index: the frame's number on the path. time_s: its time stamp. rgb_c2w, depth_c2w: (4, 4) float64 camera-to-world of
    the colour and of the depth sensor, OpenCV axes, metres.
    """

    index: int
    time_s: float
    rgb_c2w: NDArray[np.float64]
    depth_c2w: NDArray[np.float64]


@dataclass(frozen=True)
class SensorPaths:
    """Where each thing goes; all have the same stamps.

    rgb: the colour sensor. depth: the depth sensor, where it is elsewhere. robot: what carries them, where there is a
    rig. nominal: where the colour sensor was meant to go, where it deviates from that.
    """

    rgb: Trajectory
    depth: Trajectory | None = None
    robot: Trajectory | None = None
    nominal: Trajectory | None = None

    def __len__(self) -> int:
        return len(self.rgb)

    def moment(self, index: int) -> Moment:
        """Return where the sensors are at a frame."""
        depth = self.rgb if self.depth is None else self.depth
        return Moment(index, float(self.rgb.stamps_s[index]), self.rgb.c2w[index], depth.c2w[index])

    def named(self) -> dict[str, Trajectory]:
        """Return the paths that there are, by name."""
        paths = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: path for name, path in paths.items() if path is not None}

    def each(self, change: Callable[[Trajectory], Trajectory]) -> "SensorPaths":
        """Return the paths after the same change to each."""
        return SensorPaths(**{name: change(path) for name, path in self.named().items()})
