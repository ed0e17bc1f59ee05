# SPDX-License-Identifier: GPL-3.0-or-later
"""The extras of the Python package, and the command that installs one, however the package came here."""

import importlib.util
import json
import platform
import shlex
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .errors import MissingDependencyError
from .requirements import missing_packages, missing_sentence
from .shipped import checkout

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
    import urllib.parse  # noqa: PLC0415 - with the next
    import urllib.request

    address = urllib.parse.urlsplit(record["url"])
    if address.scheme == "file":
        path = Path(urllib.request.url2pathname(address.path))
        return [f"{path}[{extra}]"] if path.exists() else None
    kind = f"{record['vcs_info']['vcs']}+" if "vcs_info" in record else ""
    at = f"@{record['vcs_info']['commit_id']}" if kind else ""
    below = f"#subdirectory={record['subdirectory']}" if "subdirectory" in record else ""
    return [f"{DISTRIBUTION}[{extra}] @ {kind}{record['url']}{at}{below}"]
