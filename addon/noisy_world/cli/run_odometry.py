# SPDX-License-Identifier: GPL-3.0-or-later
"""`run-odometry`: follow the camera through sequences on disk with rgbd_odometry, which comes with Noisy World."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.progress import JsonProgress, Progress
from .arguments import add_progress_option
from .command import Command
from .entry import Entry
from .parser import Parser
from .places import out_path, path

if TYPE_CHECKING:
    import threading

INDEX = "frames.json"


def _odometry_options(parser: Parser) -> None:
    parser.add_argument("dataset", metavar="DATASET", type=path, help="the folder of a dataset, or of a sequence")
    parser.add_argument("out", metavar="OUT", type=out_path, help="folder for what is found: a folder a sequence")
    parser.add_argument(
        "--only",
        metavar="NAME",
        action="append",
        help="only the sequences of this name, SETTING/SCENE in a dataset, * allowed; may be repeated",
    )
    add_progress_option(parser)


def _track(options: argparse.Namespace, _: Entry) -> int:
    """Follow the camera through the sequences that are wanted, and say how far each could be followed.

    Where the camera is lost the exit status is 0 too, as that is a result.
    """
    from ..core.errors import InputError
    from ..core.presets.selection import selected
    from ..core.schema import ConfigPath
    from ..recipes.from_files import OpenedFolder, SequenceOfFiles
    from ..recipes.opening import open_path
    from .running import listener

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
    from ..core.datasets.storage import ELSEWHERE, storage_errors
    from ..core.errors import InterruptedRunError
    from ..evaluation.odometry.frames import read_index
    from ..evaluation.odometry.running import run
    from ..evaluation.odometry.written import write_results
    from ..evaluation.systems.index import given_sequence

    given = given_sequence(sequence)
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
