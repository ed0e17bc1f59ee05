# SPDX-License-Identifier: GPL-3.0-or-later
"""Systems' own configuration files, written from the frames that a system is given, and how each is started.

A system lies where its environment does: `.venv-NAME/bin/python` is its Python, `.venv-NAME/checkout` its code.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors
from ..core.errors import InputError, MissingDependencyError, NoisyWorldError
from ..core.file_access import read_text
from ..core.packages import PACKAGE
from ..core.schema import yaml_text
from ..core.trajectory import evenly_stamped
from ..images.image_files import read_pixels
from ..images.pixels import encode_png
from ..trajectories.matrix_poses import replica_text
from .estimates import Index
from .systems import environment_folder, environment_python

# A sequence as the neural systems read it, made of the frames that a system is given: Replica's layout.
#
# Their loaders list `results/frame*.jpg` and `results/depth*.png`, and read a pose for each frame from `traj.txt`: the
# first frame's is where they begin, the others are only compared with, in their own logs. They are told a path that we
# make up, which begins at the identity, so that their world is the first camera.


TO_POSES = PACKAGE / "evaluate" / "programs" / "checkpoint_poses.py"
SEQUENCE = "sequence"  # of a run's folder
RESULT = "result"  # what the system writes
# The published configurations are of images of this size, width and height.
REPLICA_PX = (1200, 680)
SEEN_FRAMES = 24  # chosen: of which depth is read to find how far a system has to map
FARTHEST_PERCENT = 99.0  # chosen: a few wrong pixels do not make the room larger
MARGIN = 1.1  # chosen


def write_sequence(index: Index, folder: Path) -> Path:
    """Write the sequence into a folder of a run: links to the images, and a path that is made up. Return its folder.

    The images' names end in .jpg, whatever they are: the loaders tell images apart by content. Where the system is
    given no depth, there is a depth image of 1 m, which a monocular system's loader asks for and nobody uses.
    """
    sequence = folder / SEQUENCE
    results = sequence / "results"
    with storage_errors(results):
        results.mkdir(parents=True)
        flat: Path | None = None
        for number, frame in enumerate(index["frames"]):
            (results / f"frame{number:06d}.jpg").symlink_to(frame["colour"])
            depth = frame["depth"]
            if depth is None:
                flat = flat or _write_flat(index, sequence)
                depth = flat
            (results / f"depth{number:06d}.png").symlink_to(depth)
        (sequence / "traj.txt").write_text(made_up_path(len(index["frames"])), encoding="utf-8")
    return sequence


def made_up_path(count: int) -> str:
    """Return traj.txt of a path that begins at the identity and is a small helix: evo refuses one of no extent."""
    k = np.arange(count, dtype=np.float64)
    c2w = np.tile(np.eye(4), (count, 1, 1))
    c2w[:, :3, 3] = 0.01 * np.stack([np.sin(k), 1.0 - np.cos(k), k / max(count, 1)], axis=1)
    return replica_text(evenly_stamped(c2w))


def _write_flat(index: Index, sequence: Path) -> Path:
    camera, scale_per_m = index["camera"], float(index["depth_scale_per_m"])
    steps = np.full((camera["height"], camera["width"]), min(round(scale_per_m), 65535), np.uint16)
    path = sequence / "flat.png"
    path.write_bytes(encode_png(steps))
    return path.resolve()


def camera_keys(index: Index) -> dict[str, Any]:
    """Return the camera as the configurations of NICE-SLAM and its successors name it."""
    camera = index["camera"]
    return {
        "H": int(camera["height"]),
        "W": int(camera["width"]),
        "fx": float(camera["fx"]),
        "fy": float(camera["fy"]),
        "cx": float(camera["cx"]),
        "cy": float(camera["cy"]),
        "png_depth_scale": float(index["depth_scale_per_m"]),
    }


def scaled_edges(index: Index, edge_px: int) -> dict[str, int]:
    """Return the edges that tracking leaves out: the published share of the image, 1 pixel or more."""
    camera = index["camera"]
    return {
        "ignore_edge_W": max(1, round(edge_px * camera["width"] / REPLICA_PX[0])),
        "ignore_edge_H": max(1, round(edge_px * camera["height"] / REPLICA_PX[1])),
    }


def reach_m(index: Index) -> float:
    """Return how far from the first camera a system has to map, metres: as far as any of some frames sees.

    Published configurations state the bounds of each scene, taken from its mesh. A system is not given the mesh, and a
    camera inside a room sees no farther than from wall to wall. Raises InputError where the frames have no depth.
    """
    frames = index["frames"]
    chosen = np.unique(np.linspace(0, len(frames) - 1, SEEN_FRAMES).round().astype(int)) if frames else []
    farthest_m = [_farthest_m(index, frames[number]["depth"]) for number in chosen]
    reach = max(farthest_m, default=0.0)
    if reach <= 0.0:
        file = frames[0]["depth"] if frames else "frames"
        raise InputError(file, "no depth in this or any other frame", remedy="the system maps what has depth")
    return MARGIN * reach


def _farthest_m(index: Index, file: str) -> float:
    """Return the distance that all but a hundredth of a depth image's pixels do not exceed; 0 where it has no depth."""
    import cv2

    steps = read_pixels(Path(file), cv2.IMREAD_UNCHANGED)
    if steps is None or steps.dtype != np.uint16 or steps.ndim != 2:
        raise InputError(file, "is no depth image of 16 bits")
    distance_m = steps * _ray_lengths(index) / float(index["depth_scale_per_m"])
    seen = distance_m[steps > 0]
    return float(np.percentile(seen, FARTHEST_PERCENT)) if seen.size else 0.0


def _ray_lengths(index: Index) -> NDArray[np.float64]:
    """Return for each pixel how long a ray to planar depth 1 is, (H, W)."""
    camera = index["camera"]
    x = (np.arange(camera["width"]) - camera["cx"]) / camera["fx"]
    y = (np.arange(camera["height"]) - camera["cy"]) / camera["fy"]
    return np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)


def bound_m(index: Index) -> list[list[float]]:
    """Return a cube about the first camera, [[x0, x1], [y0, y1], [z0, z1]], of centimetres."""
    reach = float(np.ceil(100.0 * reach_m(index)) / 100.0)
    return [[-reach, reach]] * 3


def then_poses(kind: str, checkpoints: Path, folder: Path, *words: str) -> list[str]:
    """Return the arguments of Python that run a system and write the poses of its last checkpoint into a folder."""
    return [str(TO_POSES), kind, str(checkpoints), str(folder), *words]


def write_text(path: Path, text: str) -> Path:
    """Write a file of a configuration. Raises StorageError."""
    with storage_errors(path):
        path.write_text(text, encoding="utf-8")
    return path


# Co-SLAM (https://github.com/HengyiWang/Co-SLAM): `coslam.py --config CONFIGURATION`.
#
# As configs/Replica/replica.yaml, which a configuration inherits, and room0.yaml. Its loader takes the whole part of
# the intrinsics (datasets/dataset.py divides them by the downsampling factor with //). Its checkpoints are
# OUTPUT/EXP_NAME/checkpointN.pt.


_EDGE_PX = 20  # configs/Replica/replica.yaml: tracking.ignore_edge_W and _H


def co_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    sequence, bound = write_sequence(index, folder), bound_m(index)
    document: dict[str, Any] = {
        "inherit_from": "configs/Replica/replica.yaml",
        "tracking": scaled_edges(index, _EDGE_PX),
        "mapping": {"bound": bound, "marching_cubes_bound": bound},
        "cam": {**camera_keys(index), "crop_edge": 0, "near": 0, "far": bound[0][1]},
        "data": {"datadir": str(sequence), "trainskip": 1, "output": str(folder), "exp_name": RESULT},
    }
    configuration = write_text(folder / "configuration.yaml", yaml_text(document))
    return then_poses("co_slam", folder / RESULT, folder, "coslam.py", "--config", str(configuration))


# GO-SLAM (https://github.com/youmi-zym/GO-SLAM): `run.py CONFIGURATION --mode mono|rgbd`.
#
# As configs/Replica/replica.yaml, replica_mono.yaml and room0_mono.yaml, which a configuration inherits. Poses:
# OUTPUT/checkpoints/est_poses.npy.


_AREA_PX = 320 * 640  # of the images that it works on: H_out, W_out of configs/Replica/replica.yaml
_STEP_PX = 8  # src/motion_filter.py works on eighths of the image
_MOST_KEYFRAMES = 512  # configs/go_slam.yaml: tracking.buffer, some 10 MB of GPU memory each


def go_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration of a run with depth; return the arguments of Python."""
    return _write(index, folder, "rgbd", "configs/Replica/replica.yaml")


def go_slam_mono(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration of a run without depth; return the arguments of Python."""
    return _write(index, folder, "mono", "configs/Replica/replica_mono.yaml")


def _write(index: Index, folder: Path, mode: Literal["mono", "rgbd"], inherited: str) -> list[str]:
    sequence = write_sequence(index, folder)
    height, width = working_size(int(index["camera"]["height"]), int(index["camera"]["width"]))
    document: dict[str, Any] = {
        "inherit_from": inherited,
        "mode": mode,
        "mapping": {"bound": [[-2.0, 2.0]] * 3},  # where it begins: it finds the bounds itself
        "tracking": {"buffer": min(max(len(index["frames"]), 64), _MOST_KEYFRAMES)},
        "cam": {**camera_keys(index), "H_out": height, "W_out": width, "H_edge": 0, "W_edge": 0},
        "meshing": {"eval_rec": False, "gt_mesh_path": ""},
        "data": {"input_folder": str(sequence), "output": str(folder / RESULT)},
    }
    configuration = write_text(folder / "configuration.yaml", yaml_text(document))
    return ["run.py", str(configuration), "--device", "cuda:0", "--mode", mode]


def working_size(height_px: int, width_px: int) -> tuple[int, int]:
    """Return the size of the images that it works on: of the shape of the given ones, not larger, of whole eighths."""
    scale = min(1.0, math.sqrt(_AREA_PX / (height_px * width_px)))
    return (
        max(_STEP_PX, round(scale * height_px / _STEP_PX) * _STEP_PX),
        max(_STEP_PX, round(scale * width_px / _STEP_PX) * _STEP_PX),
    )


# NICE-SLAM, and iMAP as it comes with it (https://github.com/cvg/nice-slam): `run.py CONFIGURATION [--imap]`.
#
# A configuration inherits the one that is published for Replica, by its path in the checkout, and says what depends on
# the sequence: configs/Replica/replica.yaml, room0.yaml, and their _imap. Its checkpoints are OUTPUT/ckpts/NNNNN.tar.


_IMAP_SCALE = 0.1  # configs/imap.yaml, as programs/checkpoint_poses.py undoes it
_NICE_SLAM_EDGE_PX = 100  # configs/Replica/replica.yaml: tracking.ignore_edge_W and _H


def nice_slam(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    return _started("nice_slam", folder, str(_nice_slam_write(index, folder, "configs/Replica/replica.yaml", {})))


def imap(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python."""
    own = {"scale": _IMAP_SCALE}
    return _started(
        "imap", folder, str(_nice_slam_write(index, folder, "configs/Replica/replica_imap.yaml", own)), "--imap"
    )


def _started(kind: str, folder: Path, *words: str) -> list[str]:
    return then_poses(kind, folder / RESULT / "ckpts", folder, "run.py", *words)


def _nice_slam_write(index: Index, folder: Path, inherited: str, own: dict[str, Any]) -> Path:
    sequence, bound = write_sequence(index, folder), bound_m(index)
    document: dict[str, Any] = {
        "inherit_from": inherited,
        **own,
        "tracking": scaled_edges(index, _NICE_SLAM_EDGE_PX),
        "mapping": {"bound": bound, "marching_cubes_bound": bound},
        "meshing": {"eval_rec": False},
        "cam": {**camera_keys(index), "crop_edge": 0},
        "data": {"input_folder": str(sequence), "output": str(folder / RESULT)},
    }
    return write_text(folder / "configuration.yaml", yaml_text(document))


# SplaTAM-S (https://github.com/spla-tam/SplaTAM): `scripts/splatam.py CONFIGURATION`.
#
# A configuration is a Python file. Ours takes that of configs/replica/splatam_s.py in the checkout and replaces what
# depends on the sequence. Parameters: WORKDIR/RUN_NAME/params.npz, written when all frames are done.


def splatam_s(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python.

    Raises InputError where the images are grey, which its loader does not read.
    """
    _check_colour(index)
    write_sequence(index, folder)
    camera = camera_keys(index)
    size = {"image_height": camera.pop("H"), "image_width": camera.pop("W")}
    data = {"dataset_name": "replica", "camera_params": {**size, **camera, "crop_edge": 0}}
    dataset = write_text(folder / "dataset.yaml", yaml_text(data))
    height, width = size["image_height"], size["image_width"]
    replaced: dict[str, Any] = {
        "basedir": str(folder),
        "sequence": SEQUENCE,
        "gradslam_data_cfg": str(dataset),
        "desired_image_height": height,
        "desired_image_width": width,
        "tracking_image_height": height,
        "tracking_image_width": width,
        "densification_image_height": max(1, height // 2),  # as published: half of the image
        "densification_image_width": max(1, width // 2),
        "num_frames": len(index["frames"]),
    }
    lines = [
        "import runpy",
        "",
        'config = runpy.run_path("configs/replica/splatam_s.py")["config"]',
        f"config.update(workdir={str(folder)!r}, run_name={RESULT!r}, use_wandb=False)",
        f"config['data'].update({replaced!r})",
    ]
    configuration = write_text(folder / "configuration.py", "\n".join(lines) + "\n")
    return ["scripts/splatam.py", str(configuration)]


def _check_colour(index: Index) -> None:
    import cv2

    file = index["frames"][0]["colour"] if index["frames"] else ""
    image = read_pixels(Path(file), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3:
        raise InputError(file, "is no image of three channels, as SplaTAM reads them", remedy="set output.colour: rgb")


__all__ = ["CONFIGURATIONS", "Configuration"]


@dataclass(frozen=True)
class Configuration:
    """How a system is configured and started.

    environment: the environment beside the project that it is run in. home: where its code comes from. write: writes
    what it reads into a folder, whose path is absolute, and returns the arguments of its Python, which is started in
    its checkout. programs: files of the checkout that have to be there.
    """

    environment: str
    home: str
    write: Callable[[Index, Path], list[str]]
    programs: tuple[str, ...]


CONFIGURATIONS: dict[str, Configuration] = {
    "imap": Configuration(
        "nice-slam", "https://github.com/cvg/nice-slam", imap, ("run.py", "configs/Replica/replica_imap.yaml")
    ),
    "nice_slam": Configuration(
        "nice-slam", "https://github.com/cvg/nice-slam", nice_slam,
        ("run.py", "configs/Replica/replica.yaml", "pretrained/coarse.pt", "pretrained/middle_fine.pt"),
    ),
    "co_slam": Configuration(
        "co-slam", "https://github.com/HengyiWang/Co-SLAM", co_slam, ("coslam.py", "configs/Replica/replica.yaml")
    ),
    "go_slam": Configuration(
        "go-slam", "https://github.com/youmi-zym/GO-SLAM", go_slam, ("run.py", "configs/Replica/replica.yaml")
    ),
    "go_slam_mono": Configuration(
        "go-slam", "https://github.com/youmi-zym/GO-SLAM", go_slam_mono, ("run.py", "configs/Replica/replica_mono.yaml")
    ),
    "splatam_s": Configuration(
        "splatam", "https://github.com/spla-tam/SplaTAM", splatam_s,
        ("scripts/splatam.py", "configs/replica/splatam_s.py"),
    ),
}  # fmt: skip
"""Every configuration by the name of its system."""


# Starts a neural system on the frames that it is given: `python -m noisy_world.evaluate.configurations`.
#
# It writes what the system reads into the folder of the run, and becomes the system, in its own environment.


# What the versions of a result depend on, told by the system's own Python.
_TELL = (
    "import json, platform\n"
    "import torch\n"
    "print(json.dumps({'python': platform.python_version(), 'torch': torch.__version__}))\n"
)


def main(words: list[str] | None = None) -> None:
    """Run the command line. words: by default the process's own."""
    parser = argparse.ArgumentParser(prog="python -m noisy_world.evaluate.configurations", description=__doc__)
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
    output = _output_of([str(environment_python(chosen.environment)), "-c", _TELL], checkout)
    try:
        texts = {name: str(value) for name, value in json.loads(output.splitlines()[-1]).items()}
    except (ValueError, IndexError, AttributeError) as error:
        raise MissingDependencyError(f"its Python does not tell the version of torch: {output[-200:]}") from error
    try:
        texts["commit"] = _output_of(["git", "rev-parse", "HEAD"], checkout).strip()
    except MissingDependencyError:
        texts["commit"] = "unknown"  # no repository, or no git
    return texts


def _output_of(command: list[str], folder: Path) -> str:
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
