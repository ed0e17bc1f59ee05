# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are parameters of a perturbation: found beside the preset, checked, and recorded by what they hold."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..datasets.hashing import read_sha256
from ..home import path_in
from ..schema import ConfigPath, KeyInfo


def with_files(parameters: type, given: Mapping[str, Any], place: ConfigPath) -> dict[str, Any]:
    """Return parameters that a preset gives with its files as whole paths; they are read once, to check them.

    parameters: the perturbation's. place: of these values. A path is relative to the preset, or to where the program
    runs where none is read from a file. Raises InputError where a file cannot be read or holds something else.
    """
    found = dict(given)
    for item in fields(parameters):
        info: KeyInfo = item.metadata["key"]
        if info.file is None or not given.get(item.name):
            continue
        where = place.at(item.name)
        path = path_in(place.folder, given[item.name], where).absolute()
        try:
            info.file(path)
        except FileNotFoundError as error:
            raise where.error(f"{path} is not there", "name the file, relative to the preset") from error
        except OSError as error:
            raise where.error(f"{path} cannot be read: {error.strerror or error}") from error
        except ValueError as error:
            raise where.error(f"{path} {error}") from error
        found[item.name] = str(path)
    return found


def files_of(parameters: Any) -> dict[str, Path]:
    """Return the files that parameters name, by the parameter."""
    values = {item.name: getattr(parameters, item.name) for item in fields(parameters) if item.metadata["key"].file}
    return {name: Path(value) for name, value in values.items() if value}


def deciding(parameters: Any) -> dict[str, Any]:
    """Return the parameters of a step as an identity has them: of a file its SHA-256, and none that is not given.

    Raises OSError where a file is gone.
    """
    plain = {name: value for name, value in asdict(parameters).items() if name not in _names(parameters)}
    return plain | {name: {"sha256": sha256_of(path)} for name, path in files_of(parameters).items()}


def recorded(parameters: Any) -> dict[str, Any]:
    """Return them as a frame's record has them: as `deciding` does, with the names of files too."""
    named = {name: {"name": path.name, "sha256": sha256_of(path)} for name, path in files_of(parameters).items()}
    return deciding(parameters) | named


def _names(parameters: Any) -> set[str]:
    return {item.name for item in fields(parameters) if item.metadata["key"].file is not None}


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, which is known while the file stays. Raises OSError."""
    return _sha256(str(path), *_stamp(str(path)))


def _stamp(path: str) -> tuple[int, int]:
    status = Path(path).stat()
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=16)
def _sha256(path: str, _changed_ns: int, _size: int) -> str:
    return read_sha256(Path(path))
