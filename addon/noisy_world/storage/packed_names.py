# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a packed dataset, by their names."""

from dataclasses import dataclass

TABLE = "manifest.parquet"
CROISSANT = "croissant.json"
CARD = "README.md"
FRAMES_FOLDER = "frames"  # in a tar
TAR_SUFFIX = ".tar"


@dataclass(frozen=True)
class PackedFile:
    """A file of a packed dataset. name: from its place on. size: bytes."""

    name: str
    size: int
    sha256: str


def tar_name(sequence: str) -> str:
    """Return the name of a sequence's tar, from the dataset's place on."""
    return f"{sequence}{TAR_SUFFIX}"
