# SPDX-License-Identifier: GPL-3.0-or-later
"""`score`, `score-map`: an estimated path or map against the true one."""

import argparse
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, NoisyWorldError
from ..core.file_access import with_home
from ..core.packages import need
from .arguments import Parser, number, path
from .command import Command
from .entry import Entry, say

if TYPE_CHECKING:
    from ..core.geometry import Intrinsics
    from ..evaluate.estimates import Estimate
    from ..evaluate.map_metrics import MapScore
    from ..evaluate.metrics import Metric
    from ..evaluate.pose_errors import Conditioning
    from ..evaluate.run_maps import SequenceToMap
    from ..evaluate.trajectory_scores import Score
    from ..evaluate.true_maps import TrueMap
    from ..scenes.polygon_mesh import Mesh


def metric_lines(metrics: "Iterable[tuple[str, Metric, float | None]]") -> list[str]:
    """Return the lines of a table, its head first. metrics: name, metric and value, None where it has none."""
    rows = [("metric", "value", "", "better", "name")]
    rows += [(metric.label, _number(value), metric.unit, metric.better, name) for name, metric, value in metrics]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        f"{label:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {better:<{widths[3]}}  {name}"
        for label, value, unit, better, name in rows
    ]


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else f"{value:.5g}"


# --- `score` ---


# Known before packages are: what `evaluate.metrics` has, which a test holds against it.
PROTOCOLS = ("strict", "paper", "paper_go_slam", "paper_mean")
ALIGNMENTS = ("none", "first_pose", "se3", "sim3")
PLOTS = ("png", "svg", "pdf")


def _score_options(parser: Parser) -> None:
    parser.option("estimate ESTIMATE", "a file of poses in any format, or the folder of a run", type=path)
    parser.option("truth GROUND_TRUTH", "a file of poses in any format, or the folder of a sequence", type=path)
    parser.option(
        "--protocol",
        "strict (default), or as the paper's code does it: for ORB-SLAM3, GO-SLAM, systems whose mean it takes",
        choices=PROTOCOLS,
        default="strict",
    )
    parser.flag("--monocular", "the system had no depth, so its scale is free")
    parser.option("--alignment", "instead of the protocol's", choices=ALIGNMENTS)
    parser.option(
        "--max-difference-s S",
        "how far the stamps of a pose and its frame may lie apart (default: 0.01)",
        type=_not_negative,
    )
    parser.option(
        "--frames FILE",
        "the frames that the system was given, in which coverage is counted: a list of their time stamps, such as "
        "rgb.txt or data.csv, or the folder of the sequence (default: those of the folder that GROUND_TRUTH is or lies "
        "in; else the estimate's own rate)",
        type=path,
    )
    parser.option("--format NAME", "of the estimate (default: told by content)", default="auto")
    parser.option("--keyframes FILE", "the poses that protocol paper compares instead", type=path)
    parser.option("--pose", "the direction of the estimate's poses", choices=("c2w", "w2c"), default="c2w")
    parser.option("--axes", "of the estimate's camera (default: the format's)", choices=("opencv", "opengl", "robot"))
    parser.option("--rate-hz HZ", "frames a second, of files without time stamps", type=_positive)
    parser.option("--errors FILE", "write the errors of each frame there, as CSV", type=path)
    parser.option(
        "--plot FILE", "draw the path with its errors there, as .png, .svg or .pdf; needs matplotlib", type=_picture
    )
    parser.flag("--json", "print one JSON object instead of a table")


def _score_path(options: argparse.Namespace, _: Entry) -> int:
    """Score, print and write what is asked for; return 0 for a run that failed too, as that is a result."""
    from ..core.atomic_files import ELSEWHERE, storage_errors, write_atomic
    from ..evaluate.pose_errors import Alignment, frame_errors_text
    from ..evaluate.trajectory_scores import read_poses_to_compare, score_trajectory
    from ..trajectories.formats import TRAJECTORY_FORMATS as FORMATS

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
    from ..evaluate.metrics import INCOMPLETE, IS_INCOMPLETE, metrics_of
    from ..evaluate.pose_errors import PROTOCOLS
    from ..evaluate.trajectory_scores import FAILURES

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
    from ..evaluate.pose_errors import WELL_CONDITIONED

    sizes = ", ".join(f"{extent_m:.3g}" for extent_m in known.extents_m.tolist())
    said = f"the true path extends {sizes} m (sd along its axes), the second {known.ratio:.3g} ATEs"
    if known.ratio < WELL_CONDITIONED:
        said += f"; below {WELL_CONDITIONED:g} positions hardly say how it is turned about itself"
    return f"{said}: {_DECIDED[known.decided]}"


def picture(score: "Score", ending: str) -> bytes:
    """Return a figure of a score's path and errors as a file. ending: of PLOTS."""
    from ..evaluate.run_figures import ScoredPath, scored_path_bytes
    from ..evaluate.trajectory_scores import FAILURES

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
    order=190,
    group="evaluate SLAM systems",
    help="compare an estimated trajectory with the true one",
    description="Compare an estimated trajectory with the true one: absolute and relative errors, and how much of "
    "the path was tracked. docs/metrics.md says what each number means.",
    options=_score_options,
    run=_score_path,
    needs=("numpy", "yaml"),
    stopped="nothing was written",
)


# --- `score-map` ---


CULLINGS = ("frustum_occlusion", "frustum", "none")  # known before packages are; a test holds them together


def _map_options(parser: Parser) -> None:
    parser.option(
        "map MAP",
        "a mesh (.ply), the folder of a run, or a file of poses. Where there is no mesh, the sequence's frames "
        "are fused along the poses",
        type=path,
    )
    parser.option(
        "truth TRUTH",
        "the scene's mesh (.ply) or embedded:room; or the folder of a sequence, whose depth is fused along its "
        "true path: for recordings of a scene without a mesh",
    )
    parser.option(
        "--sequence DIR",
        "the folder of the sequence that the system was given: its true poses say what can be in a map, and its "
        "frames are what is fused. Not needed where TRUTH is that folder",
        type=path,
    )
    parser.option(
        "--estimate RUN",
        "the run's folder or file of poses along which MAP was made: its alignment moves the map. Without one, a "
        "mesh is taken as it lies",
        type=path,
    )
    parser.flag("--monocular", "the alignment has a scale")
    parser.option("--camera W,H,FX,FY,CX,CY", "where no file says the intrinsics", type=_camera)
    parser.option("--culling", f"default: {CULLINGS[0]}", choices=CULLINGS, default=CULLINGS[0])
    parser.option("--samples N", "points on each (200000)", type=_count, default=200_000)
    parser.option("--seed N", "of the points (0)", type=int, default=0)
    parser.option(
        "--voxel-m M", "of a map that is fused; half of it for a truth that is (0.02)", type=_length, default=0.02
    )
    parser.option(
        "--lpips MODEL.onnx",
        "a network with inputs in0 and in1, images (1, 3, H, W) in [-1, 1], RGB; its output is their distance",
        type=path,
    )
    parser.option("--write-map OUT.ply", "write the map as it was compared", type=path)
    parser.flag("--json", "print one JSON object instead of a table")


def _score_map(options: argparse.Namespace, _: Entry) -> int:
    """Score and print; return 0 for a map that is bad or empty too, as that is a result."""
    from ..evaluate.map_metrics import Perceptual, score_map
    from ..scenes.ply import check_ply
    from ..scenes.ply_writer import write_ply

    compare = None if options.lpips is None else Perceptual(options.lpips)
    if (file := _mesh_file(options)) is not None:
        check_ply(file)  # before the truth is made, which takes time
    sequence = _sequence(options)
    poses, path_score = _path(options, sequence)
    with _truth(options, sequence) as truth:
        mesh = _map(options, sequence, poses, path_score)
        if mesh is not None and options.write_map is not None:
            write_ply(options.write_map, mesh)
        score = score_map(mesh, truth, renders=truth.seen.view_count > 0, lpips=compare)
    failure = "" if path_score is None else path_score.failure
    print(
        json.dumps(_content(score, failure), indent=1, allow_nan=False)
        if options.json
        else _format_score(score, failure)
    )
    return 0


def _sequence(options: argparse.Namespace) -> "SequenceToMap | None":
    """Return the sequence that was mapped; None where none is named."""
    from ..evaluate.run_maps import read_sequence

    folder = options.sequence
    if folder is None and with_home(options.truth).is_dir():
        folder = with_home(options.truth)
    return None if folder is None else read_sequence(folder, options.camera)


def _path(
    options: argparse.Namespace, sequence: "SequenceToMap | None"
) -> "tuple[Estimate, Score] | tuple[None, None]":
    """Return the estimated path and what is said of it; None twice where a mesh is taken as it lies."""
    from ..evaluate.trajectory_scores import read_poses_to_compare, score_trajectory

    estimate = options.estimate
    if estimate is None and options.map.suffix.lower() != ".ply":
        estimate = options.map
    if estimate is None:
        return None, None
    if sequence is None:
        raise InputError(estimate, "is held against a true path", remedy="name its sequence with --sequence")
    poses = read_poses_to_compare(estimate, sequence.folder)
    for note in poses.notes:
        say(f"note: {note}")
    frames_s = None if poses.frames is None else poses.frames.stamps_s
    return poses.estimate, score_trajectory(poses.estimate, poses.truth, monocular=options.monocular, frames_s=frames_s)


def _truth(options: argparse.Namespace, sequence: "SequenceToMap | None") -> "TrueMap":
    from ..evaluate.run_maps import read_scene, read_sequence
    from ..evaluate.true_maps import Culling, NoViews, TrueMap, true_map_of_mesh, true_map_of_recording

    culling, samples, seed = Culling(options.culling), options.samples, options.seed
    folder = with_home(options.truth)
    if folder.is_dir():
        recording = read_sequence(folder, options.camera)
        frames, camera, voxel_m = recording.frames, recording.camera, options.voxel_m / 2
        return true_map_of_recording(frames, camera, voxel_m=voxel_m, culling=culling, samples=samples, seed=seed)
    mesh = read_scene(options.truth)
    if sequence is None:
        say("note: without --sequence no camera says what was seen: nothing is culled, and nothing rendered")
        return TrueMap(mesh, NoViews(), "mesh", culling=Culling.NONE, samples=samples, seed=seed)
    return true_map_of_mesh(mesh, sequence.camera, sequence.c2w, culling=culling, samples=samples, seed=seed)


def _map(
    options: argparse.Namespace, sequence: "SequenceToMap | None", poses: "Estimate | None", score: "Score | None"
) -> "Mesh | None":
    """Return the map in the true world: a mesh that is there, or the frames fused; None where there is none."""
    from ..evaluate.map_metrics import moved
    from ..evaluate.run_maps import fuse_along
    from ..scenes.ply import read_ply

    file = _mesh_file(options)
    if score is None:
        return read_ply(options.map)
    if score.by_poses is None:
        return None
    if file is not None:
        return moved(read_ply(file), score.by_poses.matrix)
    assert poses is not None
    assert sequence is not None
    fused = fuse_along(poses, sequence.frames, sequence.camera, by=score.by_poses, voxel_m=options.voxel_m)
    say(f"note: {fused.frames:,} frames were fused, with voxels of {100 * fused.voxel_m:g} cm")
    return fused.mesh


def _mesh_file(options: argparse.Namespace) -> Path | None:
    """Return the file of the map's mesh; None where frames are to be fused."""
    from ..evaluate.cases import MAP

    if options.map.suffix.lower() == ".ply":
        return options.map
    return options.map / MAP if (options.map / MAP).is_file() else None


_COMPARED = {
    "frustum_occlusion": "what true cameras saw, not behind other surfaces",
    "frustum": "what lies in the pictures of true cameras",
    "none": "everything",
}
_TRUTHS = {"mesh": "the scene's mesh", "fused": "the sequence's depth, fused along its true path"}


def _content(score: "MapScore", failure: str) -> dict[str, Any]:
    """Return a score as JSON values."""
    said = {"failure": failure, "truth": score.truth, "culling": str(score.culling), "samples": score.samples}
    return said | {"values": score.values}


def _format_score(score: "MapScore", failure: str) -> str:
    """Return a score as text: what was compared, and a row for each metric."""
    from ..evaluate.map_metrics import MAP_METRICS
    from ..evaluate.trajectory_scores import FAILURES

    lines = [f"held against {_TRUTHS[score.truth]}; compared: {_COMPARED[score.culling]}; {score.samples:,} points"]
    if failure:
        lines.append(f"FAILED ({failure}): {FAILURES[failure]}")
    table = metric_lines((name, MAP_METRICS[name], value) for name, value in score.values.items())
    return "\n".join([*lines, "", *table])


def _camera(text: str) -> "Intrinsics":
    from ..core.geometry import Intrinsics

    try:
        width, height, *others = text.split(",")
        fx, fy, cx, cy = map(float, others)
        return Intrinsics(int(width), int(height), fx, fy, cx, cy)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not W,H,FX,FY,CX,CY: {error}") from error


def _count(text: str) -> int:
    if not (text.isdecimal() and 100 <= int(text) <= 10_000_000):
        raise argparse.ArgumentTypeError(f"{text!r} has to be a whole number, 100 to 10000000")
    return int(text)


def _length(text: str) -> float:
    return number(text, "a number of metres, more than 0", lambda value: value > 0.0)


SCORE_MAP = Command(
    name="score-map",
    order=200,
    group="evaluate SLAM systems",
    help="compare the map of a SLAM system with the true scene",
    description="Compare a map with the true scene, as far as the true cameras saw it: accuracy, completion, depth "
    "and colour of renders. docs/metrics.md says what each number means.",
    options=_map_options,
    run=_score_map,
    stopped="nothing was written",
)

COMMAND = SCORE, SCORE_MAP
