# SPDX-License-Identifier: GPL-3.0-or-later
"""`systems`, `run-odometry`: the SLAM systems that are here, and the one that comes with Noisy World."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import InputError, InterruptedRunError, MissingDependencyError
from ..core.progress import JsonProgress, Progress
from ..core.schema import ConfigPath
from .arguments import Parser, add_progress_option, folder, out_path, path
from .command import Command
from .entry import Entry, listener, say

if TYPE_CHECKING:
    import threading

    from ..evaluate.system_installation import AuthorsSource
    from ..evaluate.systems import System


def _systems(options: argparse.Namespace, entry: Entry) -> int:
    return _install_system(options, entry) if options.install else _list_systems()


def _list_systems() -> int:
    """Print each system, what it needs, and whether it can be run here."""
    from ..evaluate.systems import distribution_of, find_system, system_names

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
    from ..evaluate.system_installation import CLONED, ENVIRONMENT
    from ..evaluate.system_runs import check_system, system_versions
    from ..evaluate.systems import FOLDER_VARIABLE, environment_folder, find_system
    from .entry import blender_problem

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
    from ..evaluate.system_installation import install as make
    from .system_libraries import missing_for, provide

    made = make(into, options.python, say)
    packages = "lib/python3.*/site-packages"
    libraries = [*into.glob(f"{packages}/orbslam3/*.so"), *into.glob(f"{packages}/open3d/cpu/pybind*.so")]
    if problem := provide(f"{system.name}, in {into},", lambda: missing_for(libraries)):
        raise MissingDependencyError(problem)
    return made


def _built(published: "AuthorsSource", into: Path, options: argparse.Namespace) -> bool:
    """Build a system from its source; tell whether it was not there."""
    from ..evaluate.system_installation import build

    if options.source is None:
        raise InputError("--source", f"is needed: the folder of {published.name}'s source", remedy=published.remedy)
    if options.python is not None:
        raise InputError("--python", f"is given, but {published.name} is built from C++", remedy="leave it out")
    return build(published, options.source, into, say)


def _problem(system: "System") -> str:
    """Return why a system cannot be run here; "" where it can."""
    from ..evaluate.system_runs import check_system

    try:
        check_system(system)
    except MissingDependencyError as error:
        return str(error).removeprefix(f"system {system.name} cannot be run here: ").removesuffix(f"; {system.remedy}")
    return ""


def _needs(system: "System") -> str:
    from ..evaluate.system_installation import CLONED

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
    installing.option("install SYSTEM", "its name, orb_slam3 for instance")
    installing.option(
        "--into DIR",
        "the folder that it is made in (default: $NOISY_WORLD_ENVIRONMENTS, a checkout, or the user's data folder)",
        type=folder,
    )
    installing.option(
        "--source DIR", "of orb_slam2 or orb_slam3_source: its source, which you have cloned", type=folder
    )
    installing.option("--python PATH", "a Python 3.12 or 3.11 (default: one that is found)")


SYSTEMS = Command(
    name="systems",
    order=180,
    group="evaluate SLAM systems",
    help="list the systems and whether they can be run here; install one",
    description="List the SLAM systems that come with Noisy World, what each needs, and whether it can run here.",
    options=_systems_options,
    run=_systems,
    stopped="the same command again begins anew",
)


# --- `run-odometry` ---


INDEX = "frames.json"


def _odometry_options(parser: Parser) -> None:
    parser.option("dataset DATASET", "the folder of a dataset, or of a sequence", type=path)
    parser.option("out OUT", "folder for what is found: a folder a sequence", type=out_path)
    parser.option(
        "--only NAME",
        "only the sequences of this name, SETTING/SCENE in a dataset, * allowed; may be repeated",
        action="append",
    )
    add_progress_option(parser)


def _track(options: argparse.Namespace, _: Entry) -> int:
    """Follow the camera through the sequences that are wanted, and say how far each could be followed.

    Where the camera is lost the exit status is 0 too, as that is a result.
    """
    from ..dataset.loader import OpenedFolder, SequenceOfFiles
    from ..dataset.opening import open_path
    from ..preset.names import selected

    if not options.dataset.is_dir():
        raise InputError(options.dataset, "no such folder", remedy="name that of a dataset, or of a sequence")
    opened = open_path(options.dataset)
    if not isinstance(opened, OpenedFolder):
        raise InputError(options.dataset, "holds sequences in tars, and their frames are read", remedy="unpack them")
    names = selected(list(opened), options.only, ConfigPath(options.dataset).at("sequences"))
    progress, stop = listener(options.progress)
    results = []
    for name in names:
        sequence = opened[name]
        assert isinstance(sequence, SequenceOfFiles), "a folder's sequences are files"
        results.append(f"{name}: {_tracked(sequence.stored.folder, options.out / name, progress, stop)}")
    if isinstance(progress, JsonProgress):
        progress.tell({"result": "; ".join(results)})
    else:
        print("\n".join(results))
    return 0


def _tracked(sequence: Path, out: Path, progress: Progress, stop: "threading.Event") -> str:
    """Follow the camera through one sequence; return how it went. Raises InterruptedRunError."""
    from ..core.atomic_files import ELSEWHERE, storage_errors
    from ..evaluate.frame_tracking import write_results
    from ..evaluate.odometry import run
    from ..evaluate.system_input import read_index, sequence_input

    given = sequence_input(sequence)
    with storage_errors(out, ELSEWHERE):
        out.mkdir(parents=True, exist_ok=True)
    given.write_index(out / INDEX, None)
    result = run(read_index(out / INDEX), progress=progress, stopped=stop.is_set)
    if result.stopped:
        raise InterruptedRunError("stopped")
    write_results(out, result.frames, result.keyframes)
    return result.summary


RUN_ODOMETRY = Command(
    name="run-odometry",
    order=170,
    group="evaluate SLAM systems",
    help="follow the camera through a dataset with rgbd_odometry",
    description="Follow the camera through the sequences of a dataset with rgbd_odometry, which is given the "
    "frames and never the true poses. Writes estimate.txt, frames.csv and keyframes.txt for each; 'noisy-world "
    "score' compares them with the truth. Needs nothing but what generating needs; gtsam, where it is installed, "
    "closes loops.",
    options=_odometry_options,
    run=_track,
    needs=("numpy", "cv2", "yaml"),
    stopped="the sequences that were followed to their end are written",
)

COMMAND = RUN_ODOMETRY, SYSTEMS
