# SPDX-License-Identifier: GPL-3.0-or-later
"""The input of a system: the index {frames} and the folder {sequence}, neither of which holds the truth.

Images are copies, so that a system which changes them spoils nothing but its own run; where it cannot, as it is
isolated, they are links.
"""

import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from ..core.atomic_files import link_or_copy, storage_errors, write_atomic
from ..core.errors import InputError
from ..core.file_access import read_bytes, read_text
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, key, parse
from ..core.trajectory import Trajectory
from ..images.image_files import damage, read_pixels
from ..images.pixels import as_bytes, encode_colour
from ..layouts import LAYOUTS, Layout, OutputFormat, SequenceFacts, find_sequence
from ..layouts.stored_recording import StoredSequence
from .systems import Modality

# The JSON index of the frames that a system is given, as it is written and as rgbd_odometry reads it.


@dataclass(frozen=True)
class InverseDepth:
    """The inverse of a sequence's planar depth Z."""

    median_per_m: float = key("the median of 1 / Z", unit="1/m", above=0.0)
    noise_per_m: float = key("the standard deviation of the noise of 1 / Z", unit="1/m", minimum=0.0)


@dataclass(frozen=True)
class CameraEntry:
    """The camera of all frames."""

    width: int = key("image width", unit="px", minimum=1, maximum=65500)
    height: int = key("image height", unit="px", minimum=1, maximum=65500)
    fx: float = key("focal length", unit="px", above=0.0)
    fy: float = key("focal length", unit="px", above=0.0)
    cx: float = key("principal point", unit="px")
    cy: float = key("principal point", unit="px")

    @classmethod
    def of(cls, camera: Intrinsics) -> "CameraEntry":
        """Return the entry of a camera."""
        return cls(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)


@dataclass(frozen=True)
class FrameEntry:
    """A frame of the sequence: when it was taken, and the files of its images."""

    index: int = key("the frame's number", minimum=0)
    stamp_s: float = key("when its colour was taken", unit="s")
    colour: str | None = key("its colour image")
    depth: str | None = key("its depth image", default=None)
    depth_stamp_s: float | None = key("when its depth was taken", unit="s", default=None)


@dataclass(frozen=True)
class FrameIndex:
    """What the JSON index says: the camera, the steps of a depth image a metre, and the frames in order of time."""

    camera: CameraEntry = key("the camera")
    depth_scale_per_m: float = key("steps of the depth images a metre", unit="steps/m", above=0.0)
    frames: tuple[FrameEntry, ...] = key("the frames, in order of time")
    inverse_depth: InverseDepth | None = key("what the depth is like, which this system does not go by", default=None)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera as the rest of the code knows it."""
        camera = self.camera
        return Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)


def read_index(path: Path) -> FrameIndex:
    """Read the JSON index. Raises InputError, with file and key, for what it cannot be; at least a frame is needed."""
    try:
        value = json.loads(read_text(path))
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(path, f"is no JSON: {error}") from error
    index = parse(FrameIndex, value, ConfigPath(path))
    at = ConfigPath(path).at("frames")
    if not index.frames:
        raise at.error("names no frame")
    last_s = -math.inf
    for row, frame in enumerate(index.frames):
        if not frame.stamp_s > last_s:
            raise at.at(row).at("stamp_s").error(f"is {frame.stamp_s}, no later than the frame before")
        last_s = frame.stamp_s
    return index


# How noisy the depth of a sequence is, measured in its images: what a system that weighs depth has to know of it.


FRAMES = 8  # chosen: of a sequence, in which noise is measured
OF_MEDIAN = 0.6745  # the median of the absolute values of a standard normal variable
OF_SECOND_DIFFERENCE = math.sqrt(6.0)  # 1 + 4 + 1
OF_ROUNDING = 1.0 / math.sqrt(12.0)  # of a step


def measured_inverse_depth(files: Sequence[Path], scale_per_m: float) -> InverseDepth | None:
    """Measure it in some depth images of a sequence, in steps of 1 / scale_per_m metres; None where none has depth.

    Along a row 1 / Z is linear on a plane, so second differences are noise alone, of six times its variance; by their
    median absolute value, edges do not count. It is at least the noise of rounding to steps. What neighbouring pixels
    share, as a bias or a smooth error, is not seen. A file that is no depth image is left to the system to complain of.
    """
    import cv2

    seen, apart = [np.zeros(0)], [np.zeros(0)]
    for place in sorted({round(k * (len(files) - 1) / (FRAMES - 1)) for k in range(FRAMES)}) if files else ():
        steps = read_pixels(files[place], cv2.IMREAD_UNCHANGED)
        if steps is None or steps.ndim != 2:
            continue
        with np.errstate(divide="ignore"):
            per_m = np.where(steps > 0, scale_per_m / steps.astype(np.float64), np.nan)
        second = per_m[:, :-2] - 2.0 * per_m[:, 1:-1] + per_m[:, 2:]
        seen.append(per_m[np.isfinite(per_m)])
        apart.append(np.abs(second[np.isfinite(second)]))
    inverse, differences = np.concatenate(seen), np.concatenate(apart)
    if not differences.size:
        return None
    median_per_m = float(np.median(inverse))
    noise_per_m = float(np.median(differences)) / OF_MEDIAN / OF_SECOND_DIFFERENCE
    return InverseDepth(median_per_m, max(noise_per_m, OF_ROUNDING * median_per_m**2 / scale_per_m))


Shown: TypeAlias = Literal["jpg", "png"]
"""What systems read colour as."""

_KINDS: tuple[tuple[bytes, Shown], ...] = ((b"\x89PNG", "png"), (b"\xff\xd8", "jpg"))


@dataclass(frozen=True, eq=False)
class SequenceInput:
    """A sequence as a system is given it. modalities: those that the system reads. links: whether images are links."""

    stored: StoredSequence
    camera: Intrinsics
    modalities: tuple[Modality, ...]
    links: bool = False

    def __len__(self) -> int:
        return len(self.stored.rgb_files)

    @property
    def stamps_s(self) -> list[float]:
        """When the colour of each frame was taken, seconds."""
        return self.stored.stamps.rgb.seconds.tolist()

    def document(self, images: Path | None = None) -> dict[str, Any]:
        """Return the index as plain JSON values: camera, steps of depth a metre, and the frames in order of time.

        Files are absolute: those in the folder of images, which `write_index` writes; without one, the sequence's own.
        A modality that the system does not read is null, and so is what its depth is like.
        """
        camera, stored = self.camera, self.stored
        if "depth" in self.modalities and not stored.depth_files:
            raise InputError(stored.folder, "has no depth, which the system reads")
        colour = [self._named(images, file, "colour") for file in stored.rgb_files]
        depth = [self._named(images, file, "depth") for file in stored.depth_files] or [None] * len(colour)
        inverse = None
        if "depth" in self.modalities:
            inverse = measured_inverse_depth(stored.depth_files, stored.depth_scale_per_m)
        rows = zip(self.stamps_s, colour, depth, stored.stamps.depth.seconds.tolist(), strict=True)
        frames = (FrameEntry(index, *row) for index, row in enumerate(rows))
        scale_per_m = float(stored.depth_scale_per_m)
        return asdict(FrameIndex(CameraEntry.of(camera), scale_per_m, tuple(frames), inverse))

    def write_index(self, path: Path, images: Path | None) -> None:
        """Write the index, and the images that it names into a folder. Raises InputError and StorageError.

        images: None for a system of ours, which spoils nothing: it is told of the sequence's own.
        """
        with storage_errors(path):
            path.write_text(json.dumps(self.document(images), indent=1) + "\n", encoding="utf-8")
        if images is None:
            return
        of_modality = {"colour": self.stored.rgb_files, "depth": self.stored.depth_files}
        for file in dict.fromkeys(file for name in self.modalities for file in of_modality[name]):
            self._give(file, images / self._inside(file))

    def _named(self, images: Path | None, file: Path, modality: Modality) -> str | None:
        if modality not in self.modalities:
            return None
        return str((file if images is None else images / self._inside(file)).resolve())

    def _inside(self, file: Path) -> Path:
        """Return where an image lies in the folder of images: as in the sequence."""
        if file.is_relative_to(self.stored.folder) and ".." not in file.parts:
            return file.relative_to(self.stored.folder)
        # The sequence's lists name it elsewhere.
        return Path("elsewhere", hashlib.sha256(os.fsencode(file.parent)).hexdigest()[:16], file.name)

    def _give(self, source: Path, target: Path) -> None:
        """Give an image, which is there, by another name. Raises InputError and StorageError."""
        with storage_errors(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        if self.links:
            link_or_copy(source.resolve(), target, target.parent)
            return
        try:
            data = read_bytes(source)
        except OSError as error:
            raise InputError(source, f"cannot be read: {error.strerror or error}") from error
        with storage_errors(target):
            target.write_bytes(data)

    def write_sequence(self, folder: Path, layouts: tuple[str, ...]) -> None:
        """Write the sequence in one of some layouts, its own if it is among them, with identities for poses.

        Images stay as they are where the layout takes their kind, and are stored as PNG without loss where it does not;
        files of the setting lie one level up. Raises InputError where the images cannot be read, and StorageError.
        """
        own = [name for name in layouts if LAYOUTS[name].recognises(self.stored.folder)]
        layout = LAYOUTS[(own or list(layouts))[0]]
        image = self._image(layout)
        modalities = ("rgb", "depth") if self.stored.depth_files else ("rgb",)
        stored_as = OutputFormat(layout, image, layout.colours[0], modalities, self.stored.depth_scale_per_m)
        still = Trajectory(np.broadcast_to(np.eye(4), (len(self), 4, 4)), np.array(self.stamps_s))
        frames = tuple(range(len(self)))
        facts = SequenceFacts(stored_as, self.camera, None, frames, SensorPaths(still), self.stored.stamps)
        for frame, rgb in enumerate(self.stored.rgb_files):
            self._link(rgb, folder / facts.names.rgb(frame), image)
        for frame, depth in enumerate(self.stored.depth_files):
            self._link(depth, folder / facts.names.depth(frame), "png")
        for name, text in layout.sequence_texts(facts).items():
            _write(folder / name, text.encode())
        for name, text in stored_as.setting_texts(self.camera).items():
            _write(folder.parent / name, text.encode())

    def _image(self, layout: Layout) -> Shown:
        """Return the kind of image that colour is stored as: its own if the layout takes it, else PNG."""
        kind = _kind(read_bytes(self.stored.rgb_files[0]))
        if kind in layout.images:
            return kind
        return "png" if "png" in layout.images else "jpg"

    def _link(self, source: Path, target: Path, image: Shown) -> None:
        with storage_errors(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        data = read_bytes(source)
        if problem := damage(data):
            raise InputError(source, f"is damaged: {problem}", remedy="copy it again")
        if _kind(data) == image:
            self._give(source, target)
            return
        rgb = self.stored.frame(self.stored.rgb_files.index(source)).rgb
        write_atomic(target, encode_colour(as_bytes(rgb), image, fit_tables=False), target.parent)


def sequence_input(
    folder: Path,
    modalities: tuple[Modality, ...] = ("colour", "depth"),
    camera: Intrinsics | None = None,
    *,
    links: bool = False,
) -> SequenceInput:
    """Find a sequence on disk, of any layout, for a system that reads these modalities.

    camera: its intrinsics, where no file says them. links: whether images are given as links. Raises InputError where
    it is no sequence, or has no intrinsics.
    """
    stored = find_sequence(folder)
    replaced = camera is not None and bool(stored.assumed)
    _check_plain(stored, lens=not replaced)
    known = camera if replaced else stored.known_camera or camera
    if known is None:
        raise InputError(folder, "says no intrinsics", remedy="put a cam_params.json with camera and scale beside it")
    return SequenceInput(stored, known, modalities, links)


def _check_plain(stored: StoredSequence, *, lens: bool) -> None:
    """Refuse a recording that systems do not read as it is: all that is in the way, in one line. lens: ask for that."""
    problems = {
        "depth has a camera of its own": ("register: true", stored.optics.depth is not None),
        "its lens distorts": ("undistort: true", lens and stored.optics.distortion is not None),
        "its colour is EXR, scene-linear light, which systems do not read": ("", stored.rgb_files[0].suffix == ".exr"),
        "its depth images mark void otherwise than by 0": ("", bool(stored.void_steps)),
        "its depth images are no PNG": ("", not stored.depth_is_png),
    }
    wrong = {problem: key for problem, (key, is_so) in problems.items() if is_so}
    if wrong:
        keys = " and ".join(key for key in wrong.values() if key)
        remedy = "make a dataset of it first" + (f", with {keys} for the scene" if keys else "")
        raise InputError(stored.folder, ", and ".join(wrong), remedy=remedy)


def _kind(data: bytes) -> Shown | None:
    return next((kind for start, kind in _KINDS if data.startswith(start)), None)


def _write(path: Path, data: bytes) -> None:
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
