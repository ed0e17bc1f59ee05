# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening a dataset, a recipe or a folder in a plain layout, whichever a path or an address leads to."""

import warnings
from pathlib import Path

from ..core.errors import InputError, nearest
from ..core.file_access import with_home
from .clean_store import read_store
from .loader import Opened
from .recipe import read_recipe
from .recipe_frames import OpenedRecipe
from .remaking import made_here, made_otherwise
from .store import is_address
from .stored import is_packed
from .stored_frames import OpenedFolder, OpenedPacked


def open_path(path: str | Path, clean: str | Path | None = None, data: str | Path | None = None) -> Opened:
    """Open what is at a path; see noisy_world.open."""
    if is_address(str(path)):
        _refuse_inputs(path, "an address", clean, data)
        return OpenedPacked(str(path))
    place = _place(path)
    if place.is_dir():
        _refuse_inputs(place, "a folder", clean, data)
        return OpenedPacked(place) if is_packed(place) else OpenedFolder(place)
    if not place.exists():
        raise _not_there(place)
    recipe = read_recipe(place)
    store = None if clean is None else read_store(_place(clean))
    for made in [made_here()] + ([store.identity] if store is not None else []):
        if otherwise := made_otherwise(recipe.identity, made):
            warnings.warn(f"{place}: {otherwise}", stacklevel=3)
            break
    return OpenedRecipe(recipe, store, None if data is None else _place(data))


def _not_there(place: Path) -> InputError:
    """Return the error for a path that leads nowhere, with what is near its first part that is not there."""
    first = next(part for part in [*reversed(place.parents), place] if not part.exists())
    beside = {item.name: item for item in sorted(first.parent.iterdir())} if first.parent.is_dir() else {}
    near = nearest(first.name, beside)
    remedy = f"did you mean {str(beside[near])!r}?" if near else f"{first.parent} holds nothing of a name like it"
    return InputError(place, "no such folder or recipe", remedy=remedy)


def _refuse_inputs(path: str | Path, what: str, clean: str | Path | None, data: str | Path | None) -> None:
    for name, given in (("clean", clean), ("data", data)):
        if given is not None:
            raise InputError(path, f"is {what}, whose files are read: {name} goes with a recipe")


def _place(path: str | Path) -> Path:
    try:
        return with_home(str(path))
    except LookupError as error:
        raise InputError(str(path), str(error)) from error
