# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening a dataset, a recipe or a folder in a plain layout, whichever a path leads to."""

import warnings
from pathlib import Path

from ..core.errors import InputError
from ..core.home import with_home
from .clean_store import read_store
from .from_files import OpenedFolder
from .from_recipe import OpenedRecipe
from .made_with import made_here, made_otherwise
from .opened import Opened
from .recipe import read_recipe


def open_path(path: str | Path, clean: str | Path | None = None, data: str | Path | None = None) -> Opened:
    """Open what is at a path; see noisy_world.open."""
    if "://" in str(path):
        raise InputError(str(path), "is an address, whose tars stream", remedy="see docs/storage.md, or unpack them")
    place = _place(path)
    if place.is_dir():
        for name, given in (("clean", clean), ("data", data)):
            if given is not None:
                raise InputError(place, f"is a folder, whose files are read: {name} goes with a recipe")
        return OpenedFolder(place)
    recipe = read_recipe(place)
    store = None if clean is None else read_store(_place(clean))
    for made in [made_here()] + ([store.identity] if store is not None else []):
        if otherwise := made_otherwise(recipe.identity, made):
            warnings.warn(f"{place}: {otherwise}", stacklevel=3)
            break
    return OpenedRecipe(recipe, store, None if data is None else _place(data))


def _place(path: str | Path) -> Path:
    try:
        return with_home(str(path))
    except LookupError as error:
        raise InputError(str(path), str(error)) from error
