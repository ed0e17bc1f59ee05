# SPDX-License-Identifier: GPL-3.0-or-later
"""What a channel is: one kind of image that a camera gives for a frame, such as colour or depth."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

from numpy.typing import NDArray

from ..datasets.depth_range import OutOfRange
from ..trajectories.stamps import FrameStamps

Image: TypeAlias = Literal["jpg", "png"]
"""What colour may be stored as."""


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

    def encode_rgb(self, rgb: NDArray[Any]) -> bytes:
        """Encode colour."""
        ...

    def encode_depth(self, depth_m: NDArray[Any]) -> bytes:
        """Encode depth."""
        ...

    def out_of_range(self, depth_m: NDArray[Any]) -> OutOfRange | None:
        """Count the pixels whose depth an image cannot hold; None where it holds all."""
        ...


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

    name: in presets (`output.modalities`) and in tables. label, meaning: for people. spoken: the word for it in
    messages. dtype, components, unit: of its values in memory. convention: what its files hold, for the manifest.
    steps: which steps of a setting act on it; None for none: its images are always clean. paired: whether it is the
    depth sensor's, which has stamps and poses of its own and which desynchronisation shifts; else it is colour's.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    meaning: ClassVar[str]
    spoken: ClassVar[str]
    dtype: ClassVar[str]
    components: ClassVar[int]
    unit: ClassVar[str]
    convention: ClassVar[str]
    steps: ClassVar[KindOfSteps | None] = None
    paired: ClassVar[bool] = False

    @abstractmethod
    def suffix(self, written: ImageFormat) -> str:
        """Return how the names of its files end, such as "png"."""

    @abstractmethod
    def suffix_told(self, output: dict[str, Any]) -> str:
        """Return the same by what the identity of a dataset says of its output."""

    @abstractmethod
    def name_in(self, layout: ImageNames, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the name of a frame's file inside its sequence's folder."""

    @abstractmethod
    def encode(self, pixels: NDArray[Any], written: ImageFormat) -> bytes:
        """Return its image, (H, W) or (H, W, components), as a file of the dataset."""

    @abstractmethod
    def pixel_bytes(self, written: ImageFormat) -> PixelBytes:
        """Return how large its files are."""

    def lost(self, pixels: NDArray[Any], written: ImageFormat) -> OutOfRange | None:
        """Return what of an image its file cannot hold; None where it holds all."""
        del pixels, written
        return None

    def told(self, depth_scale_per_m: float) -> str:
        """Return what its files hold, in a few words, for the description of a packed dataset."""
        del depth_scale_per_m
        return self.spoken
