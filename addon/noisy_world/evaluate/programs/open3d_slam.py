# SPDX-License-Identifier: GPL-3.0-or-later
"""Open3D's dense SLAM on a sequence, frame to model; a program of its own, in an environment of systems.

    .venv-slam/bin/python open3d_slam.py FRAMES OUT [--map]
    .venv-slam/bin/python open3d_slam.py --versions

Each frame's depth is aligned with what the model looks like from the frame before, and then joins the model. No loops
are closed. Writes trajectory.txt (TUM, camera-to-world, the tracked frames), frames.csv and, with --map, map.ply.
"""

import importlib.util
import sys
from argparse import ArgumentParser, Namespace
from importlib.metadata import distribution, version
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
from frame_files import carry_out, read_image, write_estimate

VOXEL_M = 0.01  # chosen: a room in 1 GB
BLOCKS = 40_000
TRUNCATION_VOXELS = 8.0  # Open3D's own, as is what a depth may differ by from the model's
NEAREST_M, FARTHEST_M = 0.1, 6.0
APART_M = 0.07
# Chosen: what is less, or faster, is no tracking. 20 degrees and 30 cm between two frames are 6 m/s at 20 Hz.
LEAST_FITNESS = 0.2
FARTHEST_STEP_M, LARGEST_TURN_DEG = 0.3, 20.0
LEAST_WEIGHT = 3.0  # of a voxel that is in the map, Open3D's own


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = ArgumentParser(prog="open3d_slam.py", description="Run Open3D's dense SLAM on a sequence.")
    parser.add_argument("--map", action="store_true", help="write the model as map.ply")
    return carry_out(arguments, parser, versions, run)


def versions() -> dict[str, str]:
    """Return the version of Open3D, which has to load."""
    open3d()
    return {"open3d": version("open3d-cpu")}


def open3d() -> ModuleType:
    """Return Open3D's compiled module, without what its package imports besides: windows, plots and a web server."""
    files = distribution("open3d-cpu").files or []
    path = next(file for file in files if file.match("open3d/cpu/pybind*.so")).locate()
    spec = importlib.util.spec_from_file_location("open3d.cpu.pybind", str(path))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Dense:
    """A model, and the camera that is tracked against it."""

    def __init__(self, index: dict) -> None:
        """Take an index of frames."""
        self._o3d = open3d()
        camera = index["camera"]
        self._scale = float(index["depth_scale_per_m"])
        matrix = [[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]]
        device = self._o3d.core.Device("CPU:0")
        intrinsics = self._tensor(np.array(matrix, dtype=np.float64))
        slam = self._o3d.t.pipelines.slam
        self._pose = np.eye(4)
        self._model = slam.Model(VOXEL_M, 16, BLOCKS, self._tensor(self._pose), device)
        self._seen, self._expected = (
            slam.Frame(camera["height"], camera["width"], intrinsics, device) for _ in range(2)
        )
        self._joined = 0

    def track(self, colour: np.ndarray, depth: np.ndarray) -> np.ndarray | None:
        """Return the pose (4, 4), c2w, of the next frame, which joins the model; None where it is lost.

        colour (H, W, 3) bytes, RGB. depth (H, W) 16 bits, steps.
        """
        image = self._o3d.t.geometry.Image
        self._seen.set_data_from_image("depth", image(self._tensor(depth)))
        self._seen.set_data_from_image("color", image(self._tensor(colour)))
        if self._joined:
            step = self._step()
            if step is None:
                return None
            self._pose = self._pose @ step
        self._model.update_frame_pose(self._joined, self._tensor(self._pose))
        self._model.integrate(self._seen, self._scale, FARTHEST_M, TRUNCATION_VOXELS)
        self._model.synthesize_model_frame(
            self._expected, self._scale, NEAREST_M, FARTHEST_M, TRUNCATION_VOXELS, enable_color=False
        )
        self._joined += 1
        return self._pose.copy()

    def _step(self) -> np.ndarray | None:
        """Return the motion from the frame before; None where it cannot be found or cannot be true."""
        try:
            result = self._model.track_frame_to_model(self._seen, self._expected, self._scale, FARTHEST_M, APART_M)
        except RuntimeError as error:  # too few points, or a system of equations without a solution
            print(f"lost: {error}")
            return None
        step = result.transformation.numpy()
        turn_deg = np.degrees(np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1, 1)))
        moved_m = np.linalg.norm(step[:3, 3])
        if not (result.fitness >= LEAST_FITNESS and moved_m <= FARTHEST_STEP_M and turn_deg <= LARGEST_TURN_DEG):
            print(f"lost: fitness {result.fitness:.3f}, {moved_m:.3f} m, {turn_deg:.1f} degrees")
            return None
        return step

    def write_map(self, path: Path) -> None:
        """Write the model's surface as a mesh with colours."""
        mesh = self._model.voxel_grid.extract_triangle_mesh(LEAST_WEIGHT)
        self._o3d.t.io.write_triangle_mesh(str(path), mesh)

    def _tensor(self, array: np.ndarray) -> object:
        return self._o3d.core.Tensor(np.ascontiguousarray(array))


def run(index: dict, out: Path, options: Namespace) -> None:
    """Show all frames to the system, then write what it estimated."""
    dense = Dense(index)
    poses: dict[int, np.ndarray] = {}
    for frame in index["frames"]:
        colour = read_image(frame["colour"], cv2.IMREAD_COLOR)[..., ::-1]
        pose = dense.track(colour, read_image(frame["depth"], cv2.IMREAD_UNCHANGED))
        if pose is not None:
            poses[frame["index"]] = pose
    write_estimate(out, index, poses)
    if options.map:
        dense.write_map(out / "map.ply")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
