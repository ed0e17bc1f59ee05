# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a USD file refers to, found by Pixar's library, which comes with Blender."""

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path

from ...core.scenes.beside import check_no_pipe, is_inside, leads_out
from ...core.scenes.turning import Up
from ...core.utf8_names import utf8_name
from ..picture_headers import add_library_folders


@dataclass(frozen=True)
class UsdInspection:
    """What is known of a USD file before it is imported.

    up: the axis that points up, None where that is not known. beside: the files that it reads beside itself, sorted.
    missing: those that are not there. unknown: why nothing is known; empty where it is.
    """

    up: Up | None
    beside: tuple[str, ...]
    missing: tuple[str, ...]
    unknown: str = ""


def inspect_usd(path: Path) -> UsdInspection:
    """Look at a USD file. Raises RuntimeError where it cannot be opened, InputError where layers lie elsewhere."""
    add_library_folders()
    if importlib.util.find_spec("pxr") is None:
        unknown = (
            "this Blender lacks the module pxr: of what the file refers to, only pictures are told apart by content"
        )
        return UsdInspection(None, (), (), unknown)
    from pxr import Tf, Usd, UsdGeom, UsdUtils  # pyright: ignore[reportMissingImports]  # noqa: PLC0415 - found only now

    try:
        _check_layers(path)
        stage = Usd.Stage.Open(utf8_name(path))
        layers, assets, missing = UsdUtils.ComputeAllDependencies(utf8_name(path))
    except Tf.ErrorException as error:
        # Its own words may be bytes that are no text, and name files of the machine that built it.
        raise RuntimeError("USD's library cannot open it; the file is damaged: export it again") from error
    files = {layer.realPath for layer in layers} | set(assets)
    beside = {name for name in files if Path(name).is_file() and not path.samefile(name)}
    up: Up = "y" if UsdGeom.GetStageUpAxis(stage) == "Y" else "z"
    return UsdInspection(up, tuple(sorted(beside)), tuple(sorted(missing)))


def _check_layers(path: Path) -> None:
    """Raise InputError where a layer lies outside the folder of the first, or anything named is a pipe.

    Pictures that lie outside are left to their reader, who looks for them beside the mesh.
    """
    from pxr import Ar, Sdf, UsdUtils  # pyright: ignore[reportMissingImports]  # noqa: PLC0415 - found only now

    waiting, seen = [str(path)], set[str]()
    while waiting:
        layer = waiting.pop()
        if layer in seen:
            continue
        seen.add(layer)
        sublayers, others, payloads = UsdUtils.ExtractExternalReferences(utf8_name(layer))
        for name in (*sublayers, *others, *payloads):
            outer = Ar.SplitPackageRelativePathOuter(name)[0]
            place = Path(os.path.normpath(Path(layer).parent / outer.removeprefix("file://").removeprefix("file:")))
            is_layer = name in sublayers or name in payloads or Sdf.FileFormat.FindByExtension(place.suffix) is not None
            if is_layer and not is_inside(path.parent, place):
                raise leads_out(path, "layer", name)
            check_no_pipe(path, "layer" if is_layer else "texture", place)
            if is_layer and place.is_file():
                waiting.append(str(place))
