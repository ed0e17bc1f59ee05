# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of plain images in the order of their names: colour alone; a camera where the preset gives it."""

import hashlib
import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.image_files import WholeFile, check_whole, read_header
from ..core.datasets.image_reading import check_size_px, read_colour
from ..core.datasets.known_poses import unposed
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.layouts.recorded import counted_note
from ..core.datasets.storage import sha256_of_file
from ..core.datasets.stored import RATE_HZ, StoredSequence
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.planning.simple_source import SimpleSource
from ..core.planning.source import ColourAndDepth, RenderOptions, SourceCapabilities
from ..core.schema import ConfigPath
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.stamps import FrameStamps
from ..core.trajectories.trajectory import Trajectory
from .guessed_camera import GUESSED, given_or_guessed

READ = (".png", ".jpg", ".jpeg")
OTHERS = (".exr", ".tif", ".tiff", ".dpx", ".tga", ".webp", ".bmp", ".hdr", ".jp2", ".gif", ".heic")  # told, not read
RECORDED = "plain images have nothing between them"
NO_SCALE = 1.0  # steps a metre of depth that is not there


@dataclass(frozen=True)
class Images(SimpleSource):
    """The images of a folder."""

    stored: StoredSequence
    place: ConfigPath

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.stored.folder)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Colour alone."""
        return SourceCapabilities(rendered=False, any_pose=False, depth=False, instants_only=RECORDED)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the images, counted by the rate."""
        return self.stored.stamps.rgb.seconds

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        self.stored.check_images()
        return given_or_guessed(asked, self.stored.size_px, self.place.at("sequence"), "images")

    def trajectory(self) -> Trajectory:
        """Return a path whose poses are not known."""
        return self.stored.trajectory

    def hashes(self) -> dict[str, Any]:
        """Return the folder's name, the hash of all images in their order, and the rate."""
        digests = "".join(sha256_of_file(file) or "" for file in self.stored.files)
        return {
            "sequence": self.stored.folder.name,
            "sequence_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            "rate_hz": self.stored.counted_hz,
        }

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenImages"]:
        """Prepare to read images."""
        for text in (*self.stored.notes, *self.stored.image_notes):
            note(text)
        if camera == self.camera(None):
            note(GUESSED)
        yield OpenImages(self.stored)


def read_images(folder: Path, place: ConfigPath, rate_hz: float | None = None) -> Images:
    """Find the images of a folder; numbers in their names count as numbers.

    rate_hz: images a second; None for 20. Raises InputError where there are none, or two have one name.
    """
    files = _files(folder)
    used_hz = rate_hz or RATE_HZ
    stamps_s = np.arange(len(files)) / used_hz
    stored = StoredSequence(
        folder=folder,
        rgb_files=files,
        depth_files=(),
        trajectory_path=None,
        trajectory=unposed(len(files)).at(slice(None), stamps_s),
        stamps=FrameStamps.of(stamps_s),
        depth_scale_per_m=NO_SCALE,
        notes=counted_note(rate_hz, used_hz),
        counted_hz=used_hz,
    )
    return Images(stored, place)


def holds_images(folder: Path) -> bool:
    """Tell whether PNG or JPEG images lie in a folder itself."""
    return folder.is_dir() and any(path.suffix.lower() in READ for path in folder.iterdir())


def _files(folder: Path) -> tuple[Path, ...]:
    try:
        there = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    found = sorted((path for path in there if path.suffix.lower() in READ), key=_in_order)
    if not found:
        others = sorted({path.suffix.lower() for path in there} & set(OTHERS))
        problem = f"has images of {', '.join(others)}, but no PNG or JPEG" if others else "has no PNG or JPEG images"
        raise InputError(folder, problem, remedy="convert them" if others else "")
    for one, other in itertools.pairwise(found):
        if _in_order(one) == _in_order(other):
            problem = f"{one.name} and {other.name} stand for one place in the order of names"
            raise InputError(folder, problem, remedy="keep one of them")
    return tuple(found)


def _in_order(path: Path) -> list[tuple[int, int, str]]:
    """Return what a file's name is ordered by, without its suffix: numbers by value, letters whatever their case."""
    parts = re.findall(r"[0-9]+|[^0-9]+", path.stem.casefold())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


@dataclass(frozen=True)
class OpenImages:
    """A folder that is ready to give frames."""

    stored: StoredSequence

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenImages":
        """Return itself: the files decide what its frames show."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> "ImageFrame":
        """Return the frame of a request, which is read on request."""
        return ImageFrame(self.stored.rgb_files[request.frame], self.stored.size_px)


@dataclass(frozen=True)
class ImageFrame(ColourAndDepth):
    """An image on disk. size_px: that it has to have."""

    file: Path
    size_px: tuple[int, int]

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, sRGB-encoded: uint8, or float32 in [0, 1] where the file has 16 bits.

        Raises InputError where the file is damaged, or no image.
        """
        return read_colour(self.file, self.size_px)

    @property
    def depth_m(self) -> None:
        """None: there is no depth."""
        return None

    def file_as(self, modality: Modality, written: OutputFormat) -> WholeFile | None:
        """Return the image's file if a dataset would write the same: equal kind and colours.

        Raises InputError where that file is damaged.
        """
        if modality != "rgb":
            return None
        header = read_header(self.file)
        if (header.kind, header.plainly) != (written.image, written.colour):
            return None
        whole, digest = check_whole(self.file)
        check_size_px(self.file, whole, self.size_px)
        return WholeFile(self.file, digest)
