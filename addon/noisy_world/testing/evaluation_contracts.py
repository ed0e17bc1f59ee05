# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests of what judges: metrics of paths and maps, and systems."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.errors import NoisyWorldError
from ..core.file_access import read_bytes
from ..core.trajectory import Trajectory
from ..evaluate.cases import ESTIMATE, Outcome, read_estimate_file
from ..evaluate.estimates import Estimate, associate_poses
from ..evaluate.map_metrics import MAP_METRICS, ComparedMap, MapMetric
from ..evaluate.metrics import Metric, TrajectoryMetric, checked_value, value_of
from ..evaluate.system_runs import run_system
from ..evaluate.systems import System, read_system
from ..evaluate.trajectory_scores import compare_poses
from ..evaluate.true_maps import TrueMap, true_map_of_mesh
from ..layouts import LAYOUTS, find_sequence
from ..layouts.layout import OutputFormat
from ..scenes.polygon_mesh import Mesh
from .dataset_contracts import write_sequence
from .frame_contracts import CAMERA, path, require, require_name

FRAMES = 60
TOLERANCE = 1e-6
ELSEWHERE = "is the truth in another world frame"
TREMBLES = "trembles"  # a path that trembles is longer, so not all that is better the higher it is sees an error
SUFFIXES = ("m", "s", "deg", "rad")
"""The units that a name ends with."""


def check_metric(metric: TrajectoryMetric) -> None:
    """Check a metric of paths. Raises AssertionError with the rule that it breaks.

    Its name ends with its unit where that is m, s, deg or rad, and its meaning is a sentence. It gives a finite number
    or None, the same twice, whatever an estimate is like, also of runs that failed where it says of_failed. Of an
    estimate that is the truth, an error (lower is better) is 0, and what is better the higher it is, is not lower than
    of one that lost frames. The world frame of the estimate changes nothing.
    """
    require(isinstance(metric, TrajectoryMetric), str(metric), f"is a {type(metric).__name__}, no TrajectoryMetric")
    name = metric.name
    check_words(metric)
    truth = path(FRAMES)
    best = _value(metric, Estimate(truth.stamps_s, truth.c2w), truth)
    require(best is not None, name, "has no value for an estimate that is the truth")
    assert best is not None
    if metric.better == "lower":
        require(abs(best) < TOLERANCE, name, f"is {best:g} for an estimate that is the truth, but lower is better: 0")
    for what, estimate in _estimates(truth):
        found = _value(metric, estimate, truth)
        if what == ELSEWHERE:
            equal = found is not None and abs(found - best) < TOLERANCE
            require(equal, name, f"is {found} for the truth in another world frame, but {best:g} in its own")
        elif found is None:
            continue
        elif metric.better == "lower":
            require(found > -TOLERANCE, name, f"is {found:g} for an estimate that {what}: better than the truth")
        elif metric.better == "higher" and what != TREMBLES:
            message = f"is {found:g} for an estimate that {what}, but {best:g} for the truth, and higher is better"
            require(found < best + TOLERANCE, name, message)
    still = Trajectory(np.tile(np.eye(4), (FRAMES, 1, 1)), truth.stamps_s)
    _value(metric, Estimate(still.stamps_s, still.c2w), still)


def check_words(metric: Metric) -> None:
    """Require that the name of a metric ends with its unit, and that its meaning is a sentence."""
    name = metric.name
    require_name(name)
    require(metric.meaning.endswith("."), name, "its meaning has to be a sentence, with a full stop")
    if metric.unit in SUFFIXES:
        message = f"is in {metric.unit}, so its name has to end with _{metric.unit}"
        require(name.endswith(f"_{metric.unit}"), name, message)


def _value(metric: TrajectoryMetric, estimate: Estimate, truth: Trajectory) -> float | None:
    """Return the value, which has to be the same twice and leave what is compared as it is."""
    compared = compare_poses(estimate, truth)
    compared.estimate.setflags(write=False)
    try:
        first, second = value_of(metric, compared), value_of(metric, compared)
    except NoisyWorldError as error:
        raise AssertionError(str(error)) from error
    except ValueError as error:
        require("read-only" not in str(error), metric.name, "changes the poses that it is given; copy them")
        raise
    require(first == second, metric.name, f"gives {first} and then {second} for the same poses")
    return first


def _estimates(truth: Trajectory) -> Iterator[tuple[str, Estimate]]:
    """Yield estimates that are worse than the truth, with what they do; and the truth in another world frame."""
    stamps_s, c2w = truth.stamps_s, truth.c2w
    elsewhere = np.eye(4)
    elsewhere[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    elsewhere[:3, 3] = (3.0, -2.0, 1.0)
    yield ELSEWHERE, Estimate(stamps_s, elsewhere @ c2w)
    trembling = np.array(c2w)
    trembling[:, :3, 3] += 0.02 * np.random.default_rng(1).standard_normal((len(c2w), 3))
    yield "loses every other frame", Estimate(stamps_s[::2], c2w[::2])
    yield "stops after a third", Estimate(stamps_s[: FRAMES // 3], c2w[: FRAMES // 3])
    yield "has no pose", Estimate(np.zeros(0), np.zeros((0, 4, 4)))
    yield "has two poses", Estimate(stamps_s[:2], c2w[:2])
    yield "stands still", Estimate(stamps_s, np.tile(np.eye(4), (FRAMES, 1, 1)))
    yield "has other stamps", Estimate(stamps_s + 1000.0, c2w)
    yield TREMBLES, Estimate(stamps_s, trembling)


# --- metrics of maps ---


SAMPLES = 2000
FARTHER_M = 0.05
EQUAL = 1e-9


def check_map_metric(metric: MapMetric) -> None:
    """Check a metric of maps. Raises AssertionError with the rule that it breaks. It needs the extra evaluate.

    Its name ends with its unit where that is m, s, deg or rad, and its meaning is a sentence. It gives a finite number
    or None, the same twice, whatever a map is like: none at all, half of the truth, all of it, or elsewhere. The truth
    itself is not worse than half of it, nor than the truth elsewhere, unless it is of the paper's: ICP moves that back.
    """
    require(isinstance(metric, MapMetric), str(metric), f"is a {type(metric).__name__}, no MapMetric")
    check_words(metric)
    wall = _wall(4.0)
    elsewhere = replace(wall, vertices_m=wall.vertices_m + np.array([0.0, 0.0, FARTHER_M]))
    with true_map_of_mesh(wall, CAMERA, np.eye(4)[None], samples=SAMPLES) as truth:
        best = _map_metrics_value(metric, wall, truth)
        for what, map_ in (("no map", None), ("half of the truth", _wall(0.0)), ("the truth elsewhere", elsewhere)):
            found = _map_metrics_value(metric, map_, truth)
            if found is None or best is None or not metric.better or metric.group == "paper":  # ICP undoes what we do
                continue
            worse = found < best - EQUAL if metric.better == "lower" else found > best + EQUAL
            message = f"is {found:g} for {what}, better than {best:g} for the truth itself: {metric.better} is better"
            require(not worse, metric.name, message)


def _wall(right_m: float) -> Mesh:
    """Return a wall across z, of several colours, from 4 m on the left."""
    x, y = np.meshgrid(np.linspace(-4.0, right_m, 9), np.linspace(-4.0, 4.0, 9), indexing="ij")
    at = np.arange(x.size).reshape(x.shape)
    corners = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1).astype(np.int32)
    vertices_m = np.stack([x.ravel(), y.ravel(), np.full(x.size, 2.0)], axis=1)
    rgb = (0.5 + 0.4 * np.sin(vertices_m)).astype(np.float32)
    return Mesh(vertices_m, rgb, corners, np.arange(0, len(corners), 4, dtype=np.int32))


def _map_metrics_value(metric: MapMetric, map_: Mesh | None, truth: TrueMap) -> float | None:
    def made() -> float | None:
        return checked_value(metric, metric.compute(ComparedMap(map_, truth)), MAP_METRICS)

    try:
        first, second = made(), made()
    except NoisyWorldError as error:
        raise AssertionError(str(error)) from error
    require(first == second, metric.name, f"gives {first} and then {second} for the same map")
    return first


# --- systems: the definition is run ---


SYSTEMS_FRAMES = 10
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
    write_sequence(written, path(SYSTEMS_FRAMES), folder / "scene")
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
