# SPDX-License-Identifier: GPL-3.0-or-later
"""Image files: their headers, and a check that a file is complete and undamaged.

Decoders fill in what is lost, and take a length or a size that is wrong at its word; so files are looked at before.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InputError
from ..core.file_access import NotRegularError, TooLargeError, open_regular
from . import image_header, jpeg_files
from .array_files import array_header
from .image_header import UPRIGHT, DamagedImageError, ImageHeader, UnfitImageError, check_size
from .pixels import EXR_SIGNATURE, exr_channels

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
            jpeg_files.check_ends(data)
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
        jpeg_files.check_scans(header, data)


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
    kinds = {image_header.SIGNATURE: "png", jpeg_files.SIGNATURE: "jpg", EXR_SIGNATURE: "exr"}
    return next((kind for signature, kind in kinds.items() if start.startswith(signature)), None)


def _header(file: BinaryIO) -> ImageHeader:
    start = file.read(len(image_header.SIGNATURE))
    if not start:
        raise DamagedImageError("it is empty")
    kind = _kind(start)
    file.seek(0)
    if kind is None:
        return array_header(file.read())
    if kind == "exr":
        return _exr_header(file.read())
    header = image_header.png_header(file) if kind == "png" else jpeg_files.jpeg_header(file)
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
