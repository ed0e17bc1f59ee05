# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a metric of paths keeps its contract."""

from collections.abc import Iterator

import numpy as np

from ..core.errors import NoisyWorldError
from ..core.trajectories.trajectory import Trajectory
from ..evaluation.estimate import Estimate
from ..evaluation.metrics import Metric, TrajectoryMetric
from ..evaluation.metrics.names import value_of
from ..evaluation.metrics.score import compare_poses
from .rules import path, require, require_name

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
