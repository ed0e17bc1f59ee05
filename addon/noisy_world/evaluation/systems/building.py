# SPDX-License-Identifier: GPL-3.0-or-later
"""Building ORB-SLAM2 and ORB-SLAM3 from their authors' source, which the user has cloned, by Debian's libraries."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...core.datasets.storage import StorageError, storage_errors, write_atomic
from ...core.errors import InputError, MissingDependencyError
from ...core.regular_files import read_bytes
from ...core.shipped import PACKAGE
from .installing import VOCABULARY, run_step
from .orb_vocabulary import train

DRIVER = PACKAGE / "evaluate" / "orb_slam"
PROGRAM = "orb_slam"
BUILT = "built.json"
_COMPILED = ("include", "src", "Thirdparty")
_SUFFIXES = (".h", ".hpp", ".cc", ".cpp", ".c", ".txt")
_JOBS = 4  # at most: a file of Eigen's takes a gigabyte


@dataclass(frozen=True)
class AuthorsSource:
    """A system that is built from its authors' source.

    generation: which ORB-SLAM. commit: the one that was tried. packages: of Debian, beside those of every generation.
    """

    generation: int
    url: str
    commit: str
    packages: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of its folder and of its C++ namespace in capitals."""
        return f"ORB_SLAM{self.generation}"

    @property
    def remedy(self) -> str:
        """What gets the source."""
        return f"get it: git clone {self.url} && git -C {self.name} checkout {self.commit}"


CLONED = {
    "orb-slam2": AuthorsSource(2, "https://github.com/raulmur/ORB_SLAM2", "f2e6f51cdc8d067655d90a78c06261378e07e8f3"),
    "orb-slam3": AuthorsSource(
        3,
        "https://github.com/UZ-SLAMLab/ORB_SLAM3",
        "4452a3c4ab75b1cde34e5505a36ec3f9edcdc4c4",
        ("libboost-serialization-dev", "libssl-dev"),
    ),
}
"""What can be built, by the name of its environment."""


def build(published: AuthorsSource, source: Path, folder: Path, tell: Callable[[str], None]) -> bool:
    """Build a system from its source into a folder, with the vocabulary. Returns False where that was done already.

    tell: is given a line for each step. The folder gets bin/orb_slam, bin/python (which starts it), the vocabulary and
    built.json, written last; the source stays as it is. Raises InputError where the source is none, StorageError where
    it cannot be built, and MissingDependencyError where a compiler or a library is missing.
    """
    if not (source / "include/System.h").is_file() or not (source / "Thirdparty/g2o").is_dir():
        raise InputError(source, f"is no source of {published.name}", where="--source", remedy=published.remedy)
    if f"namespace {published.name}".encode() not in read_bytes(source / "include/System.h"):
        raise InputError(source, f"is not {published.name}", where="--source", remedy=published.remedy)
    digest = _digest([source / name for name in _COMPILED])
    said = {"source": f"sha256 {digest[:16]}, commit {_commit(source)}", "driver": _digest([DRIVER])[:16]}
    if (folder / BUILT).is_file() and json.loads(read_bytes(folder / BUILT)) == said:
        return False
    _check_tools(published)
    with storage_errors(folder):
        if folder.exists() and any(folder.iterdir()) and not (folder / "pyvenv.cfg").is_file():
            raise StorageError("is there, and is not what this command makes", file=folder, remedy="move it away")
        shutil.rmtree(folder, ignore_errors=True)
    run_step([sys.executable, "-m", "venv", "--without-pip", str(folder)], folder, "its Python cannot be made")
    _compile(published, source, folder, tell)
    tell("training the vocabulary on pictures of an embedded room")
    write_atomic(folder / VOCABULARY, train().encode(), folder)
    write_atomic(folder / BUILT, json.dumps(said).encode(), folder)
    return True


def _digest(folders: list[Path]) -> str:
    """Return the SHA-256 of the code in folders, as 64 hexadecimal digits."""
    total = hashlib.sha256()
    for folder in folders:
        for path in sorted(path for path in folder.rglob("*") if path.suffix in _SUFFIXES and path.is_file()):
            total.update(f"{path.relative_to(folder)}\0".encode() + hashlib.sha256(read_bytes(path)).digest())
    return total.hexdigest()


def _commit(source: Path) -> str:
    asked = ["git", "-C", str(source), "rev-parse", "HEAD"]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, check=False, timeout=60)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return done.stdout.strip()[:12] if done.returncode == 0 else "unknown"


def _check_tools(published: AuthorsSource) -> None:
    missing = [tool for tool in ("cmake", "c++", "make") if shutil.which(tool) is None]
    if missing:
        raise MissingDependencyError(f"{published.name} needs {', '.join(missing)}; {_advice(published)}")


def _advice(published: AuthorsSource) -> str:
    needed = ("cmake", "g++", "make", "libopencv-dev", "libeigen3-dev", *published.packages)
    return f"on Debian: apt-get install {' '.join(needed)}"


def _compile(published: AuthorsSource, source: Path, folder: Path, tell: Callable[[str], None]) -> None:
    jobs = min(_JOBS, os.cpu_count() or 1)
    with tempfile.TemporaryDirectory(prefix="noisy-world-build-") as build_folder:
        options = [f"-DSOURCE={source.resolve()}", f"-DGENERATION={published.generation}", "-DCMAKE_BUILD_TYPE=None"]
        configure = ["cmake", *options, "-S", str(DRIVER), "-B", build_folder]
        run_step(configure, folder, f"a library is missing ({_advice(published)})")
        tell(f"compiling {published.name} of {source}, which takes minutes")
        make = ["cmake", "--build", build_folder, "--parallel", str(jobs)]
        run_step(make, folder, f"{published.name} cannot be compiled; what was tried is commit {published.commit[:12]}")
        with storage_errors(folder):
            shutil.copy2(Path(build_folder) / PROGRAM, folder / "bin" / PROGRAM)
