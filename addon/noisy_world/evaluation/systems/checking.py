# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a system can be run here, before anything is made for it: its program, its environment, its GPU."""

import os
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from ...core.datasets.json_text import parse_json
from ...core.errors import MissingDependencyError
from ...core.regular_files import read_text
from ...core.shipped import PACKAGE
from .definition import STUDY_NAMES, System, filled
from .environments import environment_folder, environment_python
from .isolation import isolated, isolated_variables, isolation_problem, own_folders, program_folders
from .leavings import sentence
from .watching import watched

PROGRAMS = PACKAGE / "evaluate" / "programs"
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
    if system.environment and not environment_python(system.environment).exists():
        raise _missing(system, f"there is no environment {environment_folder(system.environment)}")
    if system.gpu and not any(device.exists() for device in GPU_DEVICES):
        raise _missing(system, "no NVIDIA GPU is here")
    program = _program(system)
    if shutil.which(program) is None:
        raise _missing(system, f"there is no program {program}")
    if system.isolate == "bubblewrap" and (problem := isolation_problem()):
        message = f"system {system.name} cannot be isolated by bubblewrap: {problem}"
        raise MissingDependencyError(f"{message}; or leave out isolate")
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
        own["PYTHONPATH"] = os.pathsep.join(filter(None, (str(PACKAGE.parent), os.environ.get("PYTHONPATH"))))
    own["PYTHONUNBUFFERED"] = "1"  # so that the log of a process that is ended is whole
    if system.threads is not None:
        own.update(dict.fromkeys(THREAD_VARIABLES, str(system.threads)))
    return own | dict(variable.split("=", 1) for variable in system.variables)


def prepared(system: System, command: list[str], work: Path) -> tuple[list[str], dict[str, str]]:
    """Return a command as it is started, isolated where the system is, and its environment variables.

    work: a folder of ours with the folders out, tmp and given.
    """
    variables = variables_of(system)
    if system.isolate == "none":
        return command, variables
    reads = [work / "given", PACKAGE.parent, *own_folders(), *program_folders(command[0]), *reached(system)]
    own = [*(variable.split("=", 1)[0] for variable in system.variables), *THREAD_VARIABLES]
    inside = isolated(command, reads=reads, out=work / "out", temporary=work / "tmp", gpu=system.gpu)
    return inside, isolated_variables(variables, own)


def reached(system: System) -> list[Path]:
    """Return what an isolated system may read by its definition: its folder where it names it, and what it reaches."""
    words = [*system.command, *system.map_arguments, *system.versions, *system.variables]
    named = [system.file.parent] if any("{here}" in word for word in words) else []
    if system.environment:
        named.append(environment_folder(system.environment))
    return [*named, *((system.file.parent / Path(name).expanduser()) for name in system.reaches)]


def _program(system: System) -> str:
    (program,) = filled(system.command[:1], {**command_values(system), **_OF_A_RUN})
    return program


def _asked_versions(system: System) -> dict[str, str]:
    command = filled(system.versions, {**command_values(system), **_OF_A_RUN})
    with tempfile.TemporaryDirectory(prefix="noisy-world-versions-", ignore_cleanup_errors=True) as name:
        work = Path(name).resolve()
        for folder in ("out", "tmp", "given"):
            (work / folder).mkdir()
        started, variables = prepared(system, command, work)
        said, errors = work / "said.txt", work / "errors.txt"
        outcome = watched(
            started,
            variables,
            [work / "out", work / "tmp"],
            said,
            system.limits,
            limit_s=VERSIONS_LIMIT_S,
            grace_s=0.0,
            errors=errors,
        )
        try:
            texts = [read_text(file, errors="replace") for file in (said, errors)]
        except OSError:  # it has removed or replaced them, so it says nothing
            texts = ["", ""]
    if outcome.ended == "limit":
        raise _missing(system, f"its command for versions took more than {VERSIONS_LIMIT_S:g} s")
    if outcome.ended != "itself":
        raise _missing(system, sentence(f"its command for versions failed: {outcome.problem}"))
    if outcome.status != 0:
        lines = [line for line in texts[1].splitlines() if line.strip()]
        raise _missing(
            system, sentence(lines[-1]) if lines else f"its command for versions ended with {outcome.status}"
        )
    return _texts(system, texts[0])


def _texts(system: System, said: str) -> dict[str, str]:
    """Return the object of texts in the last line of what a command said: libraries may speak before it."""
    lines = said.strip().splitlines()
    try:
        value: Any = parse_json(lines[-1] if lines else "")
    except ValueError:
        value = None
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        problem = "its command for versions does not print a JSON object of texts in its last line"
        raise _missing(system, problem)
    return {sentence(name): sentence(value[name]) for name in sorted(value)}


def _missing(system: System, problem: str) -> MissingDependencyError:
    remedy = f"; {system.remedy}" if system.remedy else ""
    return MissingDependencyError(f"system {system.name} cannot be run here: {problem}{remedy}")
