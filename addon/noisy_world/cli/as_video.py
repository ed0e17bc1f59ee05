# SPDX-License-Identifier: GPL-3.0-or-later
"""`generate --out walk.mp4`: the colour of a dataset as a video to look at, without keeping the dataset."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.image_reading import read_pixels
from ..core.datasets.storage import ELSEWHERE, storage_errors
from ..core.datasets.video_files import WRITTEN, write_video
from ..core.errors import StorageError

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..core.planning.sequence import PlannedSequence


def is_video(out: Path) -> bool:
    """Tell whether a place for a dataset names a video."""
    return out.suffix.lower() in WRITTEN and not out.is_dir()


def videos_of(plan: "Plan", out: Path, *, overwrite: bool) -> dict[str, Path]:
    """Return the video of each sequence by its folder: one of the name given; of several, one with each's name.

    Raises StorageError where one is there already, and where there is no colour.
    """
    if "rgb" not in plan.format.modalities:
        raise StorageError("a video shows colour, and output.modalities leaves it out", file=out)
    if plan.format.of_light:
        raise StorageError("a video shows colour, and output.image exr is light", file=out, remedy="set it to png")
    made = [sequence for sequence in plan.sequences if sequence.frames]
    videos = {item.folder: out if len(made) == 1 else _named(out, item) for item in made}
    there = next((path for path in videos.values() if path.exists()), None)
    if there is not None and not overwrite:
        raise StorageError("is there already", file=there, remedy="--overwrite replaces it")
    return videos


def make_videos(plan: "Plan", videos: dict[str, Path], make: Callable[[Path], object]) -> None:
    """Make the dataset in a folder beside the videos, write these, and remove it. make: makes it in a folder."""
    beside = next(iter(videos.values())).parent
    with storage_errors(beside, ELSEWHERE):
        beside.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=".noisy_world-", dir=beside)
    with folder as name:
        out = Path(name) / "dataset"
        make(out)
        for render in plan.renders:
            stamps = render.scene.source.frame_stamps
            gaps_s = np.diff(stamps.rgb.seconds)
            rate_hz = 1 / float(np.median(gaps_s)) if gaps_s.size else 30.0
            for sequence in (item for item in render.sequences if item.folder in videos):
                names = [out / sequence.folder / plan.format.names(stamps).rgb(frame) for frame in sequence.frames]
                video = videos[sequence.folder]
                made = Path(name) / video.name  # moved when it is whole
                write_video(made, _colours(names), rate_hz)
                with storage_errors(video, ELSEWHERE):
                    made.replace(video)


def _colours(files: list[Path]) -> Iterator[NDArray[np.uint8]]:
    import cv2

    for file in files:
        yield np.asarray(read_pixels(file, cv2.IMREAD_COLOR_RGB), np.uint8)


def _named(out: Path, sequence: "PlannedSequence") -> Path:
    return out.with_name(f"{out.stem}-{sequence.folder.replace('/', '-')}{out.suffix}")
