# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean frames kept on disk, unrounded, for all sequences that show them: written, checked and read.

A store of clean frames, with the paths that they lie on.

It holds, for each scene, `SCENE/path.npy`, and the clean files of each render in the folder of its name. `clean.json`
is written first: what they were made from.
"""

import hashlib
import json
import shutil
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, in_order
from ..channels.channel import Fact
from ..core.atomic_files import FolderLock, own_scratch, sha256_of_bytes, sha256_of_file, storage_errors, write_atomic
from ..core.errors import InputError, InterruptedRunError, StorageError
from ..core.file_access import canonical, read_array, read_bytes, read_json
from ..core.frame_request import FrameRequest
from ..core.geometry import Intrinsics
from ..core.progress import Progress
from ..core.trajectory import Axes, Trajectory
from ..images.pixels import encode_npy
from ..layouts import Modality, OutputFormat
from ..render.source import (
    ColourAndDepth,
    Motion,
    OpenSource,
    PreparedSource,
    RenderOptions,
    SimpleSource,
    SourceCapabilities,
    SourceFrame,
    motion_between,
)
from .estimate import size_text
from .folder_state import WORK_FOLDER, clean_identity, first_difference
from .identity import FORMAT as IDENTITY_FORMAT
from .identity import identity_problem, plain_identity, same_version, versions_of
from .plan import Plan, Render
from .remaking import different_input
from .rendering import open_render, render_options, source_paths

# A cache of a render's clean frames on disk, unrounded, for all sequences that show them.
#
# A folder holds `rgb/000012.npy` and `depth/000012.npy`, float32, one file a source frame and channel. After the array,
# where numpy does not look, a file has the SHA-256 of what stands before. Uncompressed, since reading counts: 2 ms for
# the colour of 1200 x 680 pixels, where OpenEXR's fastest compression takes 18 ms, longer than most perturbations, for
# 0.6 of the bytes.


DIGEST_BYTES = hashlib.sha256().digest_size
AGAIN = "run 'noisy-world render-clean', or the study, again: it makes what is missing or damaged"


@dataclass(frozen=True)
class CleanFiles:
    """A folder of clean frames of one render. scratch: for unfinished files, on the same disk.

    Several processes may write there: a file is under its name when it is whole, and whoever makes it makes the same.
    """

    folder: Path
    scratch: Path
    _whole: set[tuple[Modality, int]] = field(default_factory=set[tuple[Modality, int]], compare=False)

    def path(self, modality: Modality, number: int) -> Path:
        """Return the file of an image."""
        return self.folder / modality / f"{number:06d}.npy"

    def exposure_path(self, number: int) -> Path:
        """Return the file of what the exposure of a frame did; there is none where nothing was exposed."""
        return self.folder / "exposure" / f"{number:06d}.json"

    def kept(self, number: int) -> "KeptFrame":
        """Return a frame that is there, its images read when they are asked for. Raises InputError."""
        path = self.exposure_path(number)
        try:
            return KeptFrame(self, number, read_json(path))
        except FileNotFoundError:
            return KeptFrame(self, number)
        except ValueError as error:
            raise InputError(path, "is damaged", remedy=AGAIN) from error

    def lacking(self, frames: Iterable[int], wanted: Sequence[Modality]) -> list[int]:
        """Return the frames of which an image is not there as it was written. Each file is read once."""
        return [number for number in frames if not all(self._is_whole(name, number) for name in wanted)]

    def keep(self, number: int, frame: SourceFrame, wanted: Iterable[Modality]) -> None:
        """Write the images of a frame, and before them what its exposure did. Raises StorageError."""
        if notes := frame.exposure:
            path = self.exposure_path(number)
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, json.dumps(notes).encode(), own_scratch(self.scratch))
        for name in wanted:
            if (pixels := frame.image(name)) is not None:
                path = self.path(name, number)
                with storage_errors(path):
                    path.parent.mkdir(parents=True, exist_ok=True)
                data = encode_npy(pixels)
                write_atomic(path, data + hashlib.sha256(data).digest(), own_scratch(self.scratch))
                self._whole.add((name, number))

    def through(
        self, wanted: Sequence[Modality], opening: Callable[[], OpenSource], *, again: bool = False
    ) -> OpenSource:
        """Return what gives the render's frames: those that are here are read, the others are rendered and kept.

        opening: opens the render, when that is needed. again: those that are here are rendered again, as their light
        before a view transform is needed, which no file has.
        """
        return _Through(self, wanted, opening, again)

    def _is_whole(self, modality: Modality, number: int) -> bool:
        if (modality, number) not in self._whole:
            try:
                data = memoryview(read_bytes(self.path(modality, number)))
            except FileNotFoundError:
                return False
            if hashlib.sha256(data[:-DIGEST_BYTES]).digest() != data[-DIGEST_BYTES:]:
                return False
            self._whole.add((modality, number))
        return True


class _Through:
    """Frames of a render: read, or else rendered and kept."""

    def __init__(
        self, files: CleanFiles, wanted: Sequence[Modality], opening: Callable[[], OpenSource], again: bool
    ) -> None:
        self._files = files
        self._wanted = wanted
        self._opening = opening
        self._again = again
        self._opened: OpenSource | None = None

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request."""
        number = request.index
        here = number is not None and not self._files.lacking([number], self._wanted)
        if number is not None and here and not self._again:
            return self._files.kept(number)
        frame = self._source().frame(request)
        if number is not None and not here:  # what is between frames is asked for once
            self._files.keep(number, frame, self._wanted)
        return frame

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return what the source says: that is asked for once."""
        return motion_between(self._source(), here, there)

    def _source(self) -> OpenSource:
        if self._opened is None:
            self._opened = self._opening()
        return self._opened


@dataclass(frozen=True)
class KeptFrame(ColourAndDepth):
    """A clean frame on the disk, by the number of the source frame. An image that is not whole raises InputError."""

    files: CleanFiles
    number: int
    exposure: Sequence[Mapping[str, Any]] = ()

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Colour (H, W, 3), float32 in [0, 1]."""
        return self.image("rgb")

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres; 0 = void."""
        return self.image("depth")

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of any channel."""
        path, channel = self.files.path(modality, self.number), CHANNELS[modality]
        image = array_in(path)
        if image.dtype != channel.dtype or image.ndim != (2 if channel.components == 1 else 3):
            raise InputError(path, f"is {image.dtype} {image.shape}, no clean image", remedy=AGAIN)
        return image

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: no file here is a dataset's."""
        del modality, written


def array_in(path: Path) -> NDArray[Any]:
    """Return the array in a file of clean frames. Raises InputError."""
    try:
        return read_array(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(path, "is damaged or cannot be read", remedy=AGAIN) from error


def frames_bytes(camera: Intrinsics, frames: int, wanted: Iterable[Modality]) -> int:
    """Return how many bytes clean frames of a camera take."""
    each = sum(CHANNELS[name].components * np.dtype(CHANNELS[name].dtype).itemsize for name in wanted)
    return frames * camera.width_px * camera.height_px * each


CLEAN = "clean.json"
PATH = "path.npy"
KIND = "clean frames of Noisy World"
FORMAT = 2  # version of the store; raised when its files change


@dataclass(frozen=True)
class CleanStore:
    """A store of clean frames. identity: what they were made from, as in a dataset's manifest, and robot_axes."""

    folder: Path
    identity: Mapping[str, Any]

    def has_scene(self, scene: str) -> bool:
        """Tell whether it holds the path of a scene."""
        return scene in self.identity["scenes"] and (self.folder / scene / PATH).is_file()

    def files(self, render: str) -> CleanFiles:
        """Return the clean frames of a render."""
        return CleanFiles(self.folder / render, self.folder / WORK_FOLDER)

    def frame(self, render: str, source: int) -> KeptFrame | None:
        """Return a source frame of a render; None where it holds none of its images."""
        files = self.files(render)
        return files.kept(source) if any(files.path(name, source).is_file() for name in CHANNELS) else None

    def source(self, scene: str) -> "StoredScene":
        """Return what is known of a scene, as a source. Raises InputError where its path is damaged."""
        path = self.folder / scene / PATH
        rows = array_in(path)
        if rows.ndim != 2 or rows.shape[1] != 17 or rows.dtype != np.float64 or not len(rows):
            raise InputError(path, f"is {rows.dtype} {rows.shape}, but a path is float64 (N, 17)", remedy=AGAIN)
        known = self.identity["scenes"][scene]
        axes = known.get("robot_axes")
        return StoredScene(self.folder / scene, Trajectory(rows[:, 1:].reshape(-1, 4, 4), rows[:, 0]), axes, known)

    def check(self, wanted: Mapping[str, Any], scene: str, setting: str) -> None:
        """Raise InputError where its frames of a scene are not those of a recipe; see `difference`."""
        if problem := self.difference(wanted, scene, setting):
            remedy = "take the clean frames that were made from this recipe"
            raise InputError(self.folder, f"holds frames of another recipe: {problem}", remedy=remedy)

    def difference(self, wanted: Mapping[str, Any], scene: str, setting: str) -> str:
        """Return why its frames of a scene are not those of a recipe, or "".

        wanted: the recipe's identity. setting: whose render is asked for.
        """
        moved = setting if (self.folder / f"{scene}@{setting}").is_dir() else ""
        left, right = (clean_identity(identity, scene, moved) for identity in (wanted, self.identity))
        inputs = [made_from["scenes"][scene].pop("inputs") for made_from in (left, right)]
        if found := different_input(*inputs):
            return f"{scene}: {found[0]} {found[1]}"
        other = {"versions": None, "processor": None}  # of which the user is warned
        return first_difference({**left, **other}, {**right, **other}) or ""


def read_store(folder: Path) -> CleanStore:
    """Open a store. Raises InputError where the folder is none."""
    path = folder / CLEAN
    try:
        content = read_json(path)
    except FileNotFoundError as error:
        problem = "is no folder of clean frames" if folder.is_dir() else "no such folder"
        raise InputError(folder, problem, remedy="'noisy-world render-clean RECIPE --out DIR' makes one") from error
    except ValueError as error:
        raise InputError(path, str(error), remedy=AGAIN) from error
    identity: Any = content.get("identity") if isinstance(content, dict) else None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(path, "does not tell of clean frames", remedy=AGAIN)
    if content.get("format") != FORMAT or not isinstance(identity, dict) or identity.get("format") != IDENTITY_FORMAT:
        raise InputError(path, "was written by another version of Noisy World", remedy="make the frames again")
    if problem := identity_problem(identity):
        raise InputError(path, problem, remedy=AGAIN)
    return CleanStore(folder, identity)


ANY: frozenset[Fact] = frozenset(get_args(Fact))  # what the frames have of it has been made


@dataclass(frozen=True)
class StoredScene(SimpleSource):
    """A scene of a store as a source: its path is known, and its frames are those that the store holds."""

    folder: Path
    path: Trajectory
    axes: Axes | None
    known: Mapping[str, Any]

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.folder)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Frames that nobody renders, from paths that may deviate."""
        return SourceCapabilities(rendered=False, any_pose=True, surface=ANY, moving="blend" in self.known["inputs"])

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses."""
        return self.axes

    def trajectory(self) -> Trajectory:
        """Return the path."""
        return self.path

    def hashes(self) -> dict[str, Any]:
        """Return the inputs that the frames were made from."""
        return dict(self.known["inputs"])

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Raise InputError: there are no frames but those that the store holds."""
        del camera, note
        raise InputError(self.folder, "does not hold this frame", remedy=AGAIN)


# Making a store of clean frames: each render's frames once, and taken up again where it was stopped.


ANOTHER = "choose another folder with --out"


def make_store(plan: Plan, out: Path, progress: Progress, stop: threading.Event) -> int:
    """Render the frames of a plan into a store; what is there already stays. Return how many were rendered.

    Scenes that are recordings are left out: they are their own clean frames.

    stop: when set, InterruptedRunError is raised after the current frame. Raises StorageError where the folder holds
    something else, or there is no space.
    """
    return _Making(plan, out, progress, stop).make()


class _Making:
    """One execution of a plan into a store."""

    def __init__(self, plan: Plan, out: Path, progress: Progress, stop: threading.Event) -> None:
        self._plan = rendered(plan)
        self._out = out
        self._progress = progress
        self._stop = stop

    def make(self) -> int:
        """Make what is missing."""
        if self._out.exists() and not (self._out / CLEAN).is_file() and _holds_something(self._out):
            raise StorageError("is not empty and holds no clean frames", file=self._out, remedy=ANOTHER)
        lock = FolderLock(self._out / WORK_FOLDER / "lock")
        try:
            store = self._describe()
            missing = {
                render.name: store.files(render.name).lacking(render.frames, self._modalities(render))
                for render in self._plan.renders
            }
            self._check_space(missing)
            there = self._plan.frame_count - sum(map(len, missing.values()))
            self._progress.start("rendering", self._plan.frame_count, there)
            for scene in self._plan.scenes:
                renders = [item for item in self._plan.renders if item.scene.name == scene.name and missing[item.name]]
                if renders:
                    with scene.source.prepare(renders[0].camera, partial(self._note, scene.name)) as prepared:
                        for render in renders:
                            self._render(render, prepared, missing[render.name], store)
        finally:
            self._progress.finish()
            shutil.rmtree(own_scratch(self._out / WORK_FOLDER).parent, ignore_errors=True)
            lock.release()
        return sum(map(len, missing.values()))

    def _note(self, name: str, text: str) -> None:
        self._progress.note(f"{name}: {text}")

    # --- what it is made from ---

    def _describe(self) -> CleanStore:
        """Write what the frames are made from, and the paths that they lie on, beside what is there of others."""
        here = plain_identity(self._plan, versions_of(self._plan))
        for scene in self._plan.scenes:
            here["scenes"][scene.name]["robot_axes"] = scene.source.robot_axes
        if (self._out / CLEAN).is_file():
            there = read_store(self._out)
            self._check_same(there, here)
            for part in ("scenes", "settings", "sequences"):
                here[part] = {**there.identity[part], **here[part]}
        for scene in self._plan.scenes:
            path = scene.path
            rows = np.concatenate([path.stamps_s[:, None], path.c2w.reshape(-1, 16)], axis=1)
            self._write(self._out / scene.name / PATH, encode_npy(rows))
        self._write(self._out / CLEAN, canonical({"kind": KIND, "format": FORMAT, "identity": here}).encode())
        return CleanStore(self._out, here)

    def _check_same(self, there: CleanStore, here: dict[str, Any]) -> None:
        made, versions = there.identity["versions"], here["versions"]
        if not all(same_version(name, made.get(name), versions.get(name)) for name in {*made, *versions}):
            raise StorageError("was made with other versions", file=self._out, remedy=ANOTHER)
        if there.identity["processor"] != here["processor"]:
            raise StorageError("was made on another processor", file=self._out, remedy=ANOTHER)
        for folder in here["sequences"]:
            setting, scene = folder.split("/")
            known = scene in there.identity["scenes"] and setting in there.identity["settings"]
            if known and (problem := there.difference(here, scene, setting)):
                raise StorageError(f"holds frames of something else: {problem}", file=self._out, remedy=ANOTHER)

    def _check_space(self, missing: Mapping[str, list[int]]) -> None:
        needed = sum(
            frames_bytes(render.camera, len(missing[render.name]), self._modalities(render))
            for render in self._plan.renders
        )
        free = shutil.disk_usage(self._out).free
        self._progress.note(f"{sum(map(len, missing.values()))} frames, {size_text(needed)}")
        if needed > free:
            message = f"no space left: {size_text(needed)} are to be written and {size_text(free)} are free"
            raise StorageError(message, file=self._out, remedy="choose a part with --scenes, --settings or --frames")

    def _write(self, path: Path, data: bytes) -> None:
        if sha256_of_file(path) == sha256_of_bytes(data):
            return
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, own_scratch(self._out / WORK_FOLDER))

    # --- frames ---

    def _options(self, render: Render, frames: list[int]) -> RenderOptions:
        return render_options(self._plan, render, judging=render.frames[0] in frames)

    def _modalities(self, render: Render) -> tuple[Modality, ...]:
        return in_order(self._options(render, []).channels)

    def _render(self, render: Render, prepared: PreparedSource, frames: list[int], store: CleanStore) -> None:
        paths, files = source_paths(self._plan, render), store.files(render.name)
        source = open_render(prepared, render, paths, self._options(render, frames), partial(self._note, render.name))
        for frame in frames:
            if self._stop.is_set():
                raise InterruptedRunError("stopped; finished frames stay, and the same command goes on")
            files.keep(frame, source.frame(paths.request(frame)), self._modalities(render))
            self._progress.advance()


def rendered(plan: Plan) -> Plan:
    """Return the part of a plan whose scenes are rendered."""
    return replace(plan, renders=tuple(item for item in plan.renders if item.scene.source.capabilities.rendered))


def _holds_something(folder: Path) -> bool:
    return folder.is_dir() and any(item.name != WORK_FOLDER for item in folder.iterdir())
