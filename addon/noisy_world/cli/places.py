# SPDX-License-Identifier: GPL-3.0-or-later
"""Places that a user names for a dataset: a folder, or an address such as s3://bucket/name."""

import argparse
from pathlib import Path

from ..core.home import with_home


def path(text: str) -> Path:
    """Parse a path, in which ~ and ~user are home folders."""
    try:
        return with_home(text)
    except LookupError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def place(text: str) -> Path | str:
    """Parse a folder, or an address, which stays a text: a path would lose a slash of it."""
    return text if "://" in text else path(text)


def out_path(text: str) -> Path:
    """Parse the file or folder to write, where an address cannot be taken."""
    if "://" in text:
        raise argparse.ArgumentTypeError(f"{text} is an address, and this is written on this machine; name a path")
    return path(text)


def folder(text: str) -> Path:
    """Parse a folder, where an address cannot be taken."""
    if "://" in text:
        raise argparse.ArgumentTypeError(f"{text} is an address, and a folder is needed; unpack its tars into one")
    return path(text)
