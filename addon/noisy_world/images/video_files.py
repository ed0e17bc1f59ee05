# SPDX-License-Identifier: GPL-3.0-or-later
"""Video files: their frames one after another, by OpenCV."""

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, StorageError
from ..core.file_access import check_regular, utf8_name

SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")
_UNCERTAIN = 0.01  # chosen: a count that follows from length and rate is off by as much where the rate varies
WRITTEN = {".mp4": "mp4v", ".avi": "MJPG", ".mkv": "MJPG"}  # codecs that OpenCV's wheels write, by suffix


@dataclass(frozen=True, eq=False)
class VideoFile:
    """What a video holds. stamps_s: (N,) when each frame is shown, seconds, increasing; N is counted, not stated.

    stated_count: the frames that its header says or that follow from its length and its rate; 0 where neither is known.
    rate_hz: the rate that its header says; 0 where it says none.
    """

    path: Path
    size_px: tuple[int, int]
    stamps_s: NDArray[np.float64]
    stated_count: int = 0
    rate_hz: float = 0.0

    def __len__(self) -> int:
        return len(self.stamps_s)

    @property
    def note(self) -> str:
        """A sentence on frames that are missing; "" where none seem to be."""
        missing = self.stated_count - len(self)
        if missing <= max(1, _UNCERTAIN * self.stated_count) or self._reaches_its_end:
            return ""
        message = f"{self.path.name} says that it has {self.stated_count} frames, of which {len(self)} can be decoded"
        return f"{message}: it may be cut"

    @property
    def _reaches_its_end(self) -> bool:
        """Whether its frames are as long as it says: a rate that varies gives another count than it has frames."""
        if self.rate_hz <= 0 or len(self) < 2:
            return False
        gap_s = float(np.median(np.diff(self.stamps_s)))
        return float(self.stamps_s[-1]) + 2 * gap_s >= (1 - _UNCERTAIN) * self.stated_count / self.rate_hz


def read_video(path: Path) -> VideoFile:
    """Read the size of a video and the times of its frames; all of it is decoded, as headers tell neither surely.

    Raises InputError where it is no video, or holds no frame.
    """
    import cv2

    capture = _opened(path)
    try:
        stamps_ms = []
        there, first = capture.read()
        if not there or first is None:
            raise InputError(path, "holds no frame that OpenCV can decode")
        rate_hz, stated = (float(capture.get(name)) for name in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_COUNT))
        while there:
            stamps_ms.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)))
            there = capture.grab()
    finally:
        capture.release()
    stamps_s = np.array(stamps_ms) / 1000
    if not (np.isfinite(stamps_s).all() and np.all(np.diff(stamps_s) > 0)):
        if not 0 < rate_hz < 1e4:
            raise InputError(path, "tells neither when its frames are shown nor how many a second")
        stamps_s = np.arange(len(stamps_ms)) / rate_hz
    stated, rate_hz = (value if math.isfinite(value) and value > 0 else 0.0 for value in (stated, rate_hz))
    return VideoFile(path, (first.shape[1], first.shape[0]), stamps_s, int(stated), rate_hz)


class VideoReader:
    """Reads frames of a video; in order it decodes each once, and going back begins anew."""

    def __init__(self, video: VideoFile) -> None:
        """Open it when the first frame is asked for."""
        self._video = video
        self._capture: Any = None
        self._next = 0

    def rgb(self, index: int) -> NDArray[np.uint8]:
        """Return the colour of a frame, (H, W, 3), RGB. Raises InputError where it cannot be decoded."""
        if self._capture is None or index < self._next:
            self.close()
            self._capture = _opened(self._video.path)
        there = True
        while there and self._next < index:
            there = self._capture.grab()
            self._next += 1
        there, frame = self._capture.read() if there else (False, None)
        self._next += 1
        if not there or frame is None or (frame.shape[1], frame.shape[0]) != self._video.size_px:
            raise InputError(self._video.path, f"frame {index} cannot be decoded, or has another size than the first")
        return np.ascontiguousarray(frame[..., ::-1])

    def close(self) -> None:
        """Close the file."""
        if self._capture is not None:
            self._capture.release()
        self._capture, self._next = None, 0


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], rate_hz: float) -> int:
    """Write colour images (H, W, 3), RGB, all of one size, as a video to look at; return how many.

    Raises StorageError where OpenCV cannot write it.
    """
    import cv2

    _quieten_ffmpeg()
    writer, count = None, 0
    try:
        for rgb in frames:
            if writer is None:
                code = cv2.VideoWriter.fourcc(*WRITTEN[path.suffix.lower()])
                writer = cv2.VideoWriter(utf8_name(path), code, rate_hz, (rgb.shape[1], rgb.shape[0]))
                if not writer.isOpened():
                    raise StorageError("OpenCV cannot write a video there", file=path)
            writer.write(np.ascontiguousarray(rgb[..., ::-1]))
            count += 1
    finally:
        if writer is not None:
            writer.release()
    return count


def _quieten_ffmpeg() -> None:
    """Have FFmpeg, which OpenCV asks when it is first used, say nothing beside the line that an error becomes."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "8")  # AV_LOG_FATAL


def _opened(path: Path) -> Any:
    import cv2

    try:
        check_regular(path)  # OpenCV opens it by its name
    except OSError as error:
        problem = "no such video" if isinstance(error, FileNotFoundError) else f"cannot be read: {error.strerror}"
        raise InputError(path, problem) from error
    _quieten_ffmpeg()
    capture = cv2.VideoCapture(utf8_name(path))
    if not capture.isOpened():
        raise InputError(
            path, "is no video that OpenCV can read", remedy=f"it reads {', '.join(SUFFIXES)}, for instance"
        )
    return capture
