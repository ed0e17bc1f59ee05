# SPDX-License-Identifier: GPL-3.0-or-later
"""The packages that the add-on needs beside those of Blender, and the message where one is missing."""

import importlib.util
import sys
from collections.abc import Iterable
from pathlib import Path

NEEDED = {
    "numpy": "numpy",
    "yaml": "pyyaml",
    "cv2": "opencv-contrib-python-headless",
    "OpenEXR": "OpenEXR",
    "deflate": "deflate",
    "tqdm": "tqdm",
}


def missing_packages(modules: Iterable[str] = NEEDED) -> list[str]:
    """Return the packages of the modules that cannot be imported, by the names under which they are installed."""
    return [NEEDED.get(name, name) for name in modules if not _importable(name)]


def _importable(module: str) -> bool:
    if module in sys.modules:
        return sys.modules[module] is not None  # None forbids its import
    return importlib.util.find_spec(module) is not None


def missing_sentence(packages: Iterable[str], where: str, remedy: str) -> str:
    """Return one line: what is missing, for which Python, and what to do about it.

    where: whose Python it is, such as "this Blender's "; may be empty.
    """
    python = f"Python {sys.version_info.major}.{sys.version_info.minor}"
    return f"{', '.join(packages)}: missing in {where or 'this '}{python} on {sys.platform}; {remedy}"


def install_remedy(extension: Path) -> str:
    """Return a sentence on which zip to install instead of the extension in this folder."""
    wheels = sorted(path.name for path in (extension / "wheels").glob("*.whl"))
    if not wheels:
        return "install the zip that 'make extension' builds for this platform: it holds them"
    pythons = sorted({name.split("-")[-3].removeprefix("cp3") for name in wheels if "-cp31" in name})
    known = " and ".join(f"3.{minor}" for minor in pythons)
    return f"install the zip for this platform; the one installed holds {wheels[0].split('-')[-1][:-4]} for {known}"
