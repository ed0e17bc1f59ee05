# SPDX-License-Identifier: GPL-3.0-or-later
"""Float images that are handed to Blender, and those that it writes into scratch files, read back as arrays."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import StorageError
from ..core.regular_files import open_regular
from .typed import new_node, use_as_data


def float_image(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    """Add an image of floats without colour management to the file. size_px: width, height."""
    image = bpy.data.images.new(name, *size_px, alpha=False, float_buffer=True)
    use_as_data(image)
    return image


def image_node(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.Node:
    """Add a node that gives an image."""
    node = new_node(tree, bpy.types.CompositorNodeImage)
    node.image = image
    return node


def write_plain_floats(file_format: bpy.types.ImageFormatSettings) -> None:
    """Make Blender write float values as they are, layer by layer, without colour management or compression."""
    file_format.media_type = "MULTI_LAYER_IMAGE"
    file_format.file_format = "OPEN_EXR_MULTILAYER"
    file_format.color_depth = "32"
    file_format.exr_codec = "NONE"
    file_format.use_exr_interleave = True


def read_rows(path: Path, size_px: tuple[int, int], channels: int) -> NDArray[np.float32]:
    """Read an uncompressed float EXR of so many channels as (H, channels, W), the channels in their names' order.

    size_px: width, height. The end of such a file is a row after the other, each with its number and its length before
    it (OpenEXR File Layout, "Regular scan line"), so what stands before needs no reading; it takes a tenth of the time
    that OpenEXR takes. Raises StorageError where the file is not of this form, as one that is cut short.
    """
    width, height = size_px
    row = np.dtype([("number", "<i4"), ("bytes", "<i4"), ("values", "<f4", (channels, width))])
    with open_regular(path) as file:
        before = os.fstat(file.fileno()).st_size - row.itemsize * height
        rows: NDArray[Any] = np.fromfile(file, row, offset=max(before, 0))
    if len(rows) != height or (rows["number"] != np.arange(height)).any() or (rows["bytes"] != row.itemsize - 8).any():
        raise StorageError("Blender's scratch file is cut short or damaged", file=path)
    return rows["values"]


@contextlib.contextmanager
def muted_output() -> Iterator[None]:
    """Hide the lines that Blender and its GL print for each frame.

    They are printed by C code, so the file descriptors are redirected; code that prints meanwhile needs copies of them.
    """
    saved = [(descriptor, os.dup(descriptor)) for descriptor in (1, 2)]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor, _ in saved:
            os.dup2(null, descriptor)
        yield
    finally:
        for descriptor, copy in saved:
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(null)
