# SPDX-License-Identifier: GPL-3.0-or-later
"""Starts a neural system on the frames that it is given: `python -m noisy_world.evaluation.systems.configurations`.

It writes what the system reads into the folder of the run, and becomes the system, in its own environment.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from ....core.errors import InputError, MissingDependencyError, NoisyWorldError
from ....core.regular_files import read_text
from ..environments import environment_folder, environment_python
from . import CONFIGURATIONS, Configuration

# What the versions of a result depend on, told by the system's own Python.
_TELL = (
    "import json, platform\n"
    "import torch\n"
    "print(json.dumps({'python': platform.python_version(), 'torch': torch.__version__}))\n"
)


def main(words: list[str] | None = None) -> None:
    """Run the command line. words: by default the process's own."""
    parser = argparse.ArgumentParser(
        prog="python -m noisy_world.evaluation.systems.configurations", description=__doc__
    )
    parser.add_argument("system", choices=CONFIGURATIONS)
    parser.add_argument("frames", nargs="?", type=Path, help="the index of the frames that the system is given")
    parser.add_argument("out", nargs="?", type=Path, help="the folder that the system writes into")
    parser.add_argument("--versions", action="store_true", help="print the versions as a JSON object, and end")
    arguments = parser.parse_args(words)
    chosen = CONFIGURATIONS[arguments.system]
    try:
        checkout = checked_checkout(chosen)
        if arguments.versions:
            sys.stdout.write(json.dumps(versions(chosen, checkout), sort_keys=True) + "\n")
            return
        if arguments.out is None:
            parser.error("give the index of the frames and the folder to write into")
        started = chosen.write(_read_index(arguments.frames), arguments.out.resolve())
    except NoisyWorldError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    _become(environment_python(chosen.environment), started, checkout)


def checked_checkout(chosen: Configuration) -> Path:
    """Return the folder of a system's code. Raises MissingDependencyError where it or its Python is not there."""
    folder = environment_folder(chosen.environment)
    if not environment_python(chosen.environment).exists():
        raise MissingDependencyError(f"there is no Python of the system in {folder / 'bin'}")
    checkout = folder / "checkout"
    lacking = next((name for name in chosen.programs if not (checkout / name).is_file()), None)
    if lacking is not None:
        raise MissingDependencyError(f"there is no {lacking} in {checkout}, where the code of {chosen.home} has to be")
    return checkout.resolve()


def versions(chosen: Configuration, checkout: Path) -> dict[str, str]:
    """Return the commit of a system's code, and the versions of its Python and torch. Raises MissingDependencyError."""
    output = _said([str(environment_python(chosen.environment)), "-c", _TELL], checkout)
    try:
        found = {name: str(value) for name, value in json.loads(output.splitlines()[-1]).items()}
    except (ValueError, IndexError, AttributeError) as error:
        raise MissingDependencyError(f"its Python does not tell the version of torch: {output[-200:]}") from error
    try:
        found["commit"] = _said(["git", "rev-parse", "HEAD"], checkout).strip()
    except MissingDependencyError:
        found["commit"] = "unknown"  # no repository, or no git
    return found


def _said(command: list[str], folder: Path) -> str:
    """Return what a command says. Raises MissingDependencyError with its last line where it fails."""
    try:
        done = subprocess.run(  # noqa: S603 - the system's own Python, and git
            command, cwd=folder, env=_environment(), capture_output=True, check=False, timeout=110
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingDependencyError(f"{command[0]} cannot be run: {error}") from error
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or [f"status {done.returncode}"]
        raise MissingDependencyError(lines[-1], file=command[0])
    return done.stdout.decode(errors="replace")


def _environment() -> dict[str, str]:
    """Return the environment variables of the system: without the paths of our Python."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}


def _read_index(path: Path) -> dict:
    try:
        return json.loads(read_text(path))
    except (OSError, ValueError) as error:
        raise InputError(path, f"is no index of frames: {error}") from error


def _become(python: Path, arguments: list[str], checkout: Path) -> NoReturn:
    os.chdir(checkout)
    os.execve(python, [str(python), *arguments], _environment())  # noqa: S606 - no shell is wanted


if __name__ == "__main__":
    main()
