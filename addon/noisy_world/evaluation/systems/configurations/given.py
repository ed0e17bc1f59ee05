# SPDX-License-Identifier: GPL-3.0-or-later
"""A sequence as the neural systems read it, made of the frames that a system is given: Replica's layout.

Their loaders list `results/frame*.jpg` and `results/depth*.png`, and read a pose for each frame from `traj.txt`: the
first frame's is where they begin, the others are only compared with, in their own logs. They are told a path that we
make up, which begins at the identity, so that their world is the first camera.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.datasets.image_reading import read_pixels
from ....core.datasets.images import encode_png
from ....core.datasets.storage import storage_errors
from ....core.errors import InputError
from ....core.shipped import PACKAGE
from ....core.trajectories.matrix_poses import replica_text
from ....core.trajectories.trajectory import evenly_stamped
from ...estimates.frames import Index

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
    found = max(farthest_m, default=0.0)
    if found <= 0.0:
        file = frames[0]["depth"] if frames else "frames"
        raise InputError(file, "no depth in this or any other frame", remedy="the system maps what has depth")
    return MARGIN * found


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
