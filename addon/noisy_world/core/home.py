# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths that begin with ~, as shells write home folders; in a preset or after `--out=` no shell replaces it."""

import os
import sys
from pathlib import Path

from .errors import one_line
from .schema import ConfigPath
from .utf8_names import NOT_UTF8, RENAME, is_utf8


def with_home(text: str) -> Path:
    """Return a path with ~ or ~user at its beginning replaced by that home folder; any other path as it is.

    Raises LookupError, with what is wrong and how to mend it in one line, where there is no such user, and where the
    path is not UTF-8.
    """
    if not is_utf8(text):
        raise LookupError(f"{one_line(text)} {NOT_UTF8}; {RENAME}")
    base, rest = split_home(text)
    return Path(rest) if base is None else base / rest


def split_home(text: str) -> tuple[Path | None, str]:
    """Return the home folder that a path or a glob pattern begins with, and the rest of it; None without one.

    Raises LookupError as `with_home` does.
    """
    if not text.startswith("~"):
        return None, text
    user, *rest = (text.replace("\\", "/") if os.name == "nt" else text).split("/", 1)
    try:
        return Path(user).expanduser(), "".join(rest).lstrip("/")
    except RuntimeError as error:
        whose = f"no user {user[1:]!r}" if user != "~" else "no home folder"
        raise LookupError(
            f"there is {whose} here, which {user} stands for; write ./{text} for what has this name"
        ) from error


def located(folder: Path, text: str, place: ConfigPath) -> tuple[Path, str]:
    """Return the folder that a path or glob pattern of a preset is relative to, and the path in it.

    folder: the preset's, which counts unless the path begins with ~ or ~user. place: of the path. Raises InputError
    where there is no such user.
    """
    try:
        home, rest = split_home(text)
    except LookupError as error:
        raise place.error(str(error)) from error
    return (folder if home is None else home), rest


def path_in(folder: Path, text: str, place: ConfigPath) -> Path:
    """Return the file or folder that a path of a preset in `folder` means.

    Raises InputError as `located` does, and where its name is not UTF-8.
    """
    base, rest = located(folder, text, place)
    path = base / rest
    check_utf8(path, place)
    return path


def check_utf8(path: Path, place: ConfigPath) -> None:
    """Refuse a file or folder that a key of a preset leads to where its name is not UTF-8."""
    if not is_utf8(path):
        raise place.error(f"{path} {NOT_UTF8}", RENAME)


def private_cache_folder() -> Path | None:
    """Return the folder of this user's caches of ours, made where it was not.

    None where there is no home, where it cannot be made or written, and where others could write into it.
    """
    try:
        if sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = base / "noisy-world"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except (OSError, RuntimeError):
        return None
    theirs = sys.platform != "win32" and (found.st_uid != os.geteuid() or found.st_mode & 0o022)
    return folder if not theirs and os.access(folder, os.W_OK) else None
