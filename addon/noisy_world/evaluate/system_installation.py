# SPDX-License-Identifier: GPL-3.0-or-later
"""Installing systems: environments from a pinned lock file, and ORB-SLAM built from its authors' source."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import StorageError, storage_errors, write_atomic
from ..core.errors import InputError, MissingDependencyError
from ..core.file_access import read_bytes, read_text
from ..core.packages import PACKAGE, shipped
from ..dataset.frame import CleanFrame
from ..dataset.plan import make_plan
from ..dataset.rendering import render_options, source_paths
from ..preset.keys import read_preset
from ..scenes.polygon_mesh import room_mesh

# Training the vocabulary of ORB-SLAM3 on pictures of an embedded room.
#
# ORB-SLAM3 finds places again by words of its own descriptors. What its authors give away is 145 MB of words of
# photographs; this one is a tree of the same format (DBoW2's text, as ORB-SLAM2 reads and writes it), trained on frames
# of a room that belongs to no study. Its tree is made by k-means with medians of bits, from a fixed seed.


Bits: TypeAlias = NDArray[np.uint8]
"""(N, 256): descriptors, a bit in each."""

ROOM = 7
FRAMES, RATE_HZ = 60, 1
FEATURES = 1500  # of a frame
BRANCHES, DEPTH = 10, 6  # of the tree, as the authors' has them; ORB-SLAM looks four levels above its words
WORD = 8  # chosen: descriptors of a word, about; words of single ones would match nothing again
ROUNDS = 8
TF_IDF_L1 = "0 0"  # weighting and score of DBoW2


def train() -> str:
    """Return the vocabulary, trained on FRAMES pictures, as DBoW2's text. It is the same each time."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return vocabulary_text([descriptors(frame) for frame in rendered(FRAMES)])
    finally:
        cv2.setNumThreads(threads)


def rendered(frames: int) -> list[NDArray[np.uint8]]:
    """Return frames (480, 640, 3) of the room's path, RGB."""
    overrides = [
        "settings=[{name: clean}]",
        f"scenes.0.mesh={room_mesh(ROOM)}",
        f"scenes.0.trajectory={{handheld: {{frames: {frames}, rate_hz: {RATE_HZ}}}}}",
        "camera={width: 640, height: 480, fx: 600, fy: 600, cx: 319.5, cy: 239.5}",
    ]
    plan = make_plan(read_preset(shipped("presets/demo.yaml"), overrides))
    render = plan.renders[0]
    paths = source_paths(plan, render)
    with render.scene.source.prepare(render.camera, print) as prepared:
        source = prepared.open(paths, render_options(plan, render), print)
        requests = [paths.request(number) for number in range(frames)]
        return [CleanFrame(request.frame, source.frame(request)).byte_rgb for request in requests]


def descriptors(rgb: NDArray[np.uint8]) -> Bits:
    """Return the ORB descriptors of a picture (H, W, 3)."""
    import cv2

    detector = cv2.ORB.create(nfeatures=FEATURES)
    _, descriptors = detector.detectAndCompute(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), None)
    return np.unpackbits(np.asarray(descriptors, np.uint8), axis=1)


def vocabulary_text(pictures: list[Bits]) -> str:
    """Return a vocabulary in DBoW2's text format, trained on the descriptors of pictures.

    The first line is branches, levels, weighting and score; then a line a node, numbered from 1: its parent, whether it
    is a word, the 32 bytes of its descriptor, and its weight. A word's weight is ln(pictures / pictures with it).
    """
    tree = Tree(np.concatenate(pictures))
    of_picture = np.repeat(np.arange(len(pictures)), [len(bits) for bits in pictures])
    lines = [f"{BRANCHES} {DEPTH} {TF_IDF_L1}"]
    for parent, members, bits, is_word in tree.nodes:
        with_it = len(np.unique(of_picture[members]))
        weight = float(np.log(len(pictures) / with_it)) if is_word else 0.0
        numbers = " ".join(map(str, np.packbits(bits).tolist()))
        lines.append(f"{parent} {int(is_word)} {numbers} {weight:.9g}")
    return "\n".join(lines)  # no line feed at the end: ORB-SLAM3 would read a node more


class Tree:
    """Descriptors divided again and again by k-means.

    nodes: of each its parent's number (0 is the root), the rows of its descriptors, its own descriptor (256,) and
    whether it is a word; the i-th has the number i + 1, and parents come before children.
    """

    def __init__(self, bits: Bits) -> None:
        self.nodes: list[tuple[int, NDArray[np.int64], Bits, bool]] = []
        self._bits = bits
        self._signs = bits.astype(np.float32) * 2.0 - 1.0  # products of signs are 256 - 2 x Hamming distance, exactly
        self._random = np.random.default_rng(0)
        self._divide(0, np.arange(len(bits)), 1)

    def _divide(self, parent: int, members: NDArray[np.int64], level: int) -> None:
        for group, centre in self._groups(members):
            is_word = level == DEPTH or len(group) < 2 * WORD
            self.nodes.append((parent, group, centre, is_word))
            if not is_word:
                self._divide(len(self.nodes), group, level + 1)

    def _groups(self, members: NDArray[np.int64]) -> list[tuple[NDArray[np.int64], Bits]]:
        """Return rows in up to BRANCHES groups, each with its median descriptor."""
        signs = self._signs[members]
        centres = self._seeds(signs, min(BRANCHES, max(2, len(members) // WORD)))
        nearest = np.argmax(signs @ centres.T, axis=1)
        for _ in range(ROUNDS):
            centres = np.stack(
                [np.where(signs[nearest == k].sum(axis=0) > 0, 1.0, -1.0) for k in np.unique(nearest)]
            ).astype(np.float32)
            moved = np.argmax(signs @ centres.T, axis=1)
            if np.array_equal(moved, nearest):
                break
            nearest = moved
        return [(members[nearest == k], (centres[k] > 0).astype(np.uint8)) for k in np.unique(nearest)]

    def _seeds(self, signs: NDArray[np.float32], most: int) -> NDArray[np.float32]:
        """Return up to so many different descriptors, far ones preferred (k-means++)."""
        chosen = [signs[self._random.integers(len(signs))]]
        apart = np.full(len(signs), np.inf)
        while len(chosen) < most:
            apart = np.minimum(apart, (256.0 - signs @ chosen[-1]) / 2.0)
            total = np.cumsum(apart.astype(np.float64) ** 2)
            if total[-1] == 0.0:
                break
            chosen.append(signs[np.searchsorted(total, self._random.random() * total[-1], side="right")])
        return np.stack(chosen)


ENVIRONMENT = "slam"
"""The environment that can be installed; systems share it."""

LOCK = "requirements/slam.lock"
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
        _make_environment(folder, _checked(python) if python else usable_python(), digest, tell)
    tell("training the vocabulary of ORB-SLAM3 on pictures of an embedded room")
    write_atomic(folder / VOCABULARY, train().encode(), folder)
    return True


def usable_python() -> str:
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
            yield from _output_of([uv, "python", "find", version]).splitlines()[-1:]


def _checked(python: str) -> str:
    if (version := _version(python)) not in PYTHONS:
        problem = f"is Python {version}" if version else "is no Python that can be run"
        raise InputError(python, problem, where="--python", remedy=f"name a Python {' or '.join(PYTHONS)}")
    return python


def _version(python: str) -> str:
    """Return the version of a Python, such as 3.12; "" where it cannot be run."""
    return _output_of([python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"])


def _output_of(command: list[str]) -> str:
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
        message = next((line for line in reversed(lines) if line.lower().startswith("error")), (lines or [""])[-1])
        raise StorageError(f"{problem}: {message or f'status {done.returncode}'}", file=folder)


# Building ORB-SLAM2 and ORB-SLAM3 from their authors' source, which the user has cloned, by Debian's libraries.


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
    versions = {"source": f"sha256 {digest[:16]}, commit {_commit(source)}", "driver": _digest([DRIVER])[:16]}
    if (folder / BUILT).is_file() and json.loads(read_bytes(folder / BUILT)) == versions:
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
    write_atomic(folder / BUILT, json.dumps(versions).encode(), folder)
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
