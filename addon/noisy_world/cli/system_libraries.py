# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the system libraries that a package needs and this machine lacks; install them if root on Debian.

    python -m noisy_world.cli.system_libraries        # those of bpy, also before it is installed

Rendering with Cycles needs no display, but the package is linked against X and GL all the same.
"""

import ctypes
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

# What bpy 5.2 is linked against and does not bring along.
OF_BPY = (
    "libX11.so.6", "libXrender.so.1", "libXfixes.so.3", "libXi.so.6", "libXext.so.6", "libxkbcommon.so.0", "libSM.so.6",
    "libICE.so.6", "libGL.so.1",
)  # fmt: skip
# By Debian's package names: those, and what the windows of ORB-SLAM3 are linked against, which are never opened.
DEBIAN_PACKAGES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXext.so.6": "libxext6",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libOpenGL.so.0": "libopengl0",
    "libGLU.so.1": "libglu1-mesa",
}


def main() -> int:
    """Install the missing libraries, or print their names; return the exit status."""
    problem = provide("bpy", missing_libraries)
    if problem:
        print(problem, file=sys.stderr)
    return int(bool(problem))


def provide(whose: str, find: Callable[[], list[str]]) -> str:
    """Install the missing libraries if root on Debian; return what is missing then and how to get it, "" for nothing.

    find: returns the names of the libraries that are missing.
    """
    names = find()
    if not names:
        return ""
    packages = debian_packages(names)
    if os.geteuid() == 0 and shutil.which("apt-get"):
        print(f"system libraries are missing ({', '.join(names)}): installing {' '.join(packages)}", file=sys.stderr)
        said = install(packages)
        names = find()
        if not names:
            return ""
        print(said, file=sys.stderr)
    return advice(names, whose)


def install(packages: list[str]) -> str:
    """Install Debian packages; return what apt-get said, which is of interest only where it did not help."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    said = ""
    for step in (["update"], ["install", "-y", "--no-install-recommends", *packages]):
        done = subprocess.run(
            ["apt-get", "-qq", *step],  # noqa: S607
            check=False, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        )  # fmt: skip
        said += done.stdout
    return said.strip()


def advice(names: list[str], whose: str = "bpy") -> str:
    """Return one line on what is missing and how to get it."""
    packages = " ".join(debian_packages(names))
    return f"{whose} needs system libraries that are missing here: {', '.join(names)}; run: apt-get install {packages}"


def debian_packages(names: list[str]) -> list[str]:
    """Return the Debian packages of the libraries; for an unknown library, its own name."""
    return sorted({DEBIAN_PACKAGES.get(name, name) for name in names})


def missing_libraries() -> list[str]:
    """Return the libraries that the dynamic linker does not find for bpy, whether it is installed yet or not.

    [] where the system is not Linux, or bpy is there and ldd is not.
    """
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        return [name for name in OF_BPY if sys.platform.startswith("linux") and not _can_be_loaded(name)]
    return missing_for([Path(spec.origin).with_name("__init__.so")])


def _can_be_loaded(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def missing_for(libraries: Iterable[Path]) -> list[str]:
    """Return the libraries that the dynamic linker does not find for some; [] where there is no ldd."""
    files = list(libraries)
    if not files or not sys.platform.startswith("linux") or not shutil.which("ldd"):
        return []
    linked = subprocess.run(["ldd", *files], capture_output=True, text=True, check=False)  # noqa: S607 - our own
    return parse_ldd(linked.stdout)


def parse_ldd(text: str) -> list[str]:
    """Return the names of the libraries that ldd reports as not found."""
    return sorted(set(re.findall(r"^\s*(\S+) => not found", text, re.MULTILINE)))


if __name__ == "__main__":
    sys.exit(main())
