# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a Blender scene as a preset names them: FIRST:LAST or FIRST:LAST:STEP, first and last with them."""

import re
from dataclasses import dataclass

LAST_POSSIBLE = 1_048_574
"""The last frame that Blender knows (MAXFRAME); its frames begin at minus that."""


@dataclass(frozen=True)
class FrameRange:
    """The frames first, first + step, ... up to last."""

    first: int
    last: int
    step: int = 1

    @property
    def frames(self) -> tuple[int, ...]:
        """Every frame in order."""
        return tuple(range(self.first, self.last + 1, self.step))

    @classmethod
    def parse(cls, text: str) -> "FrameRange":
        """Return the range of a text in which `frame_range_problem` finds nothing wrong."""
        return cls(*map(int, text.split(":")))


def frame_range_problem(text: str) -> str:
    """Return what is wrong with a text that names frames, or ""."""
    if re.fullmatch(r"-?\d{1,8}:-?\d{1,8}(:\d{1,8})?", text, re.ASCII) is None:
        return f"{text!r} is no range of frames; write FIRST:LAST or FIRST:LAST:STEP, such as 1:250"
    chosen = FrameRange.parse(text)
    if chosen.step < 1:
        return f"{text!r} has the step 0; the least is 1"
    if chosen.last < chosen.first:
        return f"{text!r} ends before it begins"
    if max(-chosen.first, chosen.last) > LAST_POSSIBLE:
        return f"{text!r} has frames beyond {LAST_POSSIBLE}, Blender's last"
    return ""
