# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of a picture of any kind that Blender reads, by its header, before Blender takes memory for its pixels."""

import importlib
import sys
from pathlib import Path

import bpy

from ..core.regular_files import open_regular, read_bytes
from ..core.scenes.picture_size import SizePx, header_size_px
from ..core.utf8_names import utf8_name

_HEADER_BYTES = 2**16  # of most files; a JPEG's and a TIFF's may be behind more


def picture_size_px(path: Path) -> SizePx | None:
    """Return width and height as the header of a regular file says them; None for what is no picture, or damaged.

    Raises OSError where it cannot be read.
    """
    with open_regular(path) as file:
        start = file.read(_HEADER_BYTES)
    try:
        try:
            found = header_size_px(start)
        except ValueError:
            found = header_size_px(read_bytes(path))
    except ValueError:
        return None
    return size_by_library(path) if found is None else found


def size_by_library(path: Path) -> SizePx | None:
    """Return width and height as OpenImageIO reads them of a file's header; None for what is none to it."""
    add_library_folders()
    try:
        oiio = importlib.import_module("OpenImageIO")
    except ImportError:
        return None
    opened = oiio.ImageInput.open(utf8_name(path))
    if opened is None:
        oiio.geterror()  # otherwise it is printed when the process ends
        return None
    spec = opened.spec()
    opened.close()
    return spec.width, spec.height


def add_library_folders() -> None:
    """Let Python find the libraries that come with Blender: the bpy package leaves their folder out."""
    root = Path(bpy.utils.system_resource("PYTHON"))  # pyright: ignore[reportAttributeAccessIssue]  the stubs lack it
    folders = [str(folder) for folder in sorted(root.glob("[lL]ib/**/site-packages"))]
    sys.path += [folder for folder in folders if folder not in sys.path]
