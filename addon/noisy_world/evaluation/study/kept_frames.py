# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene's clean frames, kept on the disk as they are rendered, so that each is rendered once for all its settings.

A setting at a time is made, since systems run between them; without this a scene would be loaded and rendered for each.
"""

import contextlib
import io
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.channels import in_order
from ...core.datasets.layouts import Modality
from ...core.datasets.storage import storage_errors, write_atomic
from ...core.geometry import Intrinsics
from ...core.planning.source import OpenSource, PreparedSource, RenderedFrame, RenderOptions, SourceFrame
from ...core.regular_files import read_array
from ...core.trajectories.frame_request import FrameRequest
from ...core.trajectories.sensor_paths import SensorPaths
from .scene_cache import SourceInside


def frames_bytes(camera: Intrinsics, frames: int) -> int:
    """Return how many bytes the clean frames of a render take: three channels of colour and depth, float32."""
    return frames * camera.width_px * camera.height_px * 4 * 4


@dataclass(frozen=True)
class KeptFrames:
    """A folder of clean frames of one render, float32, uncompressed: `rgb/000012.npy` and `depth/000012.npy`.

    Several processes may write there: a file is under its name when it is whole, and whoever makes it makes the same.
    """

    folder: Path

    def read(self, number: int, wanted: tuple[Modality, ...]) -> RenderedFrame | None:
        """Return a frame with the images that are wanted; None where one of them is not there."""
        try:
            images = {name: read_array(self._path(name, number)) for name in wanted}
        except FileNotFoundError:
            return None
        rgb, depth_m = images.pop("rgb", None), images.pop("depth", None)
        return RenderedFrame(rgb, depth_m, images)

    def keep(self, number: int, frame: SourceFrame, wanted: tuple[Modality, ...]) -> None:
        """Write the images of a frame that are wanted. Raises StorageError."""
        scratch = own_scratch(self.folder)
        for name in wanted:
            if (pixels := frame.image(name)) is not None:
                path = self._path(name, number)
                path.parent.mkdir(exist_ok=True)
                write_atomic(path, _npy(pixels), scratch)

    def _path(self, modality: str, number: int) -> Path:
        return self.folder / modality / f"{number:06d}.npy"


def own_scratch(folder: Path) -> Path:
    """Return a folder for this process's unfinished files: others, on other machines too, write beside it."""
    own = folder / "unfinished" / f"{platform.node()}-{os.getpid()}"
    with storage_errors(own):
        own.mkdir(parents=True, exist_ok=True)
    return own


def _npy(values: NDArray[Any]) -> bytes:
    data = io.BytesIO()
    np.save(data, np.ascontiguousarray(values), allow_pickle=False)
    return data.getvalue()


@dataclass(frozen=True)
class KeptSource(SourceInside):
    """A source whose rendered frames are kept: what was rendered once is read. It is used for one render only."""

    kept: KeptFrames

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["_Prepared"]:
        """Prepare to give frames; the source is prepared where one has to be rendered."""
        with contextlib.ExitStack() as closing:
            yield _Prepared(self, lambda: closing.enter_context(self.source.prepare(camera, note)))


class _Prepared:
    """A source with kept frames, ready."""

    def __init__(self, source: KeptSource, prepare: Callable[[], PreparedSource]) -> None:
        self._kept = source.kept
        self._prepare = prepare
        self._prepared: PreparedSource | None = None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "_Open":
        """Return what gives frames along the paths."""

        def opened() -> OpenSource:
            if self._prepared is None:
                self._prepared = self._prepare()
            return self._prepared.open(paths, options, note)

        return _Open(self._kept, in_order(options.channels), opened)


class _Open:
    """Frames along the paths of a render: read, or else rendered and kept."""

    def __init__(self, kept: KeptFrames, wanted: tuple[Modality, ...], opened: Callable[[], OpenSource]) -> None:
        self._kept = kept
        self._wanted = wanted
        self._open = opened
        self._opened: OpenSource | None = None

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request."""
        index = request.index
        if index is not None and (found := self._kept.read(index, self._wanted)) is not None:
            return found
        if self._opened is None:
            self._opened = self._open()
        frame = self._opened.frame(request)
        if index is not None:  # what is between frames is asked for once
            self._kept.keep(index, frame, self._wanted)
        return frame
