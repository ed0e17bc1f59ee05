# SPDX-License-Identifier: GPL-3.0-or-later
"""What a channel of a frame is: images of its own, of the surface that is seen, or of two frames."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.depth_range import OutOfRange
from ..core.geometry import Intrinsics
from ..core.packages import LAST
from ..core.trajectory import FrameStamps
from ..images.pixels import decode_exr, decode_npy, decode_steps, encode_exr, encode_npy, encode_png
from ..scenes.polygon_mesh import Mesh, SceneObject

Image: TypeAlias = Literal["jpg", "png", "exr"]
"""What colour may be stored as; an EXR is scene-linear light."""

FileKind: TypeAlias = Literal["jpg", "png", "exr", "npy"]
"""What files of images are: PNG and JPEG of whole numbers, and what keeps values as they are in memory."""

FILE_KINDS = {"png": "PNG of 16 bits", "exr": "EXR, float32, zipped", "npy": "an array of numpy's, uncompressed"}
"""What a channel other than colour may be stored as, in words."""


class ImageNames(Protocol):
    """What a channel asks a layout: how its files are named, inside a sequence's folder."""

    def rgb_name(self, frame: int, stamp_ns: int, image: Image) -> str:
        """Return the name of a colour image."""
        ...

    def depth_name(self, frame: int, stamp_ns: int) -> str:
        """Return the name of a depth image."""
        ...

    def channel_name(self, channel: str, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the name of an image of a channel that layouts know nothing of."""
        ...


class ImageFormat(Protocol):
    """What a channel asks the format of a dataset."""

    @property
    def image(self) -> Image:
        """What colour is stored as."""
        ...

    @property
    def formats(self) -> tuple[tuple[str, FileKind], ...]:
        """What other channels are stored as, by name, where that is not their default."""
        ...

    def encode_rgb(self, rgb: NDArray[Any], *, fit_tables: bool = True) -> bytes:
        """Encode colour."""
        ...

    def encode_depth(self, depth_m: NDArray[Any]) -> bytes:
        """Encode depth."""
        ...

    def out_of_range(self, depth_m: NDArray[Any]) -> OutOfRange | None:
        """Count the pixels whose depth an image cannot hold; None where it holds all."""
        ...


BLENDERS_PARTS = {1: ("V",), 2: ("X", "Y"), 3: ("X", "Y", "Z"), 4: ("X", "Y", "Z", "W")}
ZIPPED = 0.25  # of the bytes in memory that an EXR of normals takes, in a room; measured, and rounded

KindOfSteps: TypeAlias = Literal["rgb", "depth"]
"""Which of a setting's steps act on a channel: perturbations of colour, or of depth."""


@dataclass(frozen=True)
class PixelBytes:
    """How many bytes a pixel of an image's file takes, as measured.

    usual, perturbed: the mean of clean images and of perturbed ones. clean, changed, grainy: the least and the most, of
    clean images, of perturbed ones, and of those with noise of each pixel's own.
    """

    usual: float
    perturbed: float
    clean: tuple[float, float]
    changed: tuple[float, float]
    grainy: tuple[float, float]


class Channel(ABC):
    """A kind of image of a frame: what its values mean, and how they become a file.

    name: in presets (`output.modalities`) and in tables. order: among all, in which they are made and listed; ours are
    the first. label, meaning: for people. spoken: the word for it in
    messages. dtype, components, unit: of its values in memory. convention: what its files hold, for the manifest.
    steps: which steps of a setting act on it; None for none: its images are always clean. paired: whether it is the
    depth sensor's, which has stamps and poses of its own and which desynchronisation shifts; else it is colour's.
    pairs: whether it leads from a frame to the sequence's next one. kinds: what its files may be, the default first.
    parts: the names of its components, for files that name them; by default as Blender names those of its passes.
    bytes_per_pixel: of its files, as measured, of the first kind.
    """

    name: ClassVar[str]
    order: ClassVar[int] = LAST
    label: ClassVar[str]
    meaning: ClassVar[str]
    spoken: ClassVar[str]
    dtype: ClassVar[str]
    components: ClassVar[int]
    unit: ClassVar[str]
    convention: ClassVar[str]
    steps: ClassVar[KindOfSteps | None] = None
    paired: ClassVar[bool] = False
    pairs: ClassVar[bool] = False
    kinds: ClassVar[tuple[FileKind, ...]] = ("png",)
    parts: ClassVar[tuple[str, ...]] = ()
    bytes_per_pixel: ClassVar[float]

    def suffix(self, written: ImageFormat) -> str:
        """Return how the names of its files end, such as "png"."""
        return dict(written.formats).get(self.name, self.kinds[0])

    def recorded_suffix(self, output: dict[str, Any]) -> str:
        """Return the same by what the identity of a dataset says of its output."""
        return output.get("formats", {}).get(self.name, self.kinds[0])

    def name_in(self, layout: ImageNames, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the name of a frame's file inside its sequence's folder: in a folder of the channel's name."""
        return layout.channel_name(self.name, frame, stamps, suffix)

    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Return its image, (H, W) or (H, W, components), as a file of the dataset."""
        match self.suffix(written):
            case "exr":
                return encode_exr(pixels, self.parts or BLENDERS_PARTS[self.components])
            case "npy":
                return encode_npy(pixels)
            case _:
                return encode_png(self.steps_of(pixels))

    def encode_clean(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Return a clean image, which many sequences may link, as a file of the dataset: by default as `encode`."""
        return self.encode(pixels, written)

    def steps_of(self, pixels: NDArray[Any]) -> NDArray[np.uint16]:
        """Return an image as 16-bit values, as a PNG holds them: by default these themselves, where it is uint16."""
        return pixels.astype(np.uint16, casting="equiv", copy=False)

    def pixels_of(self, steps: NDArray[np.uint16]) -> NDArray[Any]:
        """Return the image of 16-bit values: by default these themselves."""
        return steps

    def stored(self, pixels: NDArray[Any], kind: str) -> NDArray[Any]:
        """Return an image as it is read back from a file of some kind."""
        return self.pixels_of(self.steps_of(pixels)) if kind == "png" else pixels

    def decode(self, data: bytes, kind: str) -> NDArray[Any]:
        """Return the image in a file of some kind, (H, W) or (H, W, components). Raises ValueError."""
        match kind:
            case "exr":
                return decode_exr(data, self.parts or BLENDERS_PARTS[self.components])
            case "npy":
                return decode_npy(data)
            case _:
                return self.pixels_of(decode_steps(data))

    def convention_in(self, kind: str) -> str:
        """Return what its files hold, of some kind."""
        as_it_is = kind in ("exr", "npy") and "png" in self.kinds
        return f"{self.meaning}; {self.dtype}, not in steps" if as_it_is else self.convention

    def pixel_bytes(self, written: ImageFormat) -> PixelBytes:
        """Return how large its files are."""
        whole = self.components * np.dtype(self.dtype).itemsize
        kind = self.suffix(written)
        usual = self.bytes_per_pixel if kind == self.kinds[0] else whole * (1.0 if kind == "npy" else ZIPPED)
        bounds = (whole, whole) if kind == "npy" else (0.1 * usual, min(3 * usual, whole))
        return PixelBytes(usual, usual, bounds, bounds, bounds)

    def lost(self, pixels: NDArray[Any], written: ImageFormat) -> OutOfRange | None:
        """Return what of an image its file cannot hold; None where it holds all."""
        del pixels, written
        return None

    def describe_files(self, depth_scale_per_m: float, kind: str) -> str:
        """Return what its files hold, in a few words, for the description of a packed dataset."""
        del depth_scale_per_m
        return f"{self.spoken} as {FILE_KINDS[kind]}; {self.convention_in(kind)}"


# Channels that lead from a frame to the next one of its sequence.


@dataclass(frozen=True, eq=False)
class View:
    """What the colour camera sees of a clean frame.

    depth_m: (H, W) float32, planar depth of the pixels' centres in metres, 0 = void. c2w: (4, 4) float64,
    camera-to-world, OpenCV axes, metres. to_other_px: (H, W, 2) float32, how far what each pixel sees is from it in the
    pair's other view, x and y; None where nothing moves but the camera, so that depth and poses tell it.
    """

    depth_m: NDArray[np.float32]
    c2w: NDArray[np.float64]
    camera: Intrinsics
    to_other_px: NDArray[np.float32] | None = None


class PairChannel(Channel):
    """A channel that is computed from what the colour camera sees at a frame and at the sequence's next one.

    Both are clean: what perturbs depth does not change it, and what moves the camera does. The last frame of a sequence
    has no next one: of it nothing is known.
    """

    pairs = True
    kinds = ("exr", "npy")

    @abstractmethod
    def of_views(self, here: View, there: View) -> NDArray[Any]:
        """Return its image, of `dtype` and `components`."""

    @abstractmethod
    def of_last(self, camera: Intrinsics) -> NDArray[Any]:
        """Return its image where nothing comes after."""


# Channels that tell of the surface which a pixel's centre sees: whatever renders it says the same of it.


Fact: TypeAlias = Literal["normals", "faces", "objects"]
"""What a renderer can tell of a surface: its direction, which face of the mesh it is, or the number of its object."""


@dataclass(frozen=True)
class Surface:
    """What the centres of a frame's pixels see of a mesh or a scene, through the colour camera.

    normals: (H, W, 3) float32, of unit length, on the side that is seen, in OpenCV camera axes, zero where nothing is
    seen: of a mesh those of the face itself, of a scene in Blender as its materials shade it. faces: (H, W) int32,
    which face of the mesh; -1 where nothing is seen. objects: (H, W) uint16, the number of the object; 0 where nothing
    is seen, or of no known one. Each is None where no channel asked for it.
    """

    normals: NDArray[np.float32] | None = None
    faces: NDArray[np.int32] | None = None
    objects: NDArray[np.uint16] | None = None


class SurfaceChannel(Channel):
    """A channel that is computed from what a frame sees of a mesh or a scene, by any engine that can tell it.

    needs: what it is computed from. has_content: whether its values have meanings of each scene's own. It is written as
    PNG of 16 bits unless a preset asks for another kind, and never perturbed.
    """

    needs: ClassVar[frozenset[Fact]]
    has_content: ClassVar[bool] = False
    kinds: ClassVar[tuple[FileKind, ...]] = ("png", "exr", "npy")

    def problem(self, mesh: str) -> str:
        """Return why a mesh cannot give it, or ""; nothing but its file's head is read. mesh: as a scene names it."""
        del mesh
        return ""

    def problem_of(self, objects: Callable[[], Sequence[SceneObject]]) -> str:
        """Return why a scene in Blender cannot give it, or "". objects: returns those that it has."""
        del objects
        return ""

    def files(self, mesh: str) -> tuple[Path, ...]:
        """Return the files beside a mesh's that decide what `content` says."""
        del mesh
        return ()

    def content(self, mesh: Mesh, path: str) -> dict[str, Any]:
        """Return what its values mean in this scene, for a file NAME.json of each sequence, if it has such.

        path: of the mesh, as a scene names it. Raises InputError where a file beside it is damaged.
        """
        del mesh, path
        return {}

    def content_of(self, objects: Sequence[SceneObject]) -> dict[str, Any]:
        """Return the same for a scene in Blender with some objects."""
        del objects
        return {}

    @abstractmethod
    def of_mesh(self, mesh: Mesh | None) -> Callable[[Surface], NDArray[Any]]:
        """Return what makes its image, of `dtype` and `components`, of what a frame sees of a mesh.

        mesh: None for a scene in Blender, which has normals and objects, and no faces.

        What it keeps of the mesh stays in memory while that is rendered. Raises ValueError, saying why, where the mesh
        cannot give it.
        """

    def of_objects(self, objects: Sequence[SceneObject]) -> Callable[[Surface], NDArray[Any]]:
        """Return the same for a scene in Blender with some objects; by default as `of_mesh` without a mesh."""
        del objects
        return self.of_mesh(None)
