# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy World: clean 3D scenes in, noisy RGB-D worlds out.

As a Blender extension it adds a tab to the 3D view's sidebar. The library and the command `noisy-world`
(headless/generate.py) use the same scenes, trajectories and presets without the tab.

The library: `open` reads datasets and recipes frame by frame, `perturb` perturbs arrays and sequences, `extend` is what
an author of perturbations imports. The last two are loaded when they are first used.
"""

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import extend, perturb
    from .dataset.loader import Opened

    __version__: str

__all__ = ["__version__", "extend", "open", "perturb"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from .core.packages import package_version

        return package_version()
    if name in ("extend", "perturb"):
        return importlib.import_module(f".{name}", __name__)  # by the name that Blender has loaded it under
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "register", "unregister"]


def open(  # noqa: A001 - as in noisy_world.open(...)
    path: str | Path, clean: str | Path | None = None, *, data: str | Path | None = None
) -> "Opened":
    """Open a dataset or a recipe: sequences by name, frames by number, in any order. No Blender is needed.

        frame = noisy_world.open("out/noisy_rooms")["fog_s3_static/room0"][1234]
        frame.rgb, frame.depth_m, frame.c2w, frame.stamp_s, frame.done

    path: of a dataset, or its address such as s3://bucket/name; of a folder with sequences in a layout; or of a recipe,
    whose frames are made on the spot, equal to the bytes of the dataset's files. clean: for a recipe, the folder of
    clean frames that 'noisy-world render-clean' made; without one, frames are made of inputs that need no Blender.
    data: for a recipe, the folder that the paths of its scenes begin at; default the recipe's own.

    Raises InputError where there is neither, or where the clean frames are another recipe's.
    """
    from .dataset.opening import open_path  # Blender enables the add-on by this file

    return open_path(path, clean, data)


def register() -> None:
    """Show the tab.

    Raises ImportError where packages are missing, or an installed one brings perturbations that cannot be loaded.
    Blender shows a message that begins with "Add-on not loaded: " without a traceback.
    """
    from .core.errors import NoisyWorldError
    from .core.packages import install_remedy, missing_packages, missing_sentence

    if missing := missing_packages():
        remedy = install_remedy(Path(__file__).parent)
        raise ImportError("Add-on not loaded: " + missing_sentence(missing, "this Blender's ", remedy))

    try:
        from . import panel
    except NoisyWorldError as error:
        raise ImportError(f"Add-on not loaded: {error}") from error

    panel.register()


def unregister() -> None:
    """Take the tab away."""
    from . import panel
    from .other_name import take_other_names

    panel.unregister()
    take_other_names()
