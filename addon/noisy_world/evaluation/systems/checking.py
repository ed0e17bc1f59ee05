# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a system can be run here, before anything is made for it: its program, its environment, its GPU."""

import json
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from ...core.errors import MissingDependencyError
from .definition import STUDY_NAMES, System, filled
from .environments import environment_folder, environment_python

PACKAGE_FOLDER = Path(__file__).resolve().parents[3]
PROGRAMS = Path(__file__).resolve().parent / "programs"
GPU_DEVICES = (Path("/dev/nvidiactl"), Path("/dev/dxg"))
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
VERSIONS_LIMIT_S = 120.0
_OF_A_RUN = dict.fromkeys(("frames", "sequence", "out", *STUDY_NAMES), "")
"""Placeholders that have no value before a run."""


def check_system(system: System) -> dict[str, str]:
    """Return the versions of a system that can be run here.

    Raises MissingDependencyError with the remedy where its environment, its program or its GPU is not there, or its
    command for versions fails.
    """
    return system_versions(system)


@cache
def system_versions(system: System) -> dict[str, str]:
    """Return what a system says of its versions, asked once. Raises MissingDependencyError."""
    if sys.platform == "win32":
        raise _missing(system, "systems are run on Linux and macOS, also in Windows' own Linux")
    if system.environment and not environment_python(system.environment).exists():
        raise _missing(system, f"there is no environment {environment_folder(system.environment)}")
    if system.gpu and not any(device.exists() for device in GPU_DEVICES):
        raise _missing(system, "no NVIDIA GPU is here")
    (program,) = filled(system.command[:1], {**command_values(system), **_OF_A_RUN})
    if shutil.which(program) is None:
        raise _missing(system, f"there is no program {program}")
    return _asked_versions(system) if system.versions else {}


def command_values(system: System) -> dict[str, Path | str]:
    """Return the values of the placeholders that are the same for all runs of a system."""
    named = system.environment
    return {
        "python": environment_python(named) if named else sys.executable,
        "environment": environment_folder(named) if named else "",
        "programs": PROGRAMS,
        "here": system.file.parent,
    }


def variables_of(system: System) -> dict[str, str]:
    """Return the environment variables of a system's processes."""
    own = dict(os.environ)
    for name in ("PYTHONPATH", "PYTHONHOME"):
        own.pop(name, None)
    if not system.environment:  # its {python} is this one, which may have this package from a checkout
        own["PYTHONPATH"] = os.pathsep.join(filter(None, (str(PACKAGE_FOLDER), os.environ.get("PYTHONPATH"))))
    own["PYTHONUNBUFFERED"] = "1"  # so that the log of a process that is ended is whole
    if system.threads is not None:
        own.update(dict.fromkeys(THREAD_VARIABLES, str(system.threads)))
    return own | dict(variable.split("=", 1) for variable in system.variables)


def _asked_versions(system: System) -> dict[str, str]:
    values = {**command_values(system), **_OF_A_RUN}
    try:
        done = subprocess.run(  # noqa: S603 - what the definition says
            filled(system.versions, values),
            capture_output=True,
            stdin=subprocess.DEVNULL,
            env=variables_of(system),
            timeout=VERSIONS_LIMIT_S,
            check=False,
        )
    except OSError as error:
        raise _missing(system, f"{error.filename}: {error.strerror}") from error
    except subprocess.TimeoutExpired as error:
        raise _missing(system, f"its command for versions took more than {VERSIONS_LIMIT_S:g} s") from error
    if done.returncode != 0:
        said = [line for line in done.stderr.decode(errors="replace").splitlines() if line.strip()]
        raise _missing(system, said[-1] if said else f"its command for versions ended with {done.returncode}")
    return _texts(system, done.stdout)


def _texts(system: System, said: bytes) -> dict[str, str]:
    """Return the object of texts in the last line of what a command said: libraries may speak before it."""
    lines = said.decode(errors="replace").strip().splitlines()
    try:
        value: Any = json.loads(lines[-1] if lines else "")
    except ValueError:
        value = None
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        problem = "its command for versions does not print a JSON object of texts in its last line"
        raise _missing(system, problem)
    return {name: value[name] for name in sorted(value)}


def _missing(system: System, problem: str) -> MissingDependencyError:
    remedy = f"; {system.remedy}" if system.remedy else ""
    return MissingDependencyError(f"system {system.name} cannot be run here: {problem}{remedy}")
