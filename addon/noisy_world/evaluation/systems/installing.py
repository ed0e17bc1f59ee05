# SPDX-License-Identifier: GPL-3.0-or-later
"""Installing systems that have no packages for this Python: an environment of their own, from a pinned lock file."""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from ...core.datasets.storage import StorageError, storage_errors, write_atomic
from ...core.errors import InputError, MissingDependencyError
from ...core.regular_files import read_bytes, read_text
from ...core.shipped import shipped
from .orb_vocabulary import train

ENVIRONMENT = "slam"
"""The environment that can be installed; systems share it."""

LOCK = "requirements-slam.lock"
VOCABULARY = "orb_vocabulary.txt"
PYTHONS = ("3.12", "3.11")
"""Those that the packages of LOCK are made for, the preferred one first."""

_UNFINISHED, _INSTALLED = ".unfinished", ".installed"


def install(folder: Path, python: str | None, tell: Callable[[str], None]) -> bool:
    """Make the environment in a folder: a Python environment with LOCK's packages, and the vocabulary of ORB-SLAM3.

    python: the Python that it is made from; by default one that is found. tell: is given a line for each step. What was
    made half, since something ended it, or from another lock file, is made anew. Returns False where it is there
    already.

    Raises MissingDependencyError where no Python of PYTHONS is here, InputError where the given one is none, and
    StorageError where the environment cannot be made.
    """
    digest = hashlib.sha256(read_bytes(shipped(LOCK))).hexdigest()
    if _is_whole(folder, digest):
        if (folder / VOCABULARY).is_file():
            return False
    else:
        _make_environment(folder, _checked(python) if python else found_python(), digest, tell)
    tell("training the vocabulary of ORB-SLAM3 on pictures of an embedded room")
    write_atomic(folder / VOCABULARY, train().encode(), folder)
    return True


def found_python() -> str:
    """Return a Python of PYTHONS: from the path, of the system, or one that uv has. Raises MissingDependencyError."""
    for candidate in _candidates():
        if _version(candidate) in PYTHONS:
            return candidate
    raise MissingDependencyError(
        f"Python {' or '.join(PYTHONS)} is needed, and neither is here; get one, with 'pip install uv' and "
        "'uv python install 3.12' for instance (Debian 12: apt-get install python3.11-venv; Ubuntu 24.04: "
        "python3.12-venv), name one with --python, or build the project's Containerfile, which has all of it"
    )


def _candidates() -> Iterator[str]:
    for version in PYTHONS:
        on_path = shutil.which(f"python{version}")
        yield from filter(None, (on_path, f"/usr/bin/python{version}"))  # the first may be another's shim, which fails
    if (uv := shutil.which("uv")) is not None:
        for version in PYTHONS:
            yield from _said([uv, "python", "find", version]).splitlines()[-1:]


def _checked(python: str) -> str:
    if (version := _version(python)) not in PYTHONS:
        problem = f"is Python {version}" if version else "is no Python that can be run"
        raise InputError(python, problem, where="--python", remedy=f"name a Python {' or '.join(PYTHONS)}")
    return python


def _version(python: str) -> str:
    """Return the version of a Python, such as 3.12; "" where it cannot be run."""
    return _said([python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"])


def _said(command: list[str]) -> str:
    """Return what a command prints; "" where it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=60, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _is_whole(folder: Path, digest: str) -> bool:
    """Tell whether the environment in a folder was made to its end, from the lock file of this digest, and starts."""
    made = folder / _INSTALLED
    if (folder / _UNFINISHED).exists() or not made.is_file() or read_text(made).strip() != digest:
        return False
    return bool(_version(str(folder / "bin" / "python")))


def _make_environment(folder: Path, python: str, digest: str, tell: Callable[[str], None]) -> None:
    ours = not folder.exists() or (folder / "pyvenv.cfg").exists() or (folder / _UNFINISHED).exists()
    if not ours and any(folder.iterdir()):
        raise StorageError("is there, and is no Python environment", file=folder, remedy="move it away")
    tell(f"making {folder} with {python}")
    with storage_errors(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / _UNFINISHED).touch()
    run_step(
        [python, "-m", "venv", str(folder)], folder, f"{python} cannot make it; on Debian, its package ends in -venv"
    )
    tell("installing its packages, some 770 MB on disk")
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    pinned = ["--no-deps", "--require-hashes", "--only-binary", ":all:", "-r", str(shipped(LOCK))]
    run_step([*pip, *pinned], folder, "its packages cannot be installed; the same command again begins anew")
    with storage_errors(folder):
        (folder / _INSTALLED).write_text(digest + "\n")
        (folder / _UNFINISHED).unlink()


def run_step(command: list[str], folder: Path, problem: str) -> None:
    """Run a command of an installation. Raises StorageError with its last line where it fails."""
    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(  # noqa: S603 - our own
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", env=own, check=False
    )
    if done.returncode != 0:
        lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
        said = next((line for line in reversed(lines) if line.lower().startswith("error")), (lines or [""])[-1])
        raise StorageError(f"{problem}: {said or f'status {done.returncode}'}", file=folder)
