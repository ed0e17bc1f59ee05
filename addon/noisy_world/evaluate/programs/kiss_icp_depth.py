# SPDX-License-Identifier: GPL-3.0-or-later
"""KISS-ICP on the points of the depth images; a program of its own, in an environment of systems.

    .venv-slam/bin/python kiss_icp_depth.py FRAMES OUT
    .venv-slam/bin/python kiss_icp_depth.py --versions

It sees no colour and is never lost: every frame with points has a pose, true or not. Writes trajectory.txt (TUM,
camera-to-world) and frames.csv; a frame with too few points is lost.
"""

import sys
from argparse import ArgumentParser, Namespace
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from frame_files import carry_out, read_image, write_estimate
from kiss_icp.config import KISSConfig  # pyright: ignore[reportMissingImports] - of the other environment
from kiss_icp.config.config import (  # pyright: ignore[reportMissingImports]
    AdaptiveThresholdConfig,
    DataConfig,
    MappingConfig,
    RegistrationConfig,
)
from kiss_icp.kiss_icp import KissICP  # pyright: ignore[reportMissingImports]

# KISS-ICP's own are for a laser on a car: voxels of 1 m, 2 m between scans. Chosen on the clean embedded room 6, where
# voxels of 3 cm take several times as long.
VOXEL_M = 0.05
FARTHEST_M, NEAREST_M = 10.0, 0.1
FIRST_THRESHOLD_M, LEAST_MOTION_M = 0.1, 0.005
EVERY_PX = 3  # of rows and columns, as voxels take one point of many
FEWEST_POINTS = 500


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = ArgumentParser(prog="kiss_icp_depth.py", description="Run KISS-ICP on the depth of a sequence.")
    return carry_out(arguments, parser, versions, run)


def versions() -> dict[str, str]:
    """Return the versions of what runs."""
    return {name: version(name) for name in ("kiss-icp", "numpy")} | {"opencv": cv2.__version__}


def run(index: dict, out: Path, _: Namespace) -> None:
    """Show all frames to the system, then write what it estimated."""
    odometry = KissICP(
        KISSConfig(
            data=DataConfig(max_range=FARTHEST_M, min_range=NEAREST_M, deskew=False),
            mapping=MappingConfig(voxel_size=VOXEL_M),
            registration=RegistrationConfig(max_num_threads=1),  # so that two runs are the same
            adaptive_threshold=AdaptiveThresholdConfig(
                initial_threshold=FIRST_THRESHOLD_M, min_motion_th=LEAST_MOTION_M
            ),
        )
    )
    rays = rays_of(index["camera"])
    poses = {}
    for frame in index["frames"]:
        points_m = points_of(read_image(frame["depth"], cv2.IMREAD_UNCHANGED) / index["depth_scale_per_m"], rays)
        if len(points_m) >= FEWEST_POINTS:
            odometry.register_frame(points_m, np.zeros(len(points_m)))
            poses[frame["index"]] = odometry.last_pose.copy()
    write_estimate(out, index, poses)


def rays_of(camera: dict) -> np.ndarray:
    """Return what a metre of depth is in the camera's axes (H, W, 3), of every EVERY_PX-th pixel."""
    columns, rows = np.meshgrid(np.arange(0, camera["width"], EVERY_PX), np.arange(0, camera["height"], EVERY_PX))
    x, y = (columns - camera["cx"]) / camera["fx"], (rows - camera["cy"]) / camera["fy"]
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def points_of(depth_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the points (N, 3) in metres of a depth image (H, W), 0 being void."""
    seen_m = depth_m[::EVERY_PX, ::EVERY_PX]
    return (rays * seen_m[..., None])[seen_m > 0]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
