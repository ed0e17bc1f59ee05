# SPDX-License-Identifier: GPL-3.0-or-later
"""The protocol of sources, where clean frames come from: a mesh, a recording, or one that is added.

The protocol of sources, where clean frames come from: a mesh, a recording, or one that is added.

All other code uses a source by this protocol alone and never asks which one it is. `noisy_world.sources` holds them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH
from ..channels.channel import Fact
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Bending, Optics
from ..core.mirrored import Mirrored
from ..core.trajectory import Axes, FrameStamps, Trajectory
from ..images.image_files import WholeFile
from ..layouts import Modality, OutputFormat
from ..perturbations.kinds import small_light, small_of
from ..scenes.polygon_mesh import Mesh, SceneObject
from ..trajectories.rig import RecordedImu

if TYPE_CHECKING:
    from ..preset.keys import EngineName


PERTURBED = "perturbed"
"""Of a lit source's `hashes`: that environment and lens act on its light before the view transform, as since 0.2."""
DRAWN = "weather"
"""Of a lit source's `hashes`: a number, raised when groups give other pictures of its light."""


class SourceFrame(Protocol):
    """A clean frame; an image that was not asked for is None."""

    @property
    def rgb(self) -> NDArray[np.float32] | NDArray[np.uint8] | None:
        """Colour (H, W, 3), float32 in [0, 1] or uint8; RGB, sRGB-encoded."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres; 0 = void."""
        ...

    @property
    def light(self) -> "SceneLight | None":
        """Colour before the view transform, of a lit frame; None of any other."""
        ...

    @property
    def behind_glass_m(self) -> NDArray[np.float32] | None:
        """Depth (H, W) of what it shows through panes, metres; None without any, or where it was not asked for."""
        ...

    @property
    def exposure(self) -> Sequence[Mapping[str, Any]]:
        """What its exposure did, for its record: a note of each step; empty without one."""
        ...

    def image(self, modality: Modality) -> NDArray[Any] | None:
        """Return the image of a channel, as the channel describes it; colour and depth as above."""
        ...

    def file_as(self, modality: Modality, written: OutputFormat) -> WholeFile | None:
        """Return an existing file that holds an image exactly as a dataset would write it, or None.

        Raises InputError where that file is damaged.
        """
        ...


@dataclass(frozen=True)
class SceneLight:
    """Colour of a lit frame before its scene's view transform.

    rgb: (H, W, 3) float32, scene-linear (Rec. 709), at least 0, multiplied by alpha, (H, W, 1). encode: light with
    alpha (H, W, 4) -> display-encoded colour (H, W, 3), float32 in [0, 1], by the scene's view transform. It works in
    the main thread alone, and until the source gives another frame. mirrored: what the frame's surfaces mirror; None
    where it was not asked for.
    """

    rgb: NDArray[np.float32]
    alpha: NDArray[np.float32]
    encode: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    mirrored: Mirrored | None = None

    def show(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return other light of this shape as the frame's would be shown: (H, W, 3), float32 in [0, 1]."""
        return self.encode(np.concatenate([light, self.alpha], axis=2))


class ColourAndDepth:
    """The images of a frame that has no other channels than colour and depth, and none of what is rarer."""

    rgb: Any
    depth_m: Any
    light: SceneLight | None = None
    behind_glass_m: NDArray[np.float32] | None = None
    exposure: Sequence[Mapping[str, Any]] = ()

    def image(self, modality: Modality) -> NDArray[Any] | None:
        """Return the image of a channel; None for what it has not."""
        match modality:
            case "rgb":
                return self.rgb
            case "depth":
                return self.depth_m
            case _:
                return None


@dataclass(frozen=True)
class RenderedFrame(ColourAndDepth):
    """One rendered frame.

    rgb: (H, W, 3) float32, display-encoded (sRGB), nominally [0, 1]; None if not asked for. Void is black.
    depth_m: (H, W) float32, planar depth at the pixel's centre in metres, 0 = void; None if not asked for.
    others: those of other channels that were asked for, by name, as the channels describe them. colour_rays: how many
    rays the pixels of colour took together; None where that does not follow from what is seen. light: colour before a
    view transform, of a lit scene. behind_glass_m: depth as `depth_m`, but of what is seen through panes; None where
    there are none, or it was not asked for. exposure: what was done while it was exposed, for its record.
    """

    rgb: NDArray[np.float32] | None
    depth_m: NDArray[np.float32] | None
    others: Mapping[Modality, NDArray[Any]] = field(default_factory=dict)
    colour_rays: int | None = None
    light: SceneLight | None = None
    behind_glass_m: NDArray[np.float32] | None = None
    exposure: Sequence[Mapping[str, Any]] = ()

    def image(self, modality: Modality) -> NDArray[Any] | None:
        """Return the image of a channel; None if it was not asked for."""
        return self.others[modality] if modality in self.others else super().image(modality)

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: a rendered image is in no file yet."""


@dataclass(frozen=True)
class OwnRendering:
    """How a source renders that brings its own settings: the engine, its samples, and between which distances it sees.

    What the preset gives of these stands here instead.
    """

    engine: "EngineName"
    samples: int
    near_m: float
    far_m: float


@dataclass(frozen=True)
class SourceCapabilities:
    """What a source can give.

    rendered: its frames come from a renderer, which takes time. any_pose: it gives frames from any pose, not only
    from those that were recorded. own: how it is rendered; None where the preset says it. imported: Blender's
    importers read it, whatever renders it. depth: whether it has any. surface: what is known of the surface that each
    pixel sees, for normals and the like. objects: returns the objects that it shows; None where they are a mesh's
    own. moving: whether anything but the camera may move. instants_only: why it has nothing between its frames; ""
    where it answers requests for any time. lit: its frames have scene-linear light before a view transform.
    casts_rays: whether it gives the rays that a request asks for. at_once: why it does not, where there is more to
    say. distorts: whether its frames pass the lens that a preset's camera has. depth_cameras: whether depth
    may have another camera than colour. unmeasured_m: of a source whose depth was measured, so that void is what was
    not: how far a frame counts that measured nothing at all, by its number, metres. None where void is the sky, as
    that of a renderer: infinitely far. imu: what an IMU measured beside the frames; None without one.
    exposures_s: (N,) how long colour of each frame was exposed, NaN where that is not known; None without any.
    passes: whether it gives the passes of a scene of one's own.
    """

    rendered: bool
    any_pose: bool
    own: OwnRendering | None = None
    imported: bool = False
    depth: bool = True
    surface: frozenset[Fact] = frozenset()
    objects: Callable[[], Sequence[SceneObject]] | None = None
    moving: bool = False
    instants_only: str = ""
    lit: bool = False
    casts_rays: bool = False
    at_once: str = ""
    distorts: bool = False
    depth_cameras: bool = False
    unmeasured_m: Callable[[int], float] | None = None
    imu: RecordedImu | None = None
    exposures_s: NDArray[np.float64] | None = None
    depth_scale_per_m: float | None = None
    poses_path: Path | None = None
    passes: bool = False

    @property
    def recorded(self) -> bool:
        """Whether its frames were recorded, so that there is something to find in them."""
        return not self.rendered and not self.any_pose and bool(self.instants_only)


@dataclass(frozen=True)
class RenderOptions:
    """How sources that render make their frames.

    channels: what they give, by name. threads: 0 for as many as the machine has. first_frames: the first frames of the
    path; a source refuses a path where all of them see nothing, unless there are none here. through_glass: whether
    depth is needed of what is seen through panes, too. depth_camera: that of depth; None where it is colour's.
    instants: whether frames are of instants, whatever blur a scene has set up, as an exposure is made of them.
    read_lines: whether lines of a frame are read one after another, so that nothing may look at its neighbours.
    """

    near_m: float
    far_m: float
    samples: int
    seed: int
    engine: "EngineName" = "cycles"
    device: Literal["cpu", "gpu"] = "cpu"
    channels: frozenset[Modality] = COLOUR_AND_DEPTH
    threads: int = 0
    first_frames: tuple[int, ...] = ()
    through_glass: bool = False
    depth_camera: Intrinsics | None = None
    instants: bool = False
    read_lines: bool = False

    @cached_property
    def rgb(self) -> bool:
        """Whether they give colour."""
        return "rgb" in self.channels

    @cached_property
    def depth(self) -> bool:
        """Whether they give depth."""
        return "depth" in self.channels


Motion: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32]]


class OpenSource(Protocol):
    """A source that is ready to give frames along the paths of one render; if things move there, a `MovingSource`."""

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request."""
        ...


@runtime_checkable
class MovingSource(OpenSource, Protocol):
    """An open source in which things move."""

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return how what the colour camera sees moves between two frames.

        (H, W, 2) each, float32: how far what a pixel's centre sees here is from it there, x and y in pixels, and back.
        None where both frames show the same moment.
        """
        ...


def motion_between(source: OpenSource, here: FrameRequest, there: FrameRequest) -> Motion | None:
    """Return what a source in which things move says of two frames, as `MovingSource` has it."""
    assert isinstance(source, MovingSource), "its capabilities say that things move"
    return source.motion(here, there)


class PreparedSource(Protocol):
    """A source that is in memory, for all the renders of its scene, one after another."""

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> OpenSource:
        """Return what gives frames along the paths, until the next is opened.

        note: called with sentences that the user should see.
        """
        ...


class Source(Protocol):
    """Where the clean frames of a scene come from."""

    @property
    def location(self) -> str:
        """The file, the folder or the name of an embedded scene, for messages."""
        ...

    @property
    def capabilities(self) -> SourceCapabilities:
        """What it can give."""
        ...

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds; known before the path is."""
        ...

    @property
    def frame_stamps(self) -> FrameStamps:
        """When colour, depth and pose of each frame were taken; colour's are the frames' own, `stamps_s`."""
        ...

    @property
    def robot_axes(self) -> Axes | None:
        """The axes in which the path's poses were declared and a rig's extrinsics are given; None without a rig."""
        ...

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics of its frames, given those that the preset asks for, None where it asks for none.

        None where it has none of its own, and gives what it is asked for. Raises InputError where it cannot give that,
        or has to be told.
        """
        ...

    def optics(self, camera: Intrinsics) -> Optics:
        """Return what its cameras have beyond one pinhole. camera: of colour, as `camera` returned it.

        Raises InputError where the preset asks for what cannot be done to them.
        """
        ...

    def trajectory(self) -> Trajectory:
        """Return the path of the camera, or of the robot that carries it. It is made once and may take seconds."""
        ...

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """Returns the mesh that the frames show; None where it is none."""
        ...

    def remarks(self, camera: Intrinsics) -> Iterable[str]:
        """Return what a user should know of its frames before a run makes many, found by looking at some of them.

        camera: as `camera` returned it. May take a second; most sources have nothing to say.
        """
        ...

    def hashes(self) -> dict[str, Any]:
        """Return what decides the frames' bytes: names as the preset gives them, and the SHA-256 of the files."""
        ...

    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> AbstractContextManager[PreparedSource]:
        """Prepare to give frames through a camera, along one path after another.

        What is large is loaded once, and is free when the context ends. note: called with sentences that the user
        should see.
        """
        ...


# What most sources have in common, to begin one with; and one whose frames are computed one by one.


class SimpleSource(ABC):
    """A source whose camera is one pinhole, that takes colour, depth and pose at one moment, and that has no mesh."""

    @abstractmethod
    def trajectory(self) -> Trajectory:
        """Return the path."""

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.trajectory().stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the path: colour, depth and pose are of one moment."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        return FrameStamps.of(self.stamps_s)

    @property
    def robot_axes(self) -> Axes | None:
        """None: it knows of no rig."""
        return None

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics asked for: it can be seen through any camera."""
        return asked

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        del camera
        return PINHOLE

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """None: its frames show no mesh that is known."""
        return None

    def remarks(self, camera: Intrinsics) -> Iterable[str]:
        """Return nothing that a user should know of its frames."""
        del camera
        return ()


class ComputedSource(SimpleSource):
    """A source that computes each frame by itself, from any pose: `location`, `trajectory`, `hashes` and `frame`."""

    capabilities = SourceCapabilities(rendered=False, any_pose=True)

    @property
    def robot_axes(self) -> Axes | None:
        """OpenCV's."""
        return "opencv"

    @abstractmethod
    def hashes(self) -> dict[str, Any]:
        """Return what decides the frames' bytes beside the keys of the preset: the SHA-256 of files, or nothing."""

    @abstractmethod
    def frame(self, request: FrameRequest, camera: Intrinsics) -> RenderedFrame:
        """Return colour as seen from `request.rgb_c2w`, and depth from `request.depth_c2w`, at `request.time_s`."""

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> "Iterator[OpenComputed]":
        """Prepare to compute frames; there is nothing to prepare."""
        del note
        yield OpenComputed(self, camera)


@dataclass(frozen=True)
class OpenComputed:
    """A computed source, seen through a camera."""

    source: ComputedSource
    camera: Intrinsics

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenComputed":
        """Return itself: each request says its pose."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Return the frame of a request."""
        return self.source.frame(request, self.camera)


# The images of a frame beside its colour, as a lens that distorts shows them.


def surfaces_bent(frame: RenderedFrame, bending: Bending, *, own_depth: bool = False) -> RenderedFrame:
    """Return a frame whose colour is bent already with all else bent too, but depth of a camera of its own."""
    behind_m = frame.behind_glass_m
    return replace(
        frame,
        depth_m=frame.depth_m if own_depth or frame.depth_m is None else bending.depth_m(frame.depth_m),
        others={name: bending.nearest(image) for name, image in frame.others.items()},
        behind_glass_m=None if behind_m is None else bending.depth_m(behind_m),
    )


# What a camera's meter sees of a clean frame of a source.


def light_seen(frame: SourceFrame) -> NDArray[np.float32]:
    """Return what a meter sees of a clean frame, as `small_light`; of a lit one its light."""
    if (light := frame.light) is not None:
        return small_of(light.rgb)
    assert frame.rgb is not None, "colour was not asked for"
    return small_light(frame.rgb)
