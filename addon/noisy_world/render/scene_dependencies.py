# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a scene of one's own is made of: libraries, images, caches, and what of them cannot be read."""

import importlib
import itertools
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.errors import InputError
from ..core.file_access import check_regular, open_regular, read_bytes, utf8_name
from ..scenes.mesh_formats import is_file
from ..scenes.textures import SizePx, check_size_px, header_size_px

# The size of a picture of any kind that Blender reads, by its header, before Blender takes memory for its pixels.


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


# What no pixel depends on: the tools of a person at work, text, and sound.
IGNORED = (
    bpy.types.Brush,
    bpy.types.Palette,
    bpy.types.PaintCurve,
    bpy.types.Text,
    bpy.types.Sound,
    bpy.types.Screen,
    bpy.types.WorkSpace,
    bpy.types.WindowManager,
)


@dataclass(frozen=True)
class SceneFiles:
    """What a scene is made of.

    blocks: its data-blocks. files: those that are there, sorted. missing: what is not, in words. unfit: what Blender
    would never end reading, or not have the memory for, in words.
    """

    blocks: tuple[bpy.types.ID, ...]
    files: tuple[Path, ...]
    missing: tuple[str, ...]
    unfit: tuple[str, ...] = ()


def files_of(scene: bpy.types.Scene) -> SceneFiles:
    """Find the files of a scene of the open file. What is packed into a .blend is none."""
    blocks = blocks_of(scene)
    paths = bpy.data.file_path_map()
    files: set[Path] = set()
    missing: list[str] = []
    unfit: list[str] = []
    for block in blocks:
        found = sorted(_files_of_block(block, paths.get(block, ())))
        files.update(found)
        missing += [f"{_named(block)} ({path})" for path in found if not (_exists(path) or _is_folder(block, path))]
        unfit += [f"{_named(block)} ({path}: {why})" for path in found if (why := _unfit(block, path))]
        if isinstance(block, bpy.types.Image) and (why := _unfit_pixels(block)):
            unfit.append(f"{_named(block)} ({why})")
        if block.is_missing and block.library is not None and _exists(_absolute(block, block.library.filepath)):
            missing.append(f"{_named(block)}, which {_library_name(block)} does not have")
    files.update(_disk_caches(blocks))
    there = {file for path in files for file in ([path] if is_file(path) else _of_caches(path))}
    return SceneFiles(blocks, tuple(sorted(there)), tuple(dict.fromkeys(missing)), tuple(dict.fromkeys(unfit)))


def blocks_of(scene: bpy.types.Scene) -> tuple[bpy.types.ID, ...]:
    """Return the data-blocks that a scene is made of, itself first, with the libraries that they come from."""
    used_by: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for block, users in bpy.data.user_map().items():
        for user in users:
            used_by.setdefault(user, []).append(block)
    found: dict[bpy.types.ID, None] = {scene: None}
    waiting = [scene]
    while waiting:
        block = waiting.pop()
        used = [*used_by.get(block, ()), *_library_of(block)]
        new = [item for item in used if item not in found and not isinstance(item, IGNORED)]
        # Another scene is part of this one only as its background.
        new = [item for item in new if not isinstance(item, bpy.types.Scene) or item == scene.background_set]
        found |= dict.fromkeys(new)
        waiting += new
    return tuple(sorted(found, key=lambda item: (item != scene, item.id_type, item.name_full)))


def _library_of(block: bpy.types.ID) -> list[bpy.types.ID]:
    if isinstance(block, bpy.types.Library):
        return [] if block.parent is None else [block.parent]
    return [] if block.library is None else [block.library]


def _files_of_block(block: bpy.types.ID, paths: Iterable[str]) -> Iterator[Path]:
    match block:
        case bpy.types.Scene():
            return  # where it would write, and what its sequencer shows
        case bpy.types.Image():
            yield from _image_files(block)
        case bpy.types.Library() if block.packed_file is not None:
            return
        case bpy.types.Volume() | bpy.types.CacheFile():
            path = _absolute(block, block.filepath)
            yield from _numbered_beside(path) if block.is_sequence else [path]
        case _:
            for text in paths:
                if text and text != "<builtin>":
                    yield _absolute(block, text)


def _image_files(image: bpy.types.Image) -> Iterator[Path]:
    if image.source in ("GENERATED", "VIEWER") or len(image.packed_files) or not image.filepath:
        return
    path = _absolute(image, image.filepath)
    if image.source == "TILED":
        assert image.tiles is not None
        for tile in image.tiles:
            column, row = (tile.number - 1001) % 10 + 1, (tile.number - 1001) // 10 + 1
            name = path.name.replace("<UDIM>", str(tile.number)).replace("<UVTILE>", f"u{column}_v{row}")
            yield path.with_name(name)
    elif image.source == "SEQUENCE":
        yield from _numbered_beside(path)
    else:
        yield path


def _numbered_beside(path: Path) -> list[Path]:
    """Return all files of a numbered sequence, by one of them; that one alone where it is not there."""
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", path.name, re.DOTALL)
    if found is None or not _is_dir(path.parent):
        return [path]
    form = re.compile(re.escape(found[1]) + r"\d+" + re.escape(found[3]))
    return sorted(item for item in path.parent.iterdir() if form.fullmatch(item.name)) or [path]


def _absolute(block: bpy.types.ID, text: str) -> Path:
    return Path(bpy.path.abspath(text, library=block.library)).absolute()


def _disk_caches(blocks: Iterable[bpy.types.ID]) -> Iterator[Path]:
    """Yield folders of baked simulations, as far as they are there."""
    for block in blocks:
        if not isinstance(block, bpy.types.Object):
            continue
        for modifier in block.modifiers:
            for text in _cache_folders(modifier):
                if text:
                    yield _absolute(block, text)
    if bpy.data.filepath:  # where Blender puts caches on disk that were given no other place
        path = Path(bpy.data.filepath)
        yield path.with_name(f"blendcache_{path.stem}")


def _cache_folders(modifier: bpy.types.Modifier) -> list[str]:
    if isinstance(modifier, bpy.types.FluidModifier) and modifier.domain_settings is not None:
        return [modifier.domain_settings.cache_directory]
    if isinstance(modifier, bpy.types.NodesModifier):
        return [modifier.bake_directory, *(bake.directory for bake in modifier.bakes if bake.use_custom_path)]
    return []


def _is_folder(block: bpy.types.ID, path: Path) -> bool:
    """Tell whether a path that is not there would be the folder of an object's simulation, which is not baked then."""
    return isinstance(block, bpy.types.Object) and not path.suffix


def _of_caches(folder: Path) -> list[Path]:
    """Return the files of baked simulations in a folder, which may be one that holds all else too, as /tmp does."""
    if not _is_dir(folder):
        return []
    baked = (folder.glob(pattern) for pattern in _CACHES)
    fluids = ((folder / name).rglob("*") for name in _OF_FLUIDS)
    return [item for item in itertools.chain(*baked, *fluids) if item.is_file()]


# Point caches; bakes of an ocean; bakes of geometry nodes, in a folder of their own or below that of their modifier.
_CACHES = (
    *(f"{name}_*.exr" for name in ("disp", "foam", "normal", "spray", "spray_inverse")),
    "*.bphys",
    "*.bobj.gz",
    "meta/*",
    "blobs/*",
    "*/meta/*",
    "*/blobs/*",
    "*/*/meta/*",
    "*/*/blobs/*",
)
_OF_FLUIDS = ("config", "data", "guiding", "mesh", "noise", "particles", "script")


def _exists(path: Path) -> bool:
    return os.path.exists(path)  # noqa: PTH110 - Path.exists raises for a name that no file can have


def _is_dir(path: Path) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 - as for _exists


def _unfit(block: bpy.types.ID, path: Path) -> str:
    """Return why Blender is not to read a file that is there; "" where it may."""
    if not _exists(path) or (isinstance(block, bpy.types.Object) and _is_dir(path)):
        return ""
    try:
        check_regular(path)
        if isinstance(block, bpy.types.Image) and block.source != "MOVIE":
            check_size_px("", picture_size_px(path) or (0, 0))
    except OSError as error:
        return error.strerror or str(error)
    except InputError as error:
        return error.problem
    return ""


def _unfit_pixels(image: bpy.types.Image) -> str:
    """Return why Blender is not to have the pixels of an image that is in no file of its own; "" where it may."""
    try:
        for packed in image.packed_files:
            if packed.packed_file is not None:
                check_size_px("", _packed_size_px(bytes(packed.packed_file.data)))
        if image.source == "GENERATED":
            check_size_px("", (image.generated_width, image.generated_height))
    except InputError as error:
        return error.problem
    return ""


def _packed_size_px(data: bytes) -> tuple[int, int]:
    try:
        return header_size_px(data) or (0, 0)
    except ValueError:
        return 0, 0  # damaged, and shown as Blender shows it


def _named(block: bpy.types.ID) -> str:
    return f"{block.id_type.replace('_', ' ').capitalize()} {block.name}"


def _library_name(block: bpy.types.ID) -> str:
    return "its library" if block.library is None else block.library.filepath
