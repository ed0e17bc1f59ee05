# SPDX-License-Identifier: GPL-3.0-or-later
"""The image files of imported materials, unchanged, so that they are read like any texture."""

import contextlib
from pathlib import Path

import bpy

from ...core.errors import InputError
from ...core.regular_files import read_bytes
from ...core.scenes.beside import is_file, is_inside
from ...core.scenes.imported import ImportedImage
from ...core.scenes.picture_size import check_size_px, header_size_px
from ...core.utf8_names import utf8_name
from ..picture_headers import size_by_library


class UnusablePictureError(Exception):
    """An image that cannot be used: missing, outside the mesh's folder, too large; the message says so."""


def image_name(image: bpy.types.Image) -> str:
    """Return what an image is called in messages: its file's name."""
    return Path(image.filepath.replace("\\", "/")).name or image.name


def located(mesh_folder: Path, image: bpy.types.Image) -> Path:
    """Return where the file of an image lies that is not packed: as it is named, or beside the mesh, never elsewhere.

    Raises UnfitImageError.
    """
    path = Path(bpy.path.abspath(image.filepath))
    if is_inside(mesh_folder, path):
        if not is_file(path):
            raise UnusablePictureError(f"its texture {(image.filepath or image.name)[:200]!r} is missing")
        return path
    beside = mesh_folder / image_name(image)
    if is_file(beside):
        return beside
    problem = f"its texture {image.filepath[:200]!r} leads out of the mesh's folder"
    raise UnusablePictureError(f"{problem}; put it beside the mesh, and name it so")


def check_image(mesh_folder: Path, image: bpy.types.Image, scratch: Path) -> bytes:
    """Return the bytes of an image's file, which is not too large to be decoded. Raises UnfitImageError.

    scratch: a file that may be written.
    """
    data = _data(image, None if image.packed_file is not None else located(mesh_folder, image))
    try:
        try:
            size_px = header_size_px(data)
        except ValueError:
            return data  # which its reader refuses
        if size_px is None:
            scratch.write_bytes(data)
            size_px = size_by_library(scratch)
        check_size_px("", size_px or (0, 0))
    except InputError as error:
        said = f"its texture {image_name(image)[:200]!r} {error.problem}; {error.remedy}"
        raise UnusablePictureError(said) from error
    return data


def _data(image: bpy.types.Image, path: Path | None) -> bytes:
    if path is None:
        assert image.packed_file is not None
        return bytes(image.packed_file.data)
    try:
        return read_bytes(path)
    except OSError as error:
        raise UnusablePictureError(
            f"its texture {image_name(image)[:200]!r} cannot be read: {error.strerror}"
        ) from error


class ImageFiles:
    """The images, numbered as they are asked for, with their files in a folder."""

    def __init__(self, folder: Path, mesh_folder: Path) -> None:
        """Begin without any. folder: where their files are written. mesh_folder: where they may lie."""
        self._folder = folder
        self._mesh_folder = mesh_folder
        self.notes: list[str] = []
        self._numbers: dict[str, int] = {}
        self.images: list[ImportedImage] = []

    def number_of(self, image: bpy.types.Image) -> int:
        """Return an image's number; its file is written when it is asked for first. Raises UnfitImageError."""
        if image.name not in self._numbers:
            self._numbers[image.name] = len(self.images)
            self.images.append(self._write(image, len(self.images)))
        return self._numbers[image.name]

    def _write(self, image: bpy.types.Image, number: int) -> ImportedImage:
        file = self._folder / f"image{number}"
        data = check_image(self._mesh_folder, image, file)
        if image.packed_file is None:
            self._note_place(image)
        space = image.colorspace_settings
        linear = space is not None and space.name in ("Non-Color", "Linear Rec.709")
        if _read_by_us(data):
            file.write_bytes(data)
        else:  # Blender knows more formats than OpenCV; the pixels stay as they are
            file.unlink(missing_ok=True)
            if image.file_format != "PNG":  # to ask has it decoded
                image.file_format = "PNG"
            with contextlib.suppress(RuntimeError):
                image.save(filepath=utf8_name(file), save_copy=True)
            if not file.is_file():
                file.write_bytes(data)  # which then says what is wrong
        return ImportedImage(image_name(image), file.name, linear)

    def _note_place(self, image: bpy.types.Image) -> None:
        named, path = bpy.path.abspath(image.filepath), located(self._mesh_folder, image)
        if Path(named) != path:
            self.notes.append(f"its texture is named {named[:200]!r}: {path.name} beside the mesh was taken")
            image.filepath = utf8_name(path)
            image.reload()


def _read_by_us(data: bytes) -> bool:
    with contextlib.suppress(ValueError):
        return header_size_px(data) is not None
    return True  # damaged, which its reader says
