# SPDX-License-Identifier: GPL-3.0-or-later
"""What names in a preset may be, as they become folders."""

import re

from ..schema import shown

LONGEST_NAME = 200  # of a folder; file systems hold 255 bytes
PLACEHOLDER = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}")


def safe_name(name: str) -> str:
    """Return why a name cannot be a folder's, or ""."""
    if len(name) > LONGEST_NAME:
        return f"has {len(name)} characters, but it names a folder: at most {LONGEST_NAME}"
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        return ""
    return (
        f"is {shown(name)}, but it names a folder: letters, digits, dot, dash and underscore, a letter or digit first"
    )


def scene_name(name: str) -> str:
    """Return why a name cannot be a scene's, or ""; * stands for what wildcards matched."""
    return "" if "*" in name else safe_name(name)


def stream_name(name: str) -> str:
    """Return why a text cannot name a random stream, or ""."""
    if not name.strip() or not name.isprintable():
        return f"is {shown(name)}, but has to be a name"
    return f"has {len(name)} characters: at most {LONGEST_NAME}" if len(name) > LONGEST_NAME else ""


def template(name: str) -> str:
    """Return why a text with {placeholders} cannot become folders' names, or ""."""
    return safe_name(PLACEHOLDER.sub("x", name))


def format_same_folder(name: str, other: str) -> str:
    """Return in words that names are one folder's on disks that do not tell case apart, where a dataset may come to."""
    return f"{shown(name)} and {shown(other)} differ in case only, so they are one folder on macOS and Windows"
