# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the definition of a SLAM system keeps its contract: it is run."""

from pathlib import Path

import numpy as np

from ..core.datasets.layouts import LAYOUTS, find_sequence
from ..core.datasets.layouts.layout import OutputFormat
from ..core.errors import NoisyWorldError
from ..core.regular_files import read_bytes
from ..evaluation.association import associate_poses
from ..evaluation.outcome import Outcome
from ..evaluation.systems.definition import System, read_system
from ..evaluation.systems.estimate_file import ESTIMATE, read_estimate_file
from ..evaluation.systems.running import run_system
from .layouts import write_sequence
from .rules import path, require

FRAMES = 10
LEAST_MATCHED = 3


def check_system(definition: Path, folder: Path, sequence: Path | None = None) -> None:
    """Check the definition of a system by running it twice. Raises AssertionError with the rule that it breaks.

    definition: its YAML file. folder: an empty one to work in. sequence: a recording that it can track; without one it
    is given a few frames of a synthetic one, in a layout that it reads, which is enough for what needs no features.

    The file is named like the system, which has a sentence on what it is. It can be run here, ends with exit status 0,
    and leaves an estimate of three frames or more whose stamps are those of the frames. If it says repeatable, two runs
    give the same estimate.
    """
    try:
        system = read_system(definition)
        name = system.name
        require(definition.stem == name, name, f"its file is named {definition.name}; name it {name}.yaml")
        require(system.about.endswith("."), name, "about has to be a sentence on what it is, with a full stop")
        given = _sequence(system, folder / "sequence") if sequence is None else sequence
        estimates = [_estimate(system, given, folder / f"run{number}") for number in (1, 2)]
    except NoisyWorldError as error:
        raise AssertionError(str(error)) from error
    if system.repeatable:
        same = estimates[0] == estimates[1]
        require(same, name, "two runs give different estimates; say repeatable: false, or seed what it draws")


def _sequence(system: System, folder: Path) -> Path:
    layout = LAYOUTS[system.reads.layouts[0] if system.reads.layouts else "tum"]
    written = OutputFormat(layout, layout.images[0], layout.colours[0], ("rgb", "depth"), layout.depth_scale_per_m)
    write_sequence(written, path(FRAMES), folder / "scene")
    return folder / "scene"


def _estimate(system: System, sequence: Path, folder: Path) -> bytes:
    """Run a system, check what it leaves, and return its estimate's file."""
    record = run_system(system, sequence, folder)
    ended = f"a run ended as {record.outcome}: {record.detail}; {folder / 'log.txt'} has what it said"
    require(record.outcome is Outcome.FINISHED, system.name, ended)
    estimate = read_estimate_file(folder / ESTIMATE)
    stamps_s = find_sequence(sequence).stamps.rgb.seconds
    matched = len(associate_poses(estimate.stamps_s, np.asarray(stamps_s))[0])
    message = f"{matched} of its {len(estimate)} poses have the stamp of a frame; {LEAST_MATCHED} or more have to"
    require(matched >= LEAST_MATCHED, system.name, f"{message}: see writes.stamps")
    return read_bytes(folder / ESTIMATE)
