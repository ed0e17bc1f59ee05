# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what a system wrote: only regular files in its own folder, and none larger than its limits."""

import contextlib
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from ...core.errors import InputError, one_line
from ...core.regular_files import check_regular
from ..estimates.poses import OverLimitError

LONGEST_SENTENCE = 400  # characters


def found_output(folder: Path, pattern: str) -> Path | None:
    """Return what a name or a pattern stands for in a system's folder; the first by name of several, None of none.

    It may be anything but a folder: `check_output` tells.
    """
    with contextlib.suppress(OSError):  # a name too long, or a folder that may not be listed
        return min((path for path in folder.glob(pattern) if not _is_folder(path)), default=None)
    return None


def check_output(path: Path, folder: Path, largest_bytes: int | None, key: str) -> None:
    """Raise InputError where a file that a system left is not to be read.

    That is: a pipe, a socket, a device or a link that leads out of the system's folder; OverLimitError where it has
    more bytes than the limit, which `key` names in the system's definition; None for any.
    """
    if not _inside(path, folder):
        raise InputError(path, "is a link that leads out of the folder that the system writes into")
    try:
        check_regular(path)
        size = path.stat().st_size
    except OSError as error:
        raise InputError(path, str(error.strerror or error)) from None
    if largest_bytes is not None and size > largest_bytes:
        raise OverLimitError(path, f"has more than the {largest_bytes / 1e6:g} MB of {key}")


def sentence(text: str) -> str:
    """Return a text of a system as a line that a terminal and a file of JSON take, not longer than a sentence."""
    line = one_line(text[: LONGEST_SENTENCE + 1])
    return line if len(line) <= LONGEST_SENTENCE else f"{line[:LONGEST_SENTENCE]}..."


def remove_tree(path: Path) -> bool:
    """Remove a folder, or what stands in its place, whatever a system has done to it; tell whether it is gone."""

    def permit(function: Callable[..., object], name: str, error: object) -> None:
        del error
        with contextlib.suppress(OSError):
            os.chmod(os.path.dirname(name), stat.S_IRWXU)  # noqa: PTH101, PTH120 - a name may be too long for a Path
            if function in (os.rmdir, os.unlink):
                function(name)

    if path.is_symlink() or (os.path.lexists(path) and not path.is_dir()):
        with contextlib.suppress(OSError):
            path.unlink()
        return not os.path.lexists(path)
    with contextlib.suppress(RecursionError, OSError):
        if sys.version_info >= (3, 12):
            shutil.rmtree(path, onexc=permit)
        else:
            shutil.rmtree(path, onerror=permit)
    if os.path.lexists(path):  # folders without permissions, or nested more deeply than there are open files
        for command in (("chmod", "-R", "u+rwX"), ("rm", "-rf")):
            subprocess.run(  # noqa: S603 - a path of ours
                [*command, "--", os.fspath(path)], stdin=subprocess.DEVNULL, capture_output=True, check=False
            )
    return not os.path.lexists(path)


def restore_folder(folder: Path, keep: tuple[str, ...]) -> None:
    """Make a folder, which was there before a system ran, a folder again, with nothing in it but regular files to keep.

    A system may have put a file or a link in the place of the folder, or of one above it. keep: names; one of a folder
    stays as it is.
    """
    for above in (*reversed(folder.parents), folder):
        if os.path.lexists(above) and (above.is_symlink() or not above.is_dir()):
            above.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    for item in folder.iterdir():
        plain = not item.is_symlink() and (item.is_file() or item.is_dir())
        if item.name not in keep or not plain:
            remove_tree(item)


def _is_folder(path: Path) -> bool:
    with contextlib.suppress(OSError):
        return path.is_dir()
    return False


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return False
