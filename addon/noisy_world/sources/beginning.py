# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the first frames of a rendered path: if they see nothing, the path is taken for a mistake."""

from collections.abc import Callable
from dataclasses import dataclass

from ..core.errors import InputError
from ..core.planning.source import SourceFrame
from ..core.schema import ConfigPath
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths


@dataclass(frozen=True)
class Beginning:
    """The first moments of a path, at least one, and the error if none of them sees anything."""

    requests: tuple[FrameRequest, ...]
    error: InputError


def beginning_of(
    paths: SensorPaths, frames: tuple[int, ...], path: str, *, unseen: str, place: ConfigPath, remedy: str
) -> Beginning | None:
    """Return what a path must not begin with, None where no frame is looked at.

    path, unseen: for the message, such as "nothing of room.ply". place: in the preset. remedy: beside going on.
    """
    if not frames:
        return None
    those = f"frame {frames[0]}" if len(frames) == 1 else f"frames {frames[0]} to {frames[-1]}"
    problem = f"{those} of {path} see{'s' * (len(frames) == 1)} {unseen}"
    error = place.error(problem, f"{remedy}, or go on with render.allow_empty: true")
    return Beginning(tuple(map(paths.request, frames)), error)


def check_beginning(
    beginning: Beginning, request: FrameRequest, frame: SourceFrame, render: Callable[[FrameRequest], SourceFrame]
) -> None:
    """Raise the error where none of the first frames sees anything.

    request, frame: what was rendered first. Frames that another process writes, or none, are rendered for this alone,
    so that each process of a run comes to the same end, before it has handed out a frame.
    """
    first, *others = beginning.requests
    if _sees_something(frame if request.index == first.index else render(first)):
        return
    if not any(_sees_something(render(other)) for other in others):
        raise beginning.error


def _sees_something(frame: SourceFrame) -> bool:
    """Tell whether a frame shows anything: void has no depth, and nothing to say by colour but a sky, if any."""
    image = frame.rgb if frame.depth_m is None else frame.depth_m
    return image is not None and bool(image.any())
