# SPDX-License-Identifier: GPL-3.0-or-later
"""The packages that are needed, those of the extras, and the commands that install them."""

import importlib
import importlib.util
import json
import platform
import re
import shlex
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .errors import MissingDependencyError
from .file_access import read_text

NEEDED = {
    "numpy": "numpy",
    "yaml": "pyyaml",
    "cv2": "opencv-contrib-python-headless",
    "OpenEXR": "OpenEXR",
    "deflate": "deflate",
    "simplejpeg": "simplejpeg",
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


# Files that come with Noisy World and lie beside its code: in the package, or at the top of a checkout.


PACKAGE = Path(__file__).resolve().parents[1]
"""The folder of the package noisy_world."""


def shipped(name: str) -> Path:
    """Return a file or folder that is shipped, such as presets."""
    for folder in (PACKAGE, PACKAGE.parents[1]):  # installed, or in a checkout
        if (folder / name).exists():
            return folder / name
    raise RuntimeError(f"no {name} at {PACKAGE} or above")


def checkout() -> Path | None:
    """Return the checkout that this package is run from; None where it was installed."""
    top = PACKAGE.parents[1]
    return top if (top / "pyproject.toml").is_file() and (top / "blender_manifest.toml").is_file() else None


def package_version() -> str:
    """Return this package's version from blender_manifest.toml, its only source: in the package or a folder above."""
    for folder in (PACKAGE, *PACKAGE.parents[:2]):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file():
            found = re.search(r'^version\s*=\s*"([^"]+)"', read_text(manifest), re.MULTILINE)
            if found:
                return found[1]
    raise RuntimeError(f"no blender_manifest.toml with a version at {PACKAGE} or above")


# The extras of the Python package, and the command that installs one, however the package came here.


DISTRIBUTION = "noisy-world"

_EMBREEX = 'embreex>=4.4; sys_platform != "linux" or platform_machine == "x86_64"'
_NUMBA = 'numba>=0.60; sys_platform != "darwin" or platform_machine != "x86_64" or python_version < "3.14"'
EXTRAS = {
    "blender": ('bpy==5.2.3; python_version == "3.13"',),
    "embree": (_EMBREEX, _NUMBA),
    "cloud": ("fsspec>=2026.2", "pyarrow>=23", "s3fs>=2026.2"),
    "cluster": ("ray>=2.50",),
    "simulate": ("mujoco>=3.3,<4",),
    "ros": ("rosbags>=0.11",),
    "view": ("rerun-sdk>=0.30",),
    "evaluate": (
        _EMBREEX,
        'gtsam>=4.3; sys_platform != "win32"',
        "jinja2>=3.1",
        "matplotlib>=3.9",
        _NUMBA,
        "pandas>=2.2.2",
        "scipy>=1.13",
        "tabulate>=0.9",
    ),
}
"""What each extra brings, as pyproject.toml has it."""

BLENDER_PYTHON = (3, 13)  # which Blender's package has wheels for


def need(modules: Iterable[str], extra: str, *, for_what: str = "", otherwise: str = "") -> None:
    """Raise MissingDependencyError, with the command that installs the extra, where a module cannot be imported.

    Of a module that no package brings to this machine, it says that.

    for_what: what needs them, in front of the line. otherwise: what else can be done, at its end.
    """
    if missing := missing_packages(modules):
        for name in missing:
            if where := unavailable(name):
                sentence = f"{name} has no package for {where}" + (f"; {otherwise}" if otherwise else "")
                raise MissingDependencyError(f"{for_what}: {sentence}" if for_what else sentence)
        remedy = f"run: {install_command(extra)}" + (f", or {otherwise}" if otherwise else "")
        sentence = missing_sentence(missing, "", remedy)
        raise MissingDependencyError(f"{for_what}: {sentence}" if for_what else sentence)


def unavailable(module: str) -> str:
    """Return for which kind of machine, as this one is, no package brings a module; "" where one does, or may."""
    machine = platform.machine()
    if module == "gtsam" and sys.platform == "win32":
        return "Windows"
    if module == "embreex" and sys.platform == "linux" and machine != "x86_64":
        return f"Linux on {machine}"
    if module == "numba" and sys.platform == "darwin" and machine == "x86_64" and sys.version_info >= (3, 14):
        return "macOS on Intel under Python 3.14"
    return ""


def blender_missing(for_what: str = "", *, otherwise: str = "", remedy: str = "") -> str:
    """Return one line on Blender's package where it is missing, what to do about it included; "" where it is there.

    for_what: what needs it, in front of the line. otherwise: what else can be done, at its end. remedy: what to do
    instead of installing the extra.
    """
    missing = missing_packages(["bpy"])
    if not missing:
        return ""
    sentence = missing_sentence(missing, "", (remedy or _blender_remedy()) + (f", or {otherwise}" if otherwise else ""))
    return f"{for_what}: {sentence}" if for_what else sentence


def _blender_remedy() -> str:
    if sys.version_info[:2] == BLENDER_PYTHON:
        return f"run: {install_command('blender')}"
    version = ".".join(map(str, BLENDER_PYTHON))
    command = shlex.join([f"python{version}", "-m", "pip", "install", *(_source("blender") or EXTRAS["blender"])])
    return (
        f"the extra blender, which brings it, is for Python {version} alone: in an environment of that run: {command}"
    )


def install_command(extra: str) -> str:
    """Return the command that installs an extra into this Python.

    It names the checkout, wheel or repository that the package came from. Where that is gone, or the package is an
    extension of Blender, it names the extra's own packages.
    """
    found = _source(extra)
    return pip_command(EXTRAS[extra] if found is None else found)


def pip_command(words: Iterable[str]) -> str:
    """Return the command that installs what pip's words name into this Python."""
    if importlib.util.find_spec("pip") is None:  # an environment that uv has made
        return shlex.join(["uv", "pip", "install", "--python", sys.executable, *words])
    return shlex.join([sys.executable, "-m", "pip", "install", *words])


def _source(extra: str) -> list[str] | None:
    """Return the words that name the extra of where the package came from; None where that is unknown or gone."""
    import importlib.metadata

    if (top := checkout()) is not None:
        return [f"{top}[{extra}]"]
    try:
        record = importlib.metadata.distribution(DISTRIBUTION).read_text("direct_url.json")
    except importlib.metadata.PackageNotFoundError:
        return None
    if record is None:  # it came from an index
        return [f"{DISTRIBUTION}[{extra}]"]
    return _named(json.loads(record), extra)


def _named(record: dict[str, Any], extra: str) -> list[str] | None:
    """Return the words that name the extra of what `direct_url.json` records (PEP 610)."""
    import urllib.parse  # with the next
    import urllib.request

    address = urllib.parse.urlsplit(record["url"])
    if address.scheme == "file":
        path = Path(urllib.request.url2pathname(address.path))
        return [f"{path}[{extra}]"] if path.exists() else None
    kind = f"{record['vcs_info']['vcs']}+" if "vcs_info" in record else ""
    at = f"@{record['vcs_info']['commit_id']}" if kind else ""
    below = f"#subdirectory={record['subdirectory']}" if "subdirectory" in record else ""
    return [f"{DISTRIBUTION}[{extra}] @ {kind}{record['url']}{at}{below}"]


# Which OpenCV is here: packages of several names put theirs into one folder, and pip sees no conflict in that.


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
    others = _other_packages(needed)
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


def _other_packages(needed: str) -> list[str]:
    """Return the installed packages that bring OpenCV, but for the one that is needed."""
    import importlib.metadata

    names = {item.name for item in importlib.metadata.distributions() if item.name.startswith("opencv")}
    return sorted(names - {needed})
