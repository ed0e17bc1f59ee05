# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the first frames of a rendered path: if they see nothing, the path is taken for a mistake."""

from collections.abc import Callable
from dataclasses import dataclass

from ..core.errors import InputError
from ..core.planning.source import SourceFrame
from ..core.trajectories.frame_request import FrameRequest


@dataclass(frozen=True)
class Beginning:
    """The first moments of a path, at least one, and the error if none of them sees anything."""

    requests: tuple[FrameRequest, ...]
    error: InputError


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
