# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder in which what goes to an address is made first: the same for each run there, so that a run goes on."""

import contextlib
import os
import sys
import tempfile
from pathlib import Path

from ..core.datasets.storage import sha256_of_bytes, storage_errors
from ..core.errors import StorageError
from .address import Address

REMEDY = "name another folder with --scratch"


def scratch_folder(address: Address, parent: Path | None) -> Path:
    """Return the path of the folder for an address, which need not exist yet.

    parent: where it is to be; None for the system's folder of temporary files.
    """
    place = Path(tempfile.gettempdir()) if parent is None else parent
    return place.absolute() / f"noisy-world-{sha256_of_bytes(address.text.encode())[:16]}"


def make_own(folder: Path) -> None:
    """Make a folder, unless a run left it there.

    Raises StorageError where it cannot be made, and where it is not this user's own: others could change there what is
    published.
    """
    with storage_errors(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        own = sys.platform == "win32" or folder.lstat().st_uid == os.geteuid()
    if folder.is_symlink() or not folder.is_dir() or not own:
        raise StorageError(f"{folder}: is not a folder of this user's own; {REMEDY}")
