# SPDX-License-Identifier: GPL-3.0-or-later
"""Dataset layouts: each is an object in its own file, which both writes and reads."""

from pathlib import Path

from ...errors import InputError
from ..stored import StoredSequence
from .euroc import EurocLayout
from .layout import Beyond, Colour, FrameNames, Image, Layout, Modality, OutputFormat, SequenceFacts
from .replica import ReplicaLayout
from .tum import TumLayout
from .vslamlab import VslamLabLayout

__all__ = [
    "LAYOUTS",
    "Beyond",
    "Colour",
    "FrameNames",
    "Image",
    "Layout",
    "Modality",
    "OutputFormat",
    "SequenceFacts",
    "find_sequence",
]

LAYOUTS: dict[str, Layout] = {
    layout.name: layout for layout in (ReplicaLayout(), TumLayout(), EurocLayout(), VslamLabLayout())
}
"""Every layout by its name in presets; the first is the default."""


def find_sequence(folder: Path, rate_hz: float | None = None) -> StoredSequence:
    """Find the files of a sequence by the layout that recognises its folder.

    rate_hz: of the frames, where the sequence has no stamps of its own; None for 20.
    Raises InputError where no layout or several recognise it, and where files are missing or do not match.
    """
    found = [layout for layout in LAYOUTS.values() if layout.recognises(folder)]
    if len(found) == 1:
        return found[0].read(folder, rate_hz)
    known = " or ".join(layout.label for layout in LAYOUTS.values())
    if not found:
        raise InputError(folder, "is no sequence", remedy=f"it has to have the files of a layout: {known}")
    several = " and of ".join(layout.label for layout in found)
    raise InputError(folder, f"has the files of {several}", remedy="leave those of one layout in it")
