# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a USD file is made of, told by Pixar's library, which comes with Blender."""

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...core.scenes.turning import Up


@dataclass(frozen=True)
class UsdLook:
    """What is known of a USD file before it is imported.

    up: the axis that points up, None where that is not known. beside: the files that it reads beside itself, sorted.
    missing: those that are not there. unknown: why nothing is known; empty where it is.
    """

    up: Up | None
    beside: tuple[str, ...]
    missing: tuple[str, ...]
    unknown: str = ""


def look_at(path: Path) -> UsdLook:
    """Look at a USD file. Raises RuntimeError where it cannot be opened."""
    root = Path(bpy.utils.system_resource("PYTHON"))  # pyright: ignore[reportAttributeAccessIssue]  the stubs lack it
    sys.path += [
        str(folder) for folder in sorted(root.glob("[lL]ib/**/site-packages"))
    ]  # the bpy package leaves it out
    if importlib.util.find_spec("pxr") is None:
        unknown = (
            "this Blender lacks the module pxr: of what the file refers to, only pictures are told apart by content"
        )
        return UsdLook(None, (), (), unknown)
    from pxr import Tf, Usd, UsdGeom, UsdUtils  # pyright: ignore[reportMissingImports]  # noqa: PLC0415 - found only now

    try:
        stage = Usd.Stage.Open(str(path))
        layers, assets, missing = UsdUtils.ComputeAllDependencies(str(path))
    except Tf.ErrorException as error:
        # Its own words may be bytes that are no text, and name files of the machine that built it.
        raise RuntimeError("USD's library cannot open it; the file is damaged: export it again") from error
    files = {layer.realPath for layer in layers} | set(assets)
    beside = {name for name in files if Path(name).is_file() and not path.samefile(name)}
    up: Up = "y" if UsdGeom.GetStageUpAxis(stage) == "Y" else "z"
    return UsdLook(up, tuple(sorted(beside)), tuple(sorted(missing)))
