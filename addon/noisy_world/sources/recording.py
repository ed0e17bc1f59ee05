# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `sequence`: a recording on disk, whose frames are read."""

import hashlib
import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH
from ..core.atomic_files import sha256_of_file
from ..core.errors import InputError, Message, Part, PresetKey
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import Optics
from ..core.machine import keep_freed_memory
from ..core.schema import Choice, ConfigPath, key
from ..core.streams import Identifiers
from ..core.trajectory import FrameStamps, Trajectory
from ..images.image_files import WholeFile
from ..images.measured_depth import VOID_CHOICES, VOID_MEANING, MeasuredDepth, Void
from ..layouts import Modality, OutputFormat, PosePolicy, find_sequence, recognising
from ..layouts.described import BAG_SUFFIXES, BagTopics, Key, SequenceSpec, check_sequence, name_key, read_described
from ..layouts.layout import counted_note
from ..layouts.stored_recording import RATE_HZ, StoredFrame, StoredSequence, depth_scale_key, same_camera, unposed
from ..preset.scene_keys import SceneKeys
from ..preset.sensor_keys import DistortionSpec, ImuClockSpec, check_distortion, sound_lens
from ..render.source import ColourAndDepth, RenderOptions, SimpleSource, Source, SourceCapabilities
from .renderers import Rectification
from .scene_kinds import GUESSED, FileSource, Lack, SceneEntry, camera_or_guess, sha256_of_path

if TYPE_CHECKING:
    from ..layouts.bag_recording import BagSequence

ReadAs: TypeAlias = Literal["auto", "images"]
# Plain ones, as they are read.
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".pnm", ".jp2")
OTHER_IMAGES = (".exr", ".dpx", ".tga", ".hdr", ".gif", ".heic")
RATE_TOLERANCE = 0.01  # chosen: 30 Hz may stand for the 29.97 of a camera; the recording's own stamps count anyway


@dataclass(frozen=True, kw_only=True)
class RecordingKeys(SceneKeys):
    """What a preset says of a recording."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "layout": "What the folder holds: a recording, or plain images alone",
        "poses": "What becomes of frames that have no valid pose",
        "rate_hz": "Rate of frames that have no time stamps, where it is not that of their layout",
        "undistort": "Make a pinhole's pictures of those of a lens that distorts",
        "register": "Lay depth of a camera of its own into color, by the calibration",
        "void": "What depth 0 means to fog, weather and defocus by depth; depth is written as it is",
        "depth_scale_per_m": "Steps a meter of depth, such as 1000 for millimeters, where no file says it",
    }

    sequence: SequenceSpec = key(
        "instead of mesh and trajectory: a recording's folder, or a mapping of it and of what is where in it",
        identity="meaning",
        label="Folder",
    )
    rate_hz: float | None = key(
        "frames a second of a sequence that has no time stamps of its own; default 20",
        unit="Hz",
        default=None,
        above=0,
        maximum=10_000,
        identity="meaning",
        slider=(1, 120),
        label="Frame Rate",
    )
    layout: ReadAs = key(
        "how the folder of a sequence is read: auto by the layout that its files tell; images as plain PNG or JPEG "
        "images in the order of their names, without depth and poses",
        default="auto",
        choices={
            "auto": Choice("Automatic", "By the layout that the folder's files tell"),
            "images": Choice("Plain Images", "PNG or JPEG images in the order of their names, without depth and poses"),
        },
        identity="meaning",
    )
    poses: PosePolicy = key(
        "frames of a sequence that have no valid pose: drop leaves them out, keep keeps them without one, require ends "
        "the run; none looks for no poses at all: a recording without ground truth",
        default="drop",
        choices={
            "drop": Choice("Drop", "A frame without a pose is left out"),
            "keep": Choice("Keep", "A frame without a pose is kept, and no pose is written for it"),
            "require": Choice("Refuse", "Frames without a pose end the run"),
            "none": Choice("No Poses", "Look for no poses at all: a recording without ground truth"),
        },
        identity="meaning",
        label="Without Pose",
    )
    undistort: bool = key(
        "whether a sequence whose lens distorts is made a pinhole's", default=False, identity="meaning"
    )
    register: bool = key(
        "whether depth of a sequence that has a camera of its own is laid into colour, by the calibration",
        default=False,
        identity="meaning",
        label="Register Depth",
    )
    depth_scale_per_m: float | None = depth_scale_key(
        "steps a metre of a sequence's depth images, where it is not what its files or its layout say"
    )
    void: Void = key(VOID_MEANING, default="unmeasured", choices=VOID_CHOICES, label="Void")
    imu: ImuClockSpec | None = key("what is done to the clock of an IMU that was recorded", default=None)
    distortion: DistortionSpec | None = key(
        "a lens that a pinhole's frames are bent as by: interpolated, what it would see beside them void", default=None
    )


@dataclass(frozen=True)
class Recording(SimpleSource):
    """A sequence on disk. between: why nothing is between its frames.

    void_values: what depth holds where nothing was measured, as the preset says it.
    """

    between: ClassVar[str] = "a recording has nothing between its frames"

    stored: StoredSequence
    place: ConfigPath
    undistort: bool = False
    register: bool = False
    distortion: DistortionSpec | None = None
    void: Void = "unmeasured"
    void_values: tuple[float, ...] = ()

    @cached_property
    def _measured(self) -> MeasuredDepth:
        stored = self.stored
        return MeasuredDepth(stored.folder, len(stored.depth_files), lambda frame: stored.frame(frame).depth_m)

    def optics(self, camera: Intrinsics) -> Optics:
        """Return what its cameras have beyond one pinhole, after what the preset has done to its frames."""
        return self.rectification(camera).left

    def rectification(self, camera: Intrinsics) -> Rectification:
        """Return what is done to each frame before it is perturbed. camera: of colour.

        Raises InputError where a lens is to be undistorted that belongs to another camera than this.
        """
        optics = self.stored.optics
        if self.stored.assumed and camera != self.stored.known_camera:
            optics = replace(optics, distortion=None)  # the lens is that of the camera which this one replaces
            if self.undistort:
                problem = "camera replaces the dataset's own, whose lens is known"
                raise self.place.at("undistort").error(problem, "leave one of them out")
        plain = Rectification(camera, optics, self.undistort, self.register)
        if self.distortion is None:
            return plain
        place = self.place.at("distortion")
        if plain.left.distortion is not None:
            raise place.error(
                "its lens distorts already", Message("set ", PresetKey("undistort", "true"), " beside it")
            )
        if plain.left.depth is not None:
            problem = "its depth has a camera of its own"
            raise place.error(problem, Message("set ", PresetKey("register", "true"), " beside it"))
        return replace(plain, bent=sound_lens(self.distortion, camera, place))

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.stored.folder)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Frames from the recorded poses, not rendered."""
        depth = bool(self.stored.depth_files)
        unmeasured_m = self._measured if depth and self.void != "sky" else None
        return SourceCapabilities(
            rendered=False,
            any_pose=False,
            depth=depth,
            instants_only=self.between,
            unmeasured_m=unmeasured_m,
            imu=self.stored.imu,
            exposures_s=self.stored.exposures_s,
            depth_scale_per_m=self.stored.depth_scale_per_m if depth else None,
            poses_path=self.stored.trajectory_path,
        )

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the frames, which are those of their colour."""
        return self.stored.stamps.rgb.seconds

    @property
    def frame_stamps(self) -> FrameStamps:
        """When colour, depth and poses were taken, as the recording says."""
        return self.stored.stamps

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, its own.

        Raises InputError where its images or its own intrinsics contradict those asked for, and where neither is known.
        """
        known, size_px = self.stored.known_camera, self.stored.size_px
        self.stored.check_images()
        if asked is None and known is None:
            raise self.place.at("sequence").error(
                f"no file of {self.location} says its intrinsics", self._whole_camera()
            )
        if asked is None:
            assert known is not None, "one of them is"
            return known
        if size_px != (asked.width_px, asked.height_px):
            asked_px = (asked.width_px, asked.height_px)
            problem = f"its images are {_spoken(size_px)}, but the preset's camera has {_spoken(asked_px)}"
            raise self.place.at("sequence").error(problem, "set camera to that, or leave it out")
        if known is not None and not self.stored.assumed and not same_camera(known, asked):
            problem = f"its camera has {_values(known)} ({self.stored.camera_path}), but the preset's {_values(asked)}"
            raise self.place.at("sequence").error(problem, "set camera to these, or leave it out")
        return asked

    def _whole_camera(self) -> Part:
        """Return the key that says a camera, with what is known of it."""
        width_px, height_px = self.stored.size_px
        likely = self.stored.likely
        if likely is None or (likely.width_px, likely.height_px) != (width_px, height_px):
            values, why = "fx: FX, fy: FY, cx: CX, cy: CY", ", with its calibration in pixels in place of the capitals"
        else:
            named = (("fx", likely.fx_px), ("fy", likely.fy_px), ("cx", likely.cx_px), ("cy", likely.cy_px))
            values = ", ".join(f"{name}: {value:g}" for name, value in named)
            why = ", which is the benchmark's of the Kinect that the folder is named by, or its own calibration"
        camera = PresetKey("camera", f"{{width: {width_px}, height: {height_px}, {values}}}")
        return Message("give ", camera, why)

    def trajectory(self) -> Trajectory:
        """Return its ground truth."""
        return self.stored.trajectory

    def hashes(self) -> dict[str, Any]:
        """Return the folder's name, the hashes of ground truth and of all images together, and what its texts say."""
        stored = self.stored
        path = stored.trajectory_path
        return {
            **self._hashed_images(),
            "trajectory": None if path is None else path.name,
            "trajectory_sha256": None if path is None else sha256_of_path(path),
            **({"depth_scale_per_m": stored.depth_scale_per_m} if stored.depth_files else {}),
            **({"void_values": list(self.void_values)} if self.void_values else {}),
            **stored.optics.content(),
            **{key: True for key in ("undistort", "register") if getattr(self, key)},
            **({} if stored.imu is None else {"imu_sha256": sha256_of_file(stored.imu.path)}),
            **({} if stored.exposures_s is None else {"exposures_sha256": _sha256_of(stored.exposures_s)}),
            **_timing(stored),
        }

    def _hashed_images(self) -> dict[str, Any]:
        digests = "".join(sha256_of_file(file) or "" for file in self.stored.files)
        sha256 = hashlib.sha256(digests.encode()).hexdigest()
        return {"sequence": self.stored.folder.name, "sequence_sha256": sha256}

    def camera_note(self, camera: Intrinsics) -> str:
        """Return a sentence where the camera is the dataset's documented one, "" where a file or the preset says it."""
        return self.stored.assumed if self.stored.known_camera == camera else ""

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenRecording"]:
        """Prepare to read frames."""
        for text in (*self.stored.notes, *self.stored.image_notes):
            note(text)
        if said := self.camera_note(camera):
            note(said)
        keep_freed_memory()  # clearing new pages for each file's content takes as long as checking it
        rectification = self.rectification(camera)
        yield OpenRecording(self.stored, None if rectification.does_nothing else rectification)


def read_recording(
    folder: Path,
    place: ConfigPath,
    rate_hz: float | None = None,
    poses: PosePolicy = "drop",
    *,
    described: SequenceSpec | None = None,
    undistort: bool = False,
    register: bool = False,
    distortion: DistortionSpec | None = None,
    depth_scale_per_m: float | None = None,
    void: Void = "unmeasured",
) -> Recording:
    """Find the files of a recording. rate_hz: of its frames, as the preset says it; None where it does not.

    poses: what becomes of frames without a pose. described: where its files are; None for a layout that they tell.
    undistort: whether to make a pinhole of a lens that distorts.
    register: whether depth of a camera of its own is laid into colour. distortion: of a lens that frames are bent by.
    depth_scale_per_m: steps a metre of depth, in place of what files and layout say. void: what depth 0 means.
    Raises InputError where files are missing or wrong, where its own stamps say another rate, and where there is
    nothing to undistort or register.
    """
    if described is None:
        stored = find_sequence(folder, rate_hz, poses)
    else:
        stored = read_described(folder, described, place.at("sequence"), rate_hz, poses)
    own_hz = None if stored.stamps_path is None else stored.rate_hz
    if rate_hz is not None and own_hz is not None and not abs(rate_hz / own_hz - 1) <= RATE_TOLERANCE:
        problem = f"is {rate_hz:g} Hz, but {stored.stamps_path} says {own_hz:.6g} Hz"
        raise place.at("rate_hz").error(problem, "leave it out: the recording's own time stamps are kept")
    if not stored.depth_files:
        asked = {"register": register, "depth_scale_per_m": depth_scale_per_m is not None, "void": void == "sky"}
        for name in (name for name, given in asked.items() if given):
            raise place.at(name).error(f"{folder} has no depth", "leave it out")
    if undistort and stored.optics.distortion is None:
        raise place.at("undistort").error(f"no file of {folder} says that the lens distorts", "leave it out")
    if register and stored.optics.depth is None:
        raise place.at("register").error(f"depth and colour of {folder} have one camera", "leave it out")
    if depth_scale_per_m not in (None, stored.depth_scale_per_m):
        before, said = stored.depth_scale_per_m, PresetKey("scenes.depth_scale_per_m")
        note = Message(f"depth has {depth_scale_per_m:g} steps a metre by ", said, f", in place of {before:g}")
        stored = replace(stored, depth_scale_per_m=depth_scale_per_m, notes=(*stored.notes, note))
    told = () if described is None or described.depth is None else described.depth.void
    return Recording(stored, place, undistort, register, distortion, void, told)


# --- plain images, in the order of their names ---


@dataclass(frozen=True)
class Images(Recording):
    """The images of a folder: colour alone."""

    between: ClassVar[str] = "plain images have nothing between them"

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        self.stored.check_images()
        return camera_or_guess(asked, self.stored.size_px, self.place.at("sequence"), "images")

    def hashes(self) -> dict[str, Any]:
        """Return the folder's name, the hash of all images in their order, and the rate."""
        return self._hashed_images() | {"rate_hz": self.stored.counted_hz}

    def camera_note(self, camera: Intrinsics) -> str:
        """Return a sentence where the camera is a guess."""
        return GUESSED if camera == self.camera(None) else ""


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
        depth_scale_per_m=1.0,
        notes=counted_note(rate_hz, used_hz),
        counted_hz=used_hz,
    )
    return Images(stored, place)


def holds_images(folder: Path) -> bool:
    """Tell whether images lie in a folder itself."""
    return folder.is_dir() and any(path.suffix.lower() in IMAGES for path in folder.iterdir())


def _files(folder: Path) -> tuple[Path, ...]:
    try:
        there = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    found = sorted((path for path in there if path.suffix.lower() in IMAGES), key=_name_key)
    if not found:
        others = sorted({path.suffix.lower() for path in there} & set(OTHER_IMAGES))
        problem = f"has images of {', '.join(others)}, but no PNG or JPEG" if others else "has no PNG or JPEG images"
        raise InputError(folder, problem, remedy="convert them" if others else "")
    for one, other in itertools.pairwise(found):
        if _name_key(one) == _name_key(other):
            problem = f"{one.name} and {other.name} stand for one place in the order of names"
            raise InputError(folder, problem, remedy="keep one of them")
    return tuple(found)


def _name_key(path: Path) -> Key:
    return name_key(path.stem)


def _values(camera: Intrinsics) -> str:
    return f"fx {camera.fx_px:.9g}, fy {camera.fy_px:.9g}, cx {camera.cx_px:.9g}, cy {camera.cy_px:.9g}"


def _spoken(size_px: tuple[int, int]) -> str:
    return f"{size_px[0]} x {size_px[1]}"


def _sha256_of(values: NDArray[np.float64]) -> str:
    return hashlib.sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()


def _timing(stored: StoredSequence) -> dict[str, Any]:
    """Return what decides the stamps: a rate, or the name of a file and the hash of what it says."""
    if stored.stamps_path is None:
        return {"rate_hz": stored.counted_hz}
    parts = (stored.stamps.rgb, stored.stamps.depth, stored.stamps.pose)
    said = repr([part.exact_ns or part.seconds.tolist() for part in parts])
    return {"stamps": stored.stamps_path.name, "stamps_sha256": hashlib.sha256(said.encode()).hexdigest()}


@dataclass(frozen=True)
class OpenRecording:
    """A recording that is ready to give frames. rectification: done to each; None for nothing."""

    stored: StoredSequence
    rectification: Rectification | None = None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenRecording":
        """Return itself: the files decide what its frames show."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> "RecordedFrame":
        """Return the frame of a request; its images are read on request."""
        return RecordedFrame(self.stored.frame(request.frame), self.rectification)

    def encoded_colour(self, frame: int) -> bytes:
        """Return what a frame's colour is decoded from. Raises InputError where it cannot be read."""
        return self.stored.encoded_colour(frame)


@dataclass(frozen=True)
class RecordedFrame(ColourAndDepth):
    """A frame on disk. rectification: done to its images; None for nothing."""

    stored: StoredFrame
    rectification: Rectification | None = None

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, sRGB-encoded, uint8, or float32 in [0, 1] where the file has 16 bits.

        Raises InputError where the file is damaged, or no image.
        """
        rgb = self.stored.rgb
        return rgb if self.rectification is None else self.rectification.rgb(rgb)

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres, 0 = void; None of a recording without. Raises InputError as `rgb` does."""
        if self.stored.depth_file is None:
            return None
        depth_m = self.stored.depth_m
        return depth_m if self.rectification is None else self.rectification.depth_m(depth_m)

    def file_as(self, modality: Modality, written: OutputFormat) -> WholeFile | None:
        """Return an image's file if a dataset would write the same: equal image kind, colours and depth scale.

        Raises InputError where that file is damaged.
        """
        stored = self.stored
        if self.rectification is not None or modality not in COLOUR_AND_DEPTH:
            return None
        if modality == "rgb":
            same = stored.stored_rgb == (written.image, written.colour)
        else:
            # A dataset says void by 0 alone.
            same = stored.depth_scale_per_m == written.depth_scale_per_m and not stored.void_steps
            same = same and stored.depth_is_png
        return stored.whole_file(modality) if same else None


# --- bags of ROS, whose images are read out of them when they are asked for ---


@dataclass(frozen=True)
class BagRecording(Recording):
    """A recording in a bag."""

    between: ClassVar[str] = "a bag has nothing between its frames"

    @property
    def _bag(self) -> "BagSequence":
        return cast("BagSequence", self.stored)

    def hashes(self) -> dict[str, Any]:
        """Return the bag's name, the hash of each of its files, the topics, and what is done to the frames."""
        stored = self._bag
        return {
            "bag": stored.folder.name,
            "bag_sha256": [sha256_of_file(part.path) for part in stored.bag.parts],
            "topics": dict(stored.told),
            "frames": len(stored.of_rgb),
            **({"depth_scale_per_m": stored.depth_scale_per_m} if stored.depth_files else {}),
            **stored.optics.content(),
            **{key: True for key in ("undistort", "register") if getattr(self, key)},
        }

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenBag"]:
        """Prepare to read frames; the bag is closed at the end."""
        with super().prepare(camera, note) as opened:
            try:
                yield OpenBag(opened.stored, opened.rectification)
            finally:
                self._bag.bag.close()


@dataclass(frozen=True)
class OpenBag(OpenRecording):
    """A bag that is ready to give frames."""

    def frame(self, request: FrameRequest) -> "FrameInBag":
        """Return the frame of a request; its images are read on request."""
        return FrameInBag(self.stored.frame(request.frame), self.rectification)


@dataclass(frozen=True)
class FrameInBag(RecordedFrame):
    """A frame of a bag."""

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: its images are in no files of their own."""
        del modality, written


def read_bag(
    path: Path,
    place: ConfigPath,
    topics: BagTopics,
    poses: PosePolicy = "drop",
    *,
    undistort: bool = False,
    register: bool = False,
    distortion: DistortionSpec | None = None,
    depth_scale_per_m: float | None = None,
    void: Void = "unmeasured",
) -> BagRecording:
    """Find what a bag records, as `read_recording` does of a folder. topics: that are asked for.

    Raises InputError where it is no bag, no topic or several fit, a message is not what it should be, and where there
    is nothing to undistort or register.
    """
    from ..layouts.bag_recording import read_bag_sequence

    stored = read_bag_sequence(path, topics, poses, depth_scale_per_m)
    if not stored.depth_files:
        asked = {"register": register, "depth_scale_per_m": depth_scale_per_m is not None, "void": void == "sky"}
        for name in (name for name, given in asked.items() if given):
            raise place.at(name).error(f"{path} has no depth", "leave it out")
    if undistort and stored.optics.distortion is None:
        raise place.at("undistort").error(f"no camera_info of {path} says that the lens distorts", "leave it out")
    if register and stored.optics.depth is None:
        raise place.at("register").error(f"depth and colour of {path} have one camera", "leave it out")
    if depth_scale_per_m is not None:
        note = Message(f"depth has {depth_scale_per_m:g} steps a metre by ", PresetKey("scenes.depth_scale_per_m"))
        stored = replace(stored, notes=(*stored.notes, note))
    return BagRecording(stored, place, undistort, register, distortion, void)


def _is_bag(path: Path) -> bool:
    """Tell whether a path that no layout recognises is a bag."""
    if path.is_dir() and recognising(path):
        return False
    from ..layouts.bag_files import is_bag

    return is_bag(path)


def _read_bag(entry: SceneEntry[RecordingKeys], path: Path) -> Source:
    keys, sequence = entry.keys, entry.keys.sequence
    if keys.rate_hz is not None:
        raise entry.place.at("rate_hz").error("is not for a bag, whose messages have stamps", "leave it out")
    scale_per_m = keys.depth_scale_per_m or (None if sequence.depth is None else sequence.depth.scale_per_m)
    return read_bag(
        *(path, entry.place, sequence.topics, keys.poses),
        undistort=keys.undistort,
        register=keys.register,
        distortion=keys.distortion,
        depth_scale_per_m=scale_per_m,
        void=keys.void,
    )


class RecordingKind(FileSource[RecordingKeys]):
    """A folder is read by the layout that recognises it."""

    name = "sequence"
    order = 30
    label = "Recording"
    meaning = "a sequence that was recorded or made before, in any layout that is read"
    keys = RecordingKeys
    folder = True
    several = "sequences"
    remedies: ClassVar[Mapping[Lack, Part]] = {
        "poses": Message(PresetKey("poses", "drop"), " leaves them out"),
        "registration": Message(PresetKey("register", "true"), " lays depth into colour"),
        "pinhole": Message(PresetKey("undistort", "true"), " makes a pinhole of it"),
    }
    instead: ClassVar[Mapping[str, Part]] = {"trajectory": "leave it out: a sequence has its own"}

    def named_file(self, keys: RecordingKeys) -> str:
        """Return the folder or the bag, or a pattern of several."""
        return keys.sequence.bag or keys.sequence.folder or ""

    def takes_file(self, keys: RecordingKeys, name: str) -> bool:
        """Tell whether a name is a bag's, which may be a file."""
        return keys.sequence.bag is not None or name.lower().endswith(BAG_SUFFIXES)

    def recorded(self, keys: RecordingKeys) -> dict[str, Any]:
        """Return the keys as a dataset tells them; a recording whose layout its files tell is its folder."""
        told = super().recorded(keys)
        given = {name: value for name, value in told["sequence"].items() if value is not None}
        return {**told, "sequence": given if keys.sequence.described else keys.sequence.folder}

    def check(self, keys: RecordingKeys, place: ConfigPath) -> None:
        """Refuse what plain images have not, and a lens that is none."""
        check_sequence(keys.sequence, place.at("sequence"))
        if keys.distortion is not None:
            check_distortion(keys.distortion, place.at("distortion"))
            if keys.distortion.undistort:
                raise place.at("distortion").at("undistort").error("is for what is rendered", "leave it out")
        if keys.layout != "images":
            return
        if keys.sequence.bag is not None:
            raise place.at("layout").error("is for a folder, and this is a bag", "leave it out")
        lacking = {
            "undistort": "no file that says their lens",
            "register": "no depth",
            "distortion": "no known camera",
            "depth_scale_per_m": "no depth",
            "void": "no depth",
            "imu": "no IMU",
        }
        for name, what in lacking.items():
            if getattr(keys, name) not in (None, False, "unmeasured"):
                raise place.at(name).error(f"plain images have {what}", "leave it out")
        if keys.poses == "require":
            raise place.at("poses").error("plain images have no poses", "leave it out")

    def open_file(self, entry: SceneEntry[RecordingKeys], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a folder."""
        del parts
        keys = entry.keys
        if keys.layout == "images":
            return read_images(path, entry.place, keys.rate_hz)
        if keys.sequence.bag is not None or (not keys.sequence.described and _is_bag(path)):
            return _read_bag(entry, path)
        if not keys.sequence.described and holds_images(path) and not recognising(path):
            remedy = Message(PresetKey("layout", "images"), " reads it, without depth and poses")
            raise entry.place.at("sequence").error(f"{path} has the files of no layout, but plain images", remedy)
        recording = read_recording(
            *(path, entry.place, keys.rate_hz, keys.poses),
            described=keys.sequence if keys.sequence.described else None,
            undistort=keys.undistort,
            register=keys.register,
            distortion=keys.distortion,
            depth_scale_per_m=keys.depth_scale_per_m,
            void=keys.void,
        )
        return recording if keys.imu is None else _clocked(recording, keys.imu, (entry.preset.spec.seed, name))


def _clocked(recording: Recording, clock: ImuClockSpec, identifiers: Identifiers) -> Recording:
    """Return a recording with deviations of its IMU's clock. Raises InputError where it has none."""
    stored, place = recording.stored, recording.place.at("imu")
    if stored.imu is None:
        raise place.error(f"{stored.folder} has no IMU", "leave it out")
    imu = clock.on(stored.imu, stored.stamps.rgb.ns[0], identifiers)
    if imu.samples.stamps_ns.size and imu.samples.stamps_ns.min() < 0:
        raise place.at("time_offset_s").error("puts the IMU's first stamp before 0", "use 0 or more")
    if not imu.samples.stamps_ns.size:
        raise place.at("dropped_share").error("leaves no sample of the IMU", "use a lower one")
    return replace(recording, stored=replace(stored, imu=imu))


SOURCE = RecordingKind()
