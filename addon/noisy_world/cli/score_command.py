# SPDX-License-Identifier: GPL-3.0-or-later
"""`score`: how far an estimated trajectory is from the true one, and how much of it there is."""

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import number
from .command import Command
from .entry import Entry, say
from .metric_table import metric_lines
from .parser import Parser
from .places import path

if TYPE_CHECKING:
    from ..evaluation.metrics.alignment import Conditioning
    from ..evaluation.metrics.score import Score

# Known before packages are: what `evaluation.metrics` has, which a test holds against it.
PROTOCOLS = ("strict", "paper", "paper_go_slam", "paper_mean")
ALIGNMENTS = ("none", "first_pose", "se3", "sim3")
PLOTS = ("png", "svg", "pdf")


def _score_options(parser: Parser) -> None:
    parser.add_argument(
        "estimate", metavar="ESTIMATE", type=path, help="a file of poses in any format, or the folder of a run"
    )
    parser.add_argument(
        "truth", metavar="GROUND_TRUTH", type=path, help="a file of poses in any format, or the folder of a sequence"
    )
    parser.add_argument(
        "--protocol",
        choices=PROTOCOLS,
        default="strict",
        help="strict (default), or as the paper's code does it: for ORB-SLAM3, GO-SLAM, systems whose mean it takes",
    )
    parser.add_argument("--monocular", action="store_true", help="the system had no depth, so its scale is free")
    parser.add_argument("--alignment", choices=ALIGNMENTS, help="instead of the protocol's")
    parser.add_argument(
        "--max-difference-s",
        metavar="S",
        type=_not_negative,
        help="how far the stamps of a pose and its frame may lie apart (default: 0.01)",
    )
    parser.add_argument(
        "--frames",
        metavar="FILE",
        type=path,
        help="the frames that the system was given, in which coverage is counted: a list of their time stamps, such as "
        "rgb.txt or data.csv, or the folder of the sequence (default: those of the folder that GROUND_TRUTH is or lies "
        "in; else the estimate's own rate)",
    )
    parser.add_argument("--format", metavar="NAME", default="auto", help="of the estimate (default: told by content)")
    parser.add_argument("--keyframes", metavar="FILE", type=path, help="the poses that protocol paper compares instead")
    parser.add_argument("--pose", choices=("c2w", "w2c"), default="c2w", help="the direction of the estimate's poses")
    parser.add_argument(
        "--axes", choices=("opencv", "opengl", "robot"), help="of the estimate's camera (default: the format's)"
    )
    parser.add_argument("--rate-hz", metavar="HZ", type=_positive, help="frames a second, of files without time stamps")
    parser.add_argument("--errors", metavar="FILE", type=path, help="write the errors of each frame there, as CSV")
    parser.add_argument(
        "--plot",
        metavar="FILE",
        type=_picture,
        help="draw the path with its errors there, as .png, .svg or .pdf; needs matplotlib",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def _score_path(options: argparse.Namespace, _: Entry) -> int:
    """Score, print and write what is asked for; return 0 for a run that failed too, as that is a result."""
    from ..core.datasets.storage import ELSEWHERE, storage_errors, write_atomic
    from ..core.errors import NoisyWorldError
    from ..core.extras import need
    from ..evaluation.estimates import FORMATS
    from ..evaluation.metrics import Alignment, frame_errors_text
    from ..evaluation.metrics.reading import read_poses_to_compare
    from ..evaluation.metrics.score import score_trajectory

    if options.plot is not None:
        need(("matplotlib",), "evaluate")
    if options.format not in ("auto", *FORMATS):
        raise NoisyWorldError(f"--format: {options.format!r} is no format of estimates: use {', '.join(FORMATS)}")
    poses = read_poses_to_compare(
        options.estimate,
        options.truth,
        keyframes=options.keyframes,
        frames=options.frames,
        format=options.format,
        direction=options.pose,
        axes=options.axes,
        rate_hz=options.rate_hz,
    )
    for note in poses.notes:
        say(f"note: {note}")
    found = score_trajectory(
        poses.estimate,
        poses.truth,
        options.protocol,
        monocular=options.monocular,
        keyframes=poses.keyframes,
        max_difference_s=options.max_difference_s,
        alignment=None if options.alignment is None else Alignment(options.alignment),
        frames_s=None if poses.frames is None else poses.frames.stamps_s,
    )
    for note in found.notes:
        say(f"warning: {note}")
    if options.errors is not None:
        with storage_errors(options.errors, ELSEWHERE):
            options.errors.write_text(frame_errors_text(found.frame_errors), encoding="utf-8")
    if options.plot is not None:
        write_atomic(options.plot, picture(found, options.plot.suffix[1:].lower()), options.plot.parent)
    frames_from = poses.frames_from or _FRAMES_FROM[found.frames_from].format(hz=found.rate_hz)
    if options.json:
        print(json.dumps(content(found, frames_from), indent=1, allow_nan=False))
    else:
        print(format_score(found, frames_from))
    return 0


_FRAMES_FROM = {
    "given": "those that were given",
    "estimate_rate": "at the estimate's own rate of {hz:.4g} Hz, over the time of the truth; --frames names them",
    "truth": "the samples of the truth",
}


def content(score: "Score", frames_from: str) -> dict[str, Any]:
    """Return a score as JSON values. frames_from: where the frames come from, in words."""
    by, by_poses, known = score.by, score.by_poses, score.conditioning
    return {
        "protocol": score.protocol,
        "alignment": str(score.alignment),
        "rotation": None if by is None else by.rotation.tolist(),
        "translation_m": None if by is None else by.translation.tolist(),
        "scale": None if by is None else by.scale,
        "by_full_poses": None
        if by_poses is None
        else {"rotation": by_poses.rotation.tolist(), "translation_m": by_poses.translation.tolist()},
        "extents_m": None if known is None else known.extents_m.tolist(),
        "conditioning": None if known is None else known.ratio,
        "decided_by_positions": None if known is None else known.decided,
        "failure": score.failure,
        "result": score.result,
        "poses": score.poses,
        "frames": score.frames,
        "matched": score.matched,
        "frames_from": frames_from,
        "max_difference_s": score.max_difference_s,
        "values": score.values,
    }


_SPOKEN = {"none": "no alignment", "first_pose": "aligned at the first pose", "se3": "SE(3)", "sim3": "Sim(3)"}


def format_score(score: "Score", frames_from: str) -> str:
    """Return a score as text: what was compared, how, and a row for each metric."""
    from ..evaluation.metrics import PROTOCOLS, metrics_of
    from ..evaluation.metrics.score import FAILURES
    from ..evaluation.metrics.success import INCOMPLETE, IS_INCOMPLETE

    protocol = PROTOCOLS[score.protocol]
    lines = [
        f"{score.matched:,} of {score.frames:,} frames have one of the {score.poses:,} poses, within "
        f"{score.max_difference_s:g} s; {_SPOKEN[score.alignment]}",
        f"frames: {frames_from}",
        f"protocol {protocol.name}: {protocol.meaning}",
        *(f"  {name}: {meaning}" for name, meaning in protocol.faults),
    ]
    if score.conditioning is not None:
        lines.append(conditioning_line(score.conditioning))
    if score.failure:
        lines.append(f"FAILED ({score.failure}): {FAILURES[score.failure]}")
    elif score.result == INCOMPLETE:
        lines.append(f"INCOMPLETE: it {IS_INCOMPLETE}, and errors are those of the frames that it has")
    table = metric_lines((name, metric, score.values[name]) for name, metric in metrics_of(protocol).items())
    return "\n".join([*lines, "", *table])


_DECIDED = {
    "all": "positions lay rotations and maps",
    "direction": "full poses lay rotations and maps",
    "nothing": "rotations lay rotations and maps",
}


def conditioning_line(known: "Conditioning") -> str:
    """Return how well the true path says how an estimate is turned, as a line."""
    from ..evaluation.metrics.alignment import WELL_CONDITIONED

    sizes = ", ".join(f"{extent_m:.3g}" for extent_m in known.extents_m.tolist())
    said = f"the true path extends {sizes} m (sd along its axes), the second {known.ratio:.3g} ATEs"
    if known.ratio < WELL_CONDITIONED:
        said += f"; below {WELL_CONDITIONED:g} positions hardly say how it is turned about itself"
    return f"{said}: {_DECIDED[known.decided]}"


def picture(score: "Score", ending: str) -> bytes:
    """Return a figure of a score's path and errors as a file. ending: of PLOTS."""
    from ..evaluation.metrics.score import FAILURES
    from ..evaluation.report.figures.scored_path import ScoredPath, scored_path_bytes

    errors_m = score.frame_errors.error_m
    known_m = errors_m[errors_m == errors_m]  # noqa: PLR0124 - a frame without a pose has NaN
    said = f"{score.result}: {score.matched:,} of {score.frames:,} frames tracked, {_SPOKEN[score.alignment]}"
    if score.failure:
        title = f"failed: {FAILURES[score.failure]}"
    else:
        rmse_m = math.sqrt(float((known_m**2).mean()))
        title = f"ATE RMSE {rmse_m:.3g} m, largest error {float(known_m.max()):.3g} m"
    return scored_path_bytes(ScoredPath(score.truth.c2w[:, :3, 3], score.frame_errors, f"{title}\n{said}"), ending)


def _picture(text: str) -> Path:
    found = path(text)
    if found.suffix[1:].lower() not in PLOTS:
        raise argparse.ArgumentTypeError(f"{text!r} has to end in {', '.join(f'.{name}' for name in PLOTS)}")
    return found


def _positive(text: str) -> float:
    return number(text, "a number, more than 0", lambda value: value > 0.0)


def _not_negative(text: str) -> float:
    return number(text, "a number, 0 or more", lambda value: value >= 0.0)


SCORE = Command(
    name="score",
    group="evaluate SLAM systems",
    help="compare an estimated trajectory with the true one",
    description="Compare an estimated trajectory with the true one: absolute and relative errors, and how much of "
    "the path was tracked. docs/metrics.md says what each number means.",
    options=_score_options,
    run=_score_path,
    needs=("numpy", "yaml"),
    stopped="nothing was written",
)
