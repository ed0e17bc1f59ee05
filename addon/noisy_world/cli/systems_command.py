# SPDX-License-Identifier: GPL-3.0-or-later
"""`systems`: list the SLAM systems that come with Noisy World and whether they can be run here; install one."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .command import Command
from .entry import Entry, say
from .parser import Parser
from .places import folder

if TYPE_CHECKING:
    from ..evaluation.systems.building import AuthorsSource
    from ..evaluation.systems.definition import System


def _systems(options: argparse.Namespace, entry: Entry) -> int:
    return _install_system(options, entry) if options.install else _list_systems()


def _list_systems() -> int:
    """Print each system, what it needs, and whether it can be run here."""
    from ..evaluation.systems.registry import distribution_of, find_system, system_names

    for name in system_names():
        system = find_system(name)
        problem = _problem(system)
        brought_by = distribution_of(name)
        origin = f" (from {brought_by})" if brought_by else ""
        print(f"{name}{origin}: {f'cannot be run here: {problem}' if problem else 'can be run here'}")
        print(f"    {system.about}")
        print(f"    needs {_needs(system)}")
    return 0


def _install_system(options: argparse.Namespace, entry: Entry) -> int:
    """Make what a system needs, and say that it can be run."""
    from ..core.errors import InputError, MissingDependencyError
    from ..evaluation.systems.building import CLONED
    from ..evaluation.systems.checking import check_system, system_versions
    from ..evaluation.systems.environments import FOLDER_VARIABLE, environment_folder
    from ..evaluation.systems.installing import ENVIRONMENT
    from ..evaluation.systems.registry import find_system
    from .missing import blender_problem

    system = find_system(options.install, "install")
    published = CLONED.get(system.environment)
    if options.source and published is None:
        raise InputError("--source", f"is given, but {system.name} is not built from source", remedy="leave it out")
    if system.environment != ENVIRONMENT and published is None:
        if system.remedy:
            raise InputError(system.name, "is not installed by this command", remedy=system.remedy)
        check_system(system)
        print(f"{system.name} needs no installation")
        return 0
    if problem := blender_problem(entry):  # the vocabulary's pictures are rendered
        raise MissingDependencyError(problem)
    found = environment_folder(system.environment)
    into = found if options.into is None else options.into.resolve() / found.name
    made = _packages(system, into, options) if published is None else _built(published, into, options)
    print(f"{'installed' if made else 'is there already:'} {into}")
    if into == found:
        system_versions.cache_clear()
        check_system(system)
    else:
        print(f"to use it, set {FOLDER_VARIABLE}: export {FOLDER_VARIABLE}={into.parent}")
    return 0


def _packages(system: "System", into: Path, options: argparse.Namespace) -> bool:
    """Make the environment of packages; tell whether it was not there."""
    from ..core.errors import MissingDependencyError
    from ..evaluation.systems.installing import install as make
    from .system_libraries import missing_for, provide

    made = make(into, options.python, say)
    packages = "lib/python3.*/site-packages"
    libraries = [*into.glob(f"{packages}/orbslam3/*.so"), *into.glob(f"{packages}/open3d/cpu/pybind*.so")]
    if problem := provide(f"{system.name}, in {into},", lambda: missing_for(libraries)):
        raise MissingDependencyError(problem)
    return made


def _built(published: "AuthorsSource", into: Path, options: argparse.Namespace) -> bool:
    """Build a system from its source; tell whether it was not there."""
    from ..core.errors import InputError
    from ..evaluation.systems.building import build

    if options.source is None:
        raise InputError("--source", f"is needed: the folder of {published.name}'s source", remedy=published.remedy)
    if options.python is not None:
        raise InputError("--python", f"is given, but {published.name} is built from C++", remedy="leave it out")
    return build(published, options.source, into, say)


def _problem(system: "System") -> str:
    """Return why a system cannot be run here; "" where it can."""
    from ..core.errors import MissingDependencyError
    from ..evaluation.systems.checking import check_system

    try:
        check_system(system)
    except MissingDependencyError as error:
        return str(error).removeprefix(f"system {system.name} cannot be run here: ").removesuffix(f"; {system.remedy}")
    return ""


def _needs(system: "System") -> str:
    from ..evaluation.systems.building import CLONED

    if system.environment in CLONED:
        return f"its own source, a compiler and libraries; {system.remedy}"
    if system.environment:
        return f"an environment of its own, made from a Python 3.12 or 3.11; {system.remedy}"
    parts = [*(["an NVIDIA GPU"] if system.gpu else []), *(["its own code"] if system.remedy else [])]
    return " and ".join(parts) + f"; {system.remedy}" if parts else "nothing more"


def _systems_options(parser: Parser) -> None:
    parser.set_defaults(install=None)
    actions = parser.add_subparsers(metavar="install", title="to install one")
    installing = actions.add_parser(
        "install",
        help="install a system: 'install orb_slam3'",
        description="Install a system that needs an environment of its own: with packages pinned by hashes (770 MB) in "
        ".venv-slam, or, with --source, built from its authors' source in .venv-orb-slam2 or .venv-orb-slam3.",
    )
    installing.add_argument("install", metavar="SYSTEM", help="its name, orb_slam3 for instance")
    installing.add_argument(
        "--into",
        metavar="DIR",
        type=folder,
        help="the folder that it is made in (default: $NOISY_WORLD_ENVIRONMENTS, a checkout, or the user's "
        "data folder)",
    )
    installing.add_argument(
        "--source",
        metavar="DIR",
        type=folder,
        help="of orb_slam2 or orb_slam3_source: its source, which you have cloned",
    )
    installing.add_argument("--python", metavar="PATH", help="a Python 3.12 or 3.11 (default: one that is found)")


SYSTEMS = Command(
    name="systems",
    group="evaluate SLAM systems",
    help="list the systems and whether they can be run here; install one",
    description="List the SLAM systems that come with Noisy World, what each needs, and whether it can run here.",
    options=_systems_options,
    run=_systems,
    stopped="the same command again begins anew",
)
