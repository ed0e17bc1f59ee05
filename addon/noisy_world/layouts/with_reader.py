# SPDX-License-Identifier: GPL-3.0-or-later
"""Layouts of recordings that are written too, beside a reader of these.

The reader knows what others put there. Beside that lies what such a layout has no place for, in files of ours:
`frames.jsonl` has the stamps, `cam_params.json` the depth scale, the lens and the depth's camera.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame_table import FRAMES
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics
from ..core.trajectory import FrameStamps
from .cam_params import CAM_PARAMS, cam_params_text, read_cam_params
from .layout import Layout, RecordedLayout, counted_note
from .numbered import NumberedLayout
from .stored_recording import PosePolicy, StoredSequence, read_frame_times

_DIGITS = range(1, 8)


class LayoutWithReader(Layout):
    """A layout with a reader of recordings, which gives it its name, order, label, meaning and files, if it says none.

    written_poses are by a `NumberedLayout`'s own account; with another reader a subclass says poses_file.
    """

    reader: ClassVar[RecordedLayout]
    files: ClassVar[str]
    setting_files = (CAM_PARAMS,)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name in ("name", "order", "label", "meaning", "files") if "reader" in cls.__dict__ else ():
            if name not in cls.__dict__ and hasattr(cls.reader, name):
                setattr(cls, name, getattr(cls.reader, name))

    @property
    def all_patterns(self) -> tuple[str, ...]:
        """Glob patterns of all files that a sequence's folder may hold, its own cam_params.json too."""
        return (*super().all_patterns, CAM_PARAMS)

    def recognises(self, folder: Path) -> bool:
        """Tell whether a folder looks like a recording of this layout."""
        return self.reader.recognises(folder)

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float, optics: Optics = PINHOLE) -> dict[str, str]:
        """Return cam_params.json, which says the depth scale."""
        return {CAM_PARAMS: cam_params_text(camera, depth_scale_per_m, optics)}

    def poses_file(self, folder: Path) -> tuple[Path, NDArray[np.float64]]:
        """Return the file of the poses of all frames, and these (N, 4, 4), c2w, in their order. Raises InputError."""
        assert isinstance(self.reader, NumberedLayout), "another says where its poses are"
        path = self.reader.poses_path(folder, "require")
        assert path is not None, "it is required"
        found = self.reader.poses(path, (), None).c2w
        return path, np.array([found[number] for number in sorted(found)]).reshape(-1, 4, 4)

    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses, one for each frame in their order."""
        path, c2w = self.poses_file(folder)
        if len(c2w) != len(time_s):
            raise InputError(path, f"has {len(c2w)} poses for {len(time_s)} frames")
        return c2w

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Read the recording as others' are, and what our files beside it say."""
        return _with_our_files(self.reader.read(folder, rate_hz, poses), rate_hz)


def unpadded(name: str) -> tuple[str, ...]:
    """Return glob patterns of files named after their frame's number without zeros before it, which replaces {}."""
    return tuple(name.format("[0-9]" * digits) for digits in _DIGITS)


def _with_our_files(found: StoredSequence, rate_hz: float | None) -> StoredSequence:
    """Return a sequence with the stamps of its frames.jsonl, and the cameras and scale of its cam_params.json."""
    told = _frame_times(found)
    if told is not None and found.counted_hz is not None:
        counted = counted_note(rate_hz, found.counted_hz)
        path = found.trajectory.at(slice(None), told.rgb.seconds)
        notes = tuple(note for note in found.notes if note not in counted)
        stamps_path = found.folder / FRAMES
        found = replace(found, stamps=told, trajectory=path, notes=notes, counted_hz=None, stamps_path=stamps_path)
    elif told is not None:  # its own file has colour's and no others
        found = replace(found, stamps=replace(found.stamps, depth=told.depth))
    params = read_cam_params(found.folder)
    if params is None:
        return found
    found = replace(found, depth_scale_per_m=params.depth_scale_per_m)
    if params.camera is None:
        return found
    return replace(found, camera=params.camera, camera_path=params.path, optics=params.optics, assumed="")


def _frame_times(found: StoredSequence) -> FrameStamps | None:
    numbers = [re.search(r"([0-9]{1,18})[^0-9]*$", file.stem) for file in found.rgb_files]
    frames = [int(number[1]) for number in numbers if number is not None]
    return read_frame_times(found.folder, frames) if len(frames) == len(numbers) else None
