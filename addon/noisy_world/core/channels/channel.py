# SPDX-License-Identifier: GPL-3.0-or-later
"""What a channel is: one kind of image that a camera gives for a frame, such as colour or depth."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..datasets.depth_range import OutOfRange
    from ..datasets.layouts.layout import Layout, OutputFormat
    from ..trajectories.stamps import FrameStamps

type KindOfSteps = Literal["rgb", "depth"]
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
    def suffix(self, written: "OutputFormat") -> str:
        """Return how the names of its files end, such as "png"."""

    @abstractmethod
    def suffix_told(self, output: dict[str, Any]) -> str:
        """Return the same by what the identity of a dataset says of its output."""

    @abstractmethod
    def name_in(self, layout: "Layout", frame: int, stamps: "FrameStamps", suffix: str) -> str:
        """Return the name of a frame's file inside its sequence's folder."""

    @abstractmethod
    def encode(self, pixels: NDArray[Any], written: "OutputFormat") -> bytes:
        """Return its image, (H, W) or (H, W, components), as a file of the dataset."""

    @abstractmethod
    def pixel_bytes(self, written: "OutputFormat") -> PixelBytes:
        """Return how large its files are."""

    def lost(self, pixels: NDArray[Any], written: "OutputFormat") -> "OutOfRange | None":
        """Return what of an image its file cannot hold; None where it holds all."""
        del pixels, written
        return None

    def told(self, depth_scale_per_m: float) -> str:
        """Return what its files hold, in a few words, for the description of a packed dataset."""
        del depth_scale_per_m
        return self.spoken
