# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the images that imported materials show: as they are, so that they are read as any texture's."""

import contextlib
from pathlib import Path

import bpy

from ...core.regular_files import read_bytes
from ...core.scenes.imported import ImportedImage

_READ_BY_US = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")


class MissingImageError(Exception):
    """An image is not where the file says; the message is its name."""


class ImageFiles:
    """The images, numbered as they are asked for, with their files in a folder."""

    def __init__(self, folder: Path) -> None:
        """Begin without any."""
        self._folder = folder
        self._numbers: dict[str, int] = {}
        self.images: list[ImportedImage] = []
        self._read: set[str] = set()

    @property
    def read(self) -> tuple[str, ...]:
        """The files that were read, sorted; those inside other files are none."""
        return tuple(sorted(self._read))

    def number_of(self, image: bpy.types.Image) -> int:
        """Return an image's number; its file is written when it is asked for first. Raises MissingImageError."""
        if image.name not in self._numbers:
            self._numbers[image.name] = len(self.images)
            self.images.append(self._write(image, len(self.images)))
        return self._numbers[image.name]

    def _write(self, image: bpy.types.Image, number: int) -> ImportedImage:
        data = self._data(image)
        space = image.colorspace_settings
        linear = space is not None and space.name in ("Non-Color", "Linear Rec.709")
        file = self._folder / f"image{number}"
        if image.file_format in _READ_BY_US:
            file.write_bytes(data)
        else:  # Blender knows more formats than OpenCV; the pixels stay as they are
            image.file_format = "PNG"
            with contextlib.suppress(RuntimeError):
                image.save(filepath=str(file), save_copy=True)
            if not file.is_file():
                file.write_bytes(data)  # which then says what is wrong
        return ImportedImage(_name(image), file.name, linear)

    def _data(self, image: bpy.types.Image) -> bytes:
        if image.packed_file is not None:
            return bytes(image.packed_file.data)
        path = Path(bpy.path.abspath(image.filepath))
        try:
            data = read_bytes(path)
        except OSError as error:
            raise MissingImageError(image.filepath or image.name) from error
        self._read.add(str(path))
        return data


def _name(image: bpy.types.Image) -> str:
    return Path(image.filepath.replace("\\", "/")).name or image.name
