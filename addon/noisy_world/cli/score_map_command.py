# SPDX-License-Identifier: GPL-3.0-or-later
"""`score-map`: how far the map of a SLAM system is from the true scene, and how much of it there is."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import number
from .command import Command
from .entry import Entry, say
from .metric_table import metric_lines
from .parser import Parser
from .places import path

if TYPE_CHECKING:
    from ..core.geometry import Intrinsics
    from ..core.scenes.mesh import Mesh
    from ..evaluation.estimate import Estimate
    from ..evaluation.maps.reading import SequenceToMap
    from ..evaluation.maps.score import MapScore
    from ..evaluation.maps.truth import TrueMap
    from ..evaluation.metrics.score import Score

CULLINGS = ("frustum_occlusion", "frustum", "none")  # known before packages are; a test holds them together


def _map_options(parser: Parser) -> None:
    parser.add_argument(
        "map",
        metavar="MAP",
        type=path,
        help="a mesh (.ply), the folder of a run, or a file of poses. Where there is no mesh, the sequence's frames "
        "are fused along the poses",
    )
    parser.add_argument(
        "truth",
        metavar="TRUTH",
        help="the scene's mesh (.ply) or embedded:room; or the folder of a sequence, whose depth is fused along its "
        "true path: for recordings of a scene without a mesh",
    )
    parser.add_argument(
        "--sequence",
        metavar="DIR",
        type=path,
        help="the folder of the sequence that the system was given: its true poses say what can be in a map, and its "
        "frames are what is fused. Not needed where TRUTH is that folder",
    )
    parser.add_argument(
        "--estimate",
        metavar="RUN",
        type=path,
        help="the run's folder or file of poses along which MAP was made: its alignment moves the map. Without one, a "
        "mesh is taken as it lies",
    )
    parser.add_argument("--monocular", action="store_true", help="the alignment has a scale")
    parser.add_argument("--camera", metavar="W,H,FX,FY,CX,CY", type=_camera, help="where no file says the intrinsics")
    parser.add_argument("--culling", choices=CULLINGS, default=CULLINGS[0], help=f"default: {CULLINGS[0]}")
    parser.add_argument("--samples", metavar="N", type=_count, default=200_000, help="points on each (200000)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the points (0)")
    parser.add_argument(
        "--voxel-m",
        metavar="M",
        type=_length,
        default=0.02,
        help="of a map that is fused; half of it for a truth that is (0.02)",
    )
    parser.add_argument(
        "--lpips",
        metavar="MODEL.onnx",
        type=path,
        help="a network with inputs in0 and in1, images (1, 3, H, W) in [-1, 1], RGB; its output is their distance",
    )
    parser.add_argument("--write-map", metavar="OUT.ply", type=path, help="write the map as it was compared")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def _score_map(options: argparse.Namespace, _: Entry) -> int:
    """Score and print; return 0 for a map that is bad or empty too, as that is a result."""
    from ..core.scenes.ply import check_ply
    from ..core.scenes.ply_writer import write_ply
    from ..evaluation.maps.perceptual import Perceptual
    from ..evaluation.maps.score import score_map

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
    from ..core.home import with_home
    from ..evaluation.maps.reading import read_sequence

    folder = options.sequence
    if folder is None and with_home(options.truth).is_dir():
        folder = with_home(options.truth)
    return None if folder is None else read_sequence(folder, options.camera)


def _path(
    options: argparse.Namespace, sequence: "SequenceToMap | None"
) -> "tuple[Estimate, Score] | tuple[None, None]":
    """Return the estimated path and what is said of it; None twice where a mesh is taken as it lies."""
    from ..core.errors import InputError
    from ..evaluation.metrics.reading import read_poses_to_compare
    from ..evaluation.metrics.score import score_trajectory

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
    from ..core.home import with_home
    from ..evaluation.maps.culling import Culling
    from ..evaluation.maps.reading import read_scene, read_sequence
    from ..evaluation.maps.truth import TrueMap, true_map_of_mesh, true_map_of_recording
    from ..evaluation.maps.views import NoViews

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
    from ..core.scenes.ply import read_ply
    from ..evaluation.maps.along import fuse_along
    from ..evaluation.maps.score import moved

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
    from ..evaluation.maps.reading import MAP

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
    from ..evaluation.maps.names import MAP_METRICS
    from ..evaluation.metrics.score import FAILURES

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
    group="evaluate SLAM systems",
    help="compare the map of a SLAM system with the true scene",
    description="Compare a map with the true scene, as far as the true cameras saw it: accuracy, completion, depth "
    "and colour of renders. docs/metrics.md says what each number means.",
    options=_map_options,
    run=_score_map,
    stopped="nothing was written",
)
