# SPDX-License-Identifier: GPL-3.0-or-later
"""Which OpenCV is here: packages of several names put theirs into one folder, and pip sees no conflict in that."""

import importlib
import importlib.util
import re
import shlex
import sys
from pathlib import Path

from .errors import MissingDependencyError
from .extras import pip_command
from .regular_files import read_text
from .requirements import NEEDED

OLDEST = 5
"""OpenCV 4 refuses tables of 16 bits, and its warps, blurs and exponentials give other pixels (snow: by 44 of 255)."""


def check_opencv() -> None:
    """Raise MissingDependencyError, with the remedy, where OpenCV is too old; nothing where it is missing."""
    if problem := old_opencv():
        raise MissingDependencyError(problem)


def old_opencv() -> str:
    """Return one line on an OpenCV that is too old, which package brought it and what to do; "" where it is none."""
    version = _version()
    if not version or int(version.partition(".")[0]) >= OLDEST:
        return ""
    needed = NEEDED["cv2"]
    others = _packages_beside(needed)
    whose = f", of the package {', '.join(others)}," if others else ""
    python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
    problem = f"OpenCV is {version}{whose} in this {python}, and {OLDEST} is needed, as older ones give other pixels"
    # What is uninstalled takes the folder along, so ours has to be put there again.
    again = pip_command(["--force-reinstall", "--no-deps", f"{needed}>={OLDEST}.0"])
    first = f"uninstall {shlex.join(others)}, then " if others else ""
    return f"{problem}; {first}run: {again}"


def _version() -> str:
    """Return the version of the OpenCV here, "" without one; it is imported only where no file says its version."""
    module = sys.modules.get("cv2")
    if module is None and ("cv2" in sys.modules or importlib.util.find_spec("cv2") is None):
        return ""
    if module is None:
        spec = importlib.util.find_spec("cv2")
        file = Path(spec.origin).with_name("version.py") if spec is not None and spec.origin else None
        text = read_text(file) if file is not None and file.is_file() else ""
        if found := re.search(r'opencv_version = "([\d.]+)"', text):
            return found[1]
        module = importlib.import_module("cv2")  # a system's package has no such file
    found = re.match(r"[\d.]+", str(getattr(module, "__version__", "")))
    return found[0] if found else ""


def _packages_beside(needed: str) -> list[str]:
    """Return the installed packages that bring OpenCV, but for the one that is needed."""
    import importlib.metadata

    names = {item.name for item in importlib.metadata.distributions() if item.name.startswith("opencv")}
    return sorted(names - {needed})
