# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a rig's depth sensor beside its place: its own camera, its clock, and whether it is registered."""

import math
from dataclasses import dataclass

from ..geometry import Intrinsics
from ..schema import ConfigPath, key

SIZE = ("width", "height")
FOCAL = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class DepthCameraKeys:
    """What a depth sensor sees through, when, and in which camera's pixels its depth is written."""

    width: int | None = key("width of its image; default colour's", default=None, unit="px", minimum=1, maximum=65500)
    height: int | None = key("height of its image; default colour's", default=None, unit="px", minimum=1, maximum=65500)
    fx: float | None = key("its focal length", default=None, unit="px", above=0, maximum=1e6)
    fy: float | None = key("its focal length", default=None, unit="px", above=0, maximum=1e6)
    cx: float | None = key("its principal point", default=None, unit="px", minimum=-1e6, maximum=1e6)
    cy: float | None = key("its principal point", default=None, unit="px", minimum=-1e6, maximum=1e6)
    horizontal_fov_deg: float | None = key(
        "how wide it sees, instead of fx, fy, cx, cy: square pixels, the principal point in the middle",
        default=None,
        unit="deg",
        above=0,
        maximum=179,
    )
    registered: bool = key(
        "whether its depth is laid into colour's pixels, as the device's library does, or written as it is measured",
        default=False,
    )
    rate_hz: float | None = key(
        "its exposures a second; each frame shows the one that is nearest in time; default one for each frame",
        default=None,
        unit="Hz",
        minimum=0.01,
        maximum=10_000,
    )
    delay_ms: float = key(
        "how much later than colour it exposes", default=0.0, unit="ms", minimum=-10_000, maximum=10_000
    )
    clock_drift_ppm: float = key(
        "how much faster than colour's the clock goes by which it exposes",
        default=0.0,
        unit="ppm",
        minimum=-1e5,
        maximum=1e5,
    )

    @property
    def has_camera(self) -> bool:
        """Whether it has intrinsics of its own."""
        return any(getattr(self, name) is not None for name in (*SIZE, *FOCAL, "horizontal_fov_deg"))

    @property
    def has_clock(self) -> bool:
        """Whether it exposes at other times than colour."""
        return self.rate_hz is not None or self.delay_ms != 0.0 or self.clock_drift_ppm != 0.0

    def intrinsics(self, colour: Intrinsics) -> Intrinsics:
        """Return its camera. colour: the colour camera, which it has where it says none."""
        if not self.has_camera:
            return colour
        width, height = self.width or colour.width_px, self.height or colour.height_px
        if self.horizontal_fov_deg is not None:
            # Rounded, as a tangent's last bits differ between machines.
            focal_px = round(width / 2 / math.tan(math.radians(self.horizontal_fov_deg) / 2), 9)
            return Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)
        fx, fy, cx, cy = (float(getattr(self, name)) for name in FOCAL)
        return Intrinsics(width, height, fx, fy, cx, cy)


def check_depth_camera(spec: DepthCameraKeys, place: ConfigPath) -> None:
    """Refuse a camera of which some is missing or said twice. Raises InputError."""
    if not spec.has_camera:
        return
    given = [name for name in FOCAL if getattr(spec, name) is not None]
    if missing := [name for name in SIZE if getattr(spec, name) is None]:
        raise place.error(f"has a camera of its own without {missing[0]}", "give width and height")
    if given and spec.horizontal_fov_deg is not None:
        raise place.error(f"gives {given[0]} and horizontal_fov_deg", "keep one of them")
    if spec.horizontal_fov_deg is None and len(given) < len(FOCAL):
        lacking = next(name for name in FOCAL if name not in given)
        raise place.error(f"has a size of its own without {lacking}", "give fx, fy, cx, cy, or horizontal_fov_deg")
