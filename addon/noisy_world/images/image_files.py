# SPDX-License-Identifier: GPL-3.0-or-later
"""Image files: whether one is undamaged, and reading its pixels; damage that can be detected is refused.

Image files: their headers, and a check that a file is complete and undamaged.

Decoders fill in what is lost, and take a length or a size that is wrong at its word; so files are looked at before.
"""

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InputError
from ..core.file_access import NotRegularError, TooLargeError, open_regular, read_bytes
from . import image_header
from .array_files import array_header, array_values
from .image_header import UPRIGHT, DamagedImageError, ImageHeader, UnfitImageError, check_size, decode_strictly
from .pixels import EXR_SIGNATURE, UINT16_MAX, decode_light, decode_png, exr_channels

LARGEST_FILE_BYTES = 2**30  # chosen: an image within the limits of its size that cannot be compressed has half of it

_HEADER_BYTES = 1024  # read at once: a header without Exif data takes as many at most
_GONE = "is not there or no image"


@dataclass(frozen=True)
class WholeFile:
    """A file that is whole, and its SHA-256."""

    path: Path
    sha256: str


def damage(data: bytes) -> str:
    """Return what shows that a PNG or JPEG is damaged, "" where nothing does, and for files of other kinds.

    PNG: every part lies in the file and has its checksum, up to the end. JPEG: it has an end, and its decoder meets
    nothing wrong; the scans themselves have no checksum.
    """
    try:
        if _kind(data) is not None:
            _check_scans(*whole_image(data))
    except DamagedImageError as error:
        return error.what
    except UnfitImageError:
        return ""
    return ""


def whole_image(data: bytes, *, sums: bool = True) -> tuple[ImageHeader, bytes]:
    """Return the header of a PNG, a JPEG or an EXR of light, and what of its file decides its pixels.

    sums: check the sums of a PNG's parts. The scans of a JPEG are looked at where they are decoded. Raises
    DamagedImageError where it is not whole, and UnfitImageError where it
    cannot be used as it is meant: another kind of file, an animation, a size beyond the limits, an orientation.
    """
    if _kind(data) == "exr":  # its pixels have no sums: digests tell of damage
        return _header(io.BytesIO(data)), data
    if _kind(data) != "png":
        header = _header(io.BytesIO(data))
        if header.kind == "jpg":
            image_header.check_ends(data)
        return header, data
    whole = image_header.whole_png(data, sums=sums)  # before the header is believed
    header = _header(io.BytesIO(data))
    if len(whole) != len(data):  # Exif data may follow the pixels
        _check_upright(image_header.png_orientation(data))
    return header, whole


def read_header(path: Path) -> ImageHeader:
    """Return the header of the image in a file, of which no more is read. Raises InputError."""
    try:
        with _opened(path) as file:
            return _header(file)
    except OSError as error:
        raise InputError(path, _GONE) from error
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


def read_whole(path: Path, sha256: str | None = None) -> tuple[ImageHeader, bytes]:
    """Return the header of the image in a file, and what of its content decides its pixels, to be decoded.

    sha256: of the file when it was written, if that is known. Raises InputError where it is not whole, or another.
    """
    data = _content(path)
    return _checked(path, data, sha256, "" if sha256 is None else sha256_of_bytes(data))


def check_whole(path: Path, sha256: str | None = None) -> tuple[ImageHeader, str]:
    """Return the header of the image in a file, and the SHA-256 of the file; raises InputError as `read_whole`."""
    data = _content(path)
    digest = sha256_of_bytes(data)
    header, whole = _checked(path, data, sha256, digest)
    if digest != sha256:
        try:
            _check_scans(header, whole)
        except DamagedImageError as error:
            raise InputError(path, error.problem, remedy=error.remedy) from None
    return header, digest


def _check_scans(header: ImageHeader, data: bytes) -> None:
    if header.kind == "jpg":
        image_header.check_scans(header, data)


def _content(path: Path) -> bytes:
    try:
        with _opened(path, buffering=0) as file:
            return file.read()
    except OSError as error:
        raise InputError(path, _GONE) from error


def _checked(path: Path, data: bytes, sha256: str | None, digest: str) -> tuple[ImageHeader, bytes]:
    """Return what `whole_image` does of a file. sha256: that it has to have, if that is known. digest: that it has."""
    try:
        found = whole_image(data, sums=digest != sha256)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None
    if sha256 not in (None, digest):
        raise InputError(path, "is not as it was written: frames.jsonl has another SHA-256 for it", remedy=_CHANGED)
    return found


_CHANGED = "copy it again; if it was changed on purpose, take the keys sha256 out of frames.jsonl"


def _opened(path: Path, buffering: int = _HEADER_BYTES) -> BinaryIO:
    """Open a file. Raises OSError where there is none, and InputError for a pipe, a device and a file too large."""
    try:
        return open_regular(path, largest_bytes=LARGEST_FILE_BYTES, buffering=buffering)
    except (NotRegularError, TooLargeError) as error:
        raise InputError(path, str(error)) from None


def _kind(start: bytes) -> str | None:
    kinds = {image_header.PNG_SIGNATURE: "png", image_header.JPEG_SIGNATURE: "jpg", EXR_SIGNATURE: "exr"}
    return next((kind for signature, kind in kinds.items() if start.startswith(signature)), None)


def _header(file: BinaryIO) -> ImageHeader:
    start = file.read(len(image_header.PNG_SIGNATURE))
    if not start:
        raise DamagedImageError("it is empty")
    kind = _kind(start)
    file.seek(0)
    if kind is None:
        return array_header(file.read())
    if kind == "exr":
        return _exr_header(file.read())
    header = image_header.png_header(file) if kind == "png" else image_header.jpeg_header(file)
    _check_upright(header.orientation)
    return header


def _exr_header(data: bytes) -> ImageHeader:
    try:
        size_px, names = exr_channels(data)
    except ValueError as error:
        raise UnfitImageError(str(error), "convert it to PNG") from None
    check_size(*size_px)
    if names == ["B", "G", "R"]:
        return ImageHeader("exr", *size_px, channels=3, bits=16)
    if len(names) > 1:
        raise UnfitImageError(f"is an EXR of the channels {', '.join(names)[:60]}", "write it with one, or R, G and B")
    return ImageHeader("array", *size_px, channels=1, bits=32, floating=True)


def _check_upright(orientation: int) -> None:
    if orientation != UPRIGHT:
        problem = f"has the Exif orientation {orientation}: viewers turn it, away from its intrinsics, poses and depth"
        raise UnfitImageError(problem, "turn its pixels as they belong to these, and remove the tag")


# Reading the pixels of image files; damage that can be detected is refused.


_ONE_SIZE = "a sequence has one size"
_STEPS = range(UINT16_MAX + 1)


# --- files ---


def read_colour(
    path: Path, size_px: tuple[int, int], sha256: str | None = None
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return the colour (H, W, 3) of a file, RGB, sRGB-encoded: uint8, or float32 in [0, 1] where it has 16 bits.

    Grey is in three equal channels. sha256: of the file when it was written, if that is known. Raises InputError where
    the file is damaged, of another size, or no colour image.
    """
    header, data = read_whole(path, sha256)
    check_colour(path, header)
    check_size_px(path, header, size_px)
    try:
        return decoded_colour(header, data)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


def read_light(path: Path, size_px: tuple[int, int], sha256: str | None = None) -> NDArray[np.float32]:
    """Return the scene-linear light (H, W, 3) of an EXR of a dataset. Raises InputError where it is damaged."""
    header, data = read_whole(path, sha256)
    check_size_px(path, header, size_px)
    try:
        return decode_light(data)
    except ValueError as error:
        raise InputError(path, str(error)) from error


def read_steps(path: Path, size_px: tuple[int, int], sha256: str | None = None) -> NDArray[Any]:
    """Return the values (H, W) of a depth image as they are stored: uint16 of a PNG, else numbers of any type.

    Raises InputError where it is damaged, has another size, or is no depth.
    """
    header, data = read_whole(path, sha256)
    check_depth(path, header)
    check_size_px(path, header, size_px)
    try:
        if header.kind != "png":
            return array_values(data)
        pixels = decode_png(data)
        return np.asarray(_decoded(data, _unchanged(), header, np.uint16) if pixels is None else pixels, np.uint16)
    except UnfitImageError as error:
        raise InputError(path, error.problem, remedy=error.remedy) from None


def metres(values: NDArray[Any], scale_per_m: float, void: Sequence[float] = ()) -> NDArray[np.float32]:
    """Return the planar depth (H, W) in metres, 0 = void, of values as a depth image stores them.

    void: values that say that nothing was measured, beside 0, what is below it and what is not finite.
    """
    if values.dtype == np.uint16:
        depth_m = (values / np.float64(scale_per_m)).astype(np.float32)
        if void:
            depth_m[np.isin(values, [value for value in void if value in _STEPS])] = 0
        return depth_m
    known = np.isfinite(values) & (values > 0)
    if void:
        known &= ~np.isin(values, np.asarray(void, values.dtype))
    with np.errstate(over="ignore"):
        depth_m = (np.where(known, values, 0) / np.float64(scale_per_m)).astype(np.float32)
    depth_m[~np.isfinite(depth_m)] = 0
    return depth_m


def read_pixels(path: Path, mode: int) -> NDArray[Any] | None:
    """Return the pixels of a file that this program wrote, as OpenCV decodes them; None where it is no image.

    mode: one of cv2.IMREAD_*. Raises OSError where the file cannot be read.
    """
    import cv2

    data = read_bytes(path, largest_bytes=LARGEST_FILE_BYTES)
    return cv2.imdecode(np.frombuffer(data, np.uint8), mode) if data else None


# --- what headers say ---


def check_colour(path: Path, header: ImageHeader) -> None:
    """Raise InputError where an image is no colour as it is meant here."""
    if header.kind == "array" or header.floating:
        raise InputError(path, f"is {header.description}, but colour has to be 8-bit grey, or RGB")
    if header.kind == "exr":
        problem = f"is {header.description}, but colour has to be as it is shown on a display"
        raise InputError(path, problem, remedy="make the dataset with output.image: png, or convert it to PNG")
    if header.channels == 1 and header.bits == 16:
        problem = f"is {header.description}, as depth and thermal images are, but colour has to be 8-bit grey, or RGB"
        raise InputError(path, problem, remedy="write it with 8 bits, as it is to be seen")


def check_depth(path: Path, header: ImageHeader) -> None:
    """Raise InputError where an image is no depth: one channel of 16 bits or more, in a PNG, TIFF, EXR, NPY or NPZ."""
    if header.kind == "exr" or (header.channels == 1 and not header.alpha and header.bits >= 16):
        return
    problem = f"is {header.description}, but depth has to be a PNG of 16-bit grey"
    raise InputError(path, problem, remedy="or floating point or 16 bits in a TIFF, EXR, NPY or NPZ")


def check_named_png(path: Path, header: ImageHeader) -> None:
    """Raise InputError where a depth image that its name says to be a PNG is something else."""
    if header.kind != "png":
        raise InputError(path, f"is {header.description}, but its name says PNG", remedy="give it its own suffix")


def check_size_px(path: Path, header: ImageHeader, wanted: tuple[int, int], own: bool = False) -> None:
    """Raise InputError where an image has another size than the first colour image of its sequence.

    own: it is depth of a camera of its own, which has that size.
    """
    if header.size_px != wanted:
        whose = "its camera has" if own else "the first colour image is"
        depth = (header.bits, header.channels) == (16, 1)
        remedy = "take the images that belong to it" if own else _ONE_SIZE + "; register depth to colour" * depth
        raise InputError(path, f"is {spoken(header.size_px)} pixels, but {whose} {spoken(wanted)}", remedy=remedy)


def spoken(size_px: tuple[int, int]) -> str:
    """Return a size in words."""
    return f"{size_px[0]} x {size_px[1]}"


# --- pixels ---


def decoded_colour(header: ImageHeader, data: bytes) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Return the colour (H, W, 3) of a whole image, as `read_colour`. data: what of the file decides its pixels.

    Raises DamagedImageError, and UnfitImageError for pixels that are transparent.
    """
    import cv2

    if header.kind == "jpg" and (pixels := decode_strictly(header, data)) is not None:
        return pixels
    if header.kind == "png" and (header.bits, header.channels) == (8, 3) and (made := decode_png(data)) is not None:
        return np.asarray(made, np.uint8)
    if header.bits <= 8 and not header.alpha:
        plain = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        return np.asarray(_decoded(data, plain, header, np.uint8), np.uint8)
    dtype = np.uint16 if header.bits == 16 else np.uint8
    pixels = _decoded(data, _unchanged(), header, dtype)
    # OpenCV leaves a grey that is transparent out, where that is one value and no channel.
    if header.alpha and (pixels.ndim == 2 or pixels.shape[2] < 4 or pixels[..., 3].min() < np.iinfo(dtype).max):
        raise UnfitImageError("has transparent pixels, of which nothing says the colour", "lay it over a background")
    rgb = np.ascontiguousarray(pixels[..., 2::-1])
    return rgb if dtype == np.uint8 else np.divide(rgb, np.float32(UINT16_MAX), dtype=np.float32)


def _unchanged() -> int:
    import cv2

    return cv2.IMREAD_UNCHANGED


def _decoded(data: bytes, mode: int, header: ImageHeader, dtype: type) -> NDArray[Any]:
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise DamagedImageError("it cannot be decoded")
    expected = (header.height_px, header.width_px)
    if pixels.dtype != dtype or pixels.shape[:2] != expected:
        raise DamagedImageError(f"it says {header.description} of {spoken(header.size_px)}, and holds {pixels.shape}")
    return pixels


# A folder of depth images for the frames of a video: one each, in the order of their numbers.


SizePx: TypeAlias = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True)
class DepthFolder:
    """Depth images, the i-th of which belongs to frame i. scale_per_m: steps per metre. size_px: of each."""

    folder: Path
    files: tuple[Path, ...]
    scale_per_m: float
    size_px: SizePx

    def depth_m(self, index: int) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres, 0 = void. Raises InputError where the file is damaged."""
        return metres(read_steps(self.files[index], self.size_px), self.scale_per_m)

    def whole_file(self, index: int) -> WholeFile:
        """Return the file of a depth image that is used as it is. Raises InputError where it is damaged."""
        header, digest = check_whole(self.files[index])
        _check_size_px(self.files[index], header.size_px, self.size_px)
        return WholeFile(self.files[index], digest)


def read_depth_folder(folder: Path, scale_per_m: float, video: Path, count: int, size_px: SizePx) -> DepthFolder:
    """Find the depth images of a video's frames, PNG files with a number in their names; their headers are checked.

    video, count, size_px: the video, its frames and their size. Raises InputError where the images are not as many, of
    another size, no 16-bit grey, or not in one order.
    """
    found: dict[int, Path] = {}
    for path in _png_files(folder):
        number = _number(path)
        if (same := found.setdefault(number, path)) != path:
            raise InputError(folder, f"{same.name} and {path.name} have one number", remedy="keep one of them")
    if len(found) != count:
        problem = f"holds {len(found)} depth images, but {video.name} has {count} frames"
        raise InputError(folder, problem, remedy="a 16-bit PNG for each frame, in the order of their numbers")
    files = tuple(found[number] for number in sorted(found))
    for path in files:
        header = read_header(path)
        check_named_png(path, header)
        check_depth(path, header)
        _check_size_px(path, header.size_px, size_px)
    return DepthFolder(folder, files, scale_per_m, size_px)


def _png_files(folder: Path) -> Iterator[Path]:
    try:
        yield from sorted(path for path in folder.iterdir() if path.suffix.lower() == ".png")
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None


def _number(path: Path) -> int:
    """Return the last number in a file's name, before its suffix."""
    found = re.search(r"([0-9]{1,30})[^0-9]*$", path.stem, re.ASCII)
    if found is None:
        raise InputError(path, "has no number in its name", remedy="name depth images by their frames: 000000.png")
    return int(found[1])


def _check_size_px(path: Path, size_px: SizePx, wanted: SizePx) -> None:
    if size_px != wanted:
        problem = f"is {spoken(size_px)} pixels, but the video's frames are {spoken(wanted)}"
        raise InputError(path, problem, remedy="register depth to colour")
