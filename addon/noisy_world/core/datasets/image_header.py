# SPDX-License-Identifier: GPL-3.0-or-later
"""What the header of an image's file says, before anything is decoded."""

from dataclasses import dataclass
from typing import BinaryIO, Literal

# Chosen: twice the pixels of 8K video. In float a colour image of as many is 0.8 GB, and a run holds some of them.
LARGEST_PIXELS = 2**26
LARGEST_SIDE_PX = 2**15 - 1  # SHRT_MAX, up to which OpenCV's remap takes images

UPRIGHT = 1  # of Exif's orientation: the first row is the top, the first column the left
_ORIENTATION_TAG, _SHORT = 0x0112, 3  # Exif 2.32, table 4; type 3 is an unsigned number of 16 bits


class UnfitImageError(ValueError):
    """An image that cannot be used as it is meant: what it is, as a sentence's end, and the remedy."""

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(problem)


class DamagedImageError(UnfitImageError):
    """The file of an image that is not whole. what: shows it."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(f"is damaged: {what}", "copy it again")


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What a PNG, a JPEG or an EXR of light says of itself.

    channels: 1 grey, 3 colour, 4 CMYK; without alpha, those of the palette's colours where it has one. bits: of a
    value. alpha: whether pixels may be transparent. orientation: Exif's, 1 to 8. sequential: of a JPEG, that it holds
    one scan of all channels. sampling: of a JPEG, the horizontal and vertical factors of each channel.
    """

    kind: Literal["png", "jpg", "exr"]
    width_px: int
    height_px: int
    channels: int
    bits: int
    alpha: bool = False
    palette: bool = False
    orientation: int = UPRIGHT
    sequential: bool = True
    sampling: tuple[tuple[int, int], ...] = ()

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width_px, self.height_px

    @property
    def description(self) -> str:
        """What it is, in words."""
        colours = {1: "grey", 3: "colour", 4: "CMYK"}[self.channels]
        if self.kind == "exr":
            return "an EXR of scene-linear light"
        name = "JPEG" if self.kind == "jpg" else "PNG"
        return f"a {name} of {self.bits}-bit {colours}{' with alpha' if self.alpha else ''}"

    @property
    def plainly(self) -> Literal["rgb", "grey"] | None:
        """What its bytes are, where every reader sees the same: 8-bit RGB or 8-bit grey; None for all else."""
        if self.bits != 8 or self.alpha or self.palette or self.channels == 4:
            return None
        return "grey" if self.channels == 1 else "rgb"


def check_size(width_px: int, height_px: int) -> None:
    """Raise UnfitImageError for a size that no image has, and for one beyond the limits."""
    if not width_px or not height_px:
        raise DamagedImageError(f"it says {width_px} x {height_px} pixels")
    if width_px * height_px > LARGEST_PIXELS or max(width_px, height_px) > LARGEST_SIDE_PX:
        most = f"at most {LARGEST_PIXELS} pixels are read, and {LARGEST_SIDE_PX} a side"
        raise UnfitImageError(f"says that it is {width_px} x {height_px} pixels; {most}")


def exif_orientation(tiff: bytes) -> int:
    """Return the orientation in Exif data, 1 to 8; 1 where none is said.

    The data are a TIFF: byte order (2), 42 (2), where the first directory is (4); it has a count (2), and for each
    entry tag (2), type (2), count (4) and value (4). Data that are no such thing say nothing, as for all viewers.
    """
    order: Literal["little", "big"] = "little" if tiff[:2] == b"II" else "big"
    if tiff[:2] not in (b"II", b"MM") or len(tiff) < 8:
        return UPRIGHT
    at = int.from_bytes(tiff[4:8], order)
    for entry in range(int.from_bytes(tiff[at : at + 2], order)):
        start = at + 2 + 12 * entry
        row = tiff[start : start + 12]
        if len(row) < 12:
            return UPRIGHT
        if int.from_bytes(row[:2], order) == _ORIENTATION_TAG and int.from_bytes(row[2:4], order) == _SHORT:
            value = int.from_bytes(row[8:10], order)
            return value if 1 <= value <= 8 else UPRIGHT
    return UPRIGHT


def read_exactly(stream: BinaryIO, count: int) -> bytes:
    """Return bytes of a stream. Raises DamagedImageError where it ends before."""
    data = stream.read(count)
    if len(data) < count:
        raise DamagedImageError("it is cut short")
    return data
