# SPDX-License-Identifier: GPL-3.0-or-later
"""The store at a place that a user gave, whichever kind it is."""

import sys
from pathlib import Path

from ..core.errors import StorageError
from ..core.home import with_home
from .address import Address
from .store import FolderStore, Store


def is_address(text: str) -> bool:
    """Tell whether a place that a user gave is an address, rather than a folder."""
    return "://" in text


def open_store(place: Path | str) -> Store:
    """Return the store at a folder or an address, which need not hold anything yet.

    Raises MissingDependencyError where a package for an address's protocol is missing, StorageError where the address
    has no meaning.
    """
    if isinstance(place, Path):
        return FolderStore(place)
    protocol, _, rest = place.partition("://")
    if not rest.strip("/"):
        raise StorageError("names no place", file=place, remedy=f"write it as {protocol or 's3'}://BUCKET/NAME")
    text = place.rstrip("/")
    if protocol in ("file", "local"):
        try:
            return FolderStore(with_home(rest.lstrip("/") if sys.platform == "win32" else rest), text)
        except LookupError as error:
            raise StorageError(str(error), file=text) from error
    return Address.of_text(text)
