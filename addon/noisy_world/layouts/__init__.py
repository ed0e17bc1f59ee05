# SPDX-License-Identifier: GPL-3.0-or-later
"""Dataset layouts: each is an object, which both writes and reads; those of RECORDED are read alone."""

import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from ..core.errors import InputError
from ..core.packages import Door, Registry
from .layout import Beyond, Colour, FrameNames, Image, Layout, Modality, OutputFormat, RecordedLayout, SequenceFacts
from .stored_recording import PosePolicy, StoredSequence, in_metres

__all__ = [
    "EVERY",
    "LAYOUTS",
    "RECORDED",
    "Beyond",
    "Colour",
    "FrameNames",
    "Image",
    "Layout",
    "Modality",
    "OutputFormat",
    "PosePolicy",
    "RecordedLayout",
    "SequenceFacts",
    "find_sequence",
    "known_recordings",
]

_GIVEN = ("name", "label", "meaning")
_WRITTEN = ("images", "colours", "depth_scale_per_m", "patterns")


def _problem(layout: Layout | RecordedLayout) -> str:
    """Return what a layout does not say of itself, in a sentence, or ""."""
    needed = (*_GIVEN, *(_WRITTEN if isinstance(layout, Layout) else ("files",)))
    if lacking := [name for name in needed if not getattr(layout, name, None)]:
        return f"its layout {type(layout).__name__} lacks {', '.join(lacking)}"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", layout.name):
        return f"{layout.name!r} is no name of a layout: small letters, digits and underscores, a letter first"
    return ""


DOOR = Door[Layout | RecordedLayout]("noisy_world.layouts", "layout", "LAYOUT", (Layout, RecordedLayout), _problem)


EVERY = Registry[Layout | RecordedLayout](DOOR, __name__)
"""Every layout by its name, ours and those of installed packages."""

LAYOUTS = EVERY.only(Layout)
"""Every layout that is written and read, by its name in presets; the first is the default."""

RECORDED = EVERY.only(RecordedLayout)
"""Every layout of recordings that is read and not written, by its name."""


def file_of(channel: Modality, names: Iterable[str]) -> str | None:
    """Return which of a frame's files is of a channel that layouts know nothing of, in any layout; None for none."""
    patterns = [pattern for layout in LAYOUTS.values() for pattern in layout.channel_patterns(channel)]
    return next((name for name in names if any(map(PurePosixPath(name).match, patterns))), None)


def known_recordings() -> str:
    """Return the layouts that are read, in words: "Replica or TUM or ..."."""
    return " or ".join(layout.label for layout in (*LAYOUTS.values(), *RECORDED.values()))


def recognising(folder: Path) -> list[Layout | RecordedLayout]:
    """Return the layouts that recognise a folder: those that are ours to write or, if none does, those of others."""
    from .with_reader import LayoutWithReader  # only recordings are read by it

    of_others = (RecordedLayout, LayoutWithReader)
    found = [layout for layout in EVERY.values() if layout.recognises(folder)]
    return [layout for layout in found if not isinstance(layout, of_others)] or found


def find_sequence(folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
    """Find the files of a sequence by the layout that recognises its folder, first of those that are written here.

    rate_hz: of the frames, where the sequence has no stamps of its own; None for its layout's. poses: what becomes of
    frames without a pose. Raises InputError where no layout or several recognise it, and where files are missing or do
    not match.
    """
    found = recognising(folder)
    if len(found) == 1:
        from .asl import with_imu

        layout = found[0]
        read = layout.read(folder, rate_hz, poses)
        return with_imu(in_metres(read, getattr(layout, "depth_scale_per_m", None)))
    if not found:
        told = "or a preset says where its files are: sequence: {folder, rgb, depth, poses, intrinsics}"
        remedy = f"it has to have the files of a layout: {known_recordings()}; {told}"
        raise InputError(folder, "is no sequence", remedy=remedy)
    several = " and of ".join(layout.label for layout in found)
    raise InputError(folder, f"has the files of {several}", remedy="leave those of one layout in it")
